"""Distributions of figures over runs: percentiles, limits, and confidence bounds of fall rates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.lab.outcome import number

CONFIDENCE = 0.95
"""Confidence of the one-sided bound on the fall rate."""

SHARES = {"median": 0.5, "p95": 0.95, "p99": 0.99, "worst": 1.0}

Numbers = np.ndarray[Any, np.dtype[np.float64]]


def percentiles(values: Sequence[float] | Numbers) -> dict[str, float]:
    """Median, 95th, 99th percentile and worst; each is a measured value without interpolation."""
    return _picked(np.sort(np.asarray(values, dtype=np.float64)))


def _picked(ordered: Numbers) -> dict[str, float]:
    return {name: float(ordered[max(0, math.ceil(share * ordered.size) - 1)]) for name, share in SHARES.items()}


def fall_rate_bound(falls: int, runs: int, confidence: float = CONFIDENCE) -> float:
    """Upper bound of the fall rate with that confidence, one-sided, exact (Clopper and Pearson 1934)."""
    from scipy.stats import beta

    return 1.0 if falls >= runs else float(beta.ppf(confidence, falls + 1, runs - falls))


@dataclass(frozen=True)
class Asked:
    """Measure by its key, in words, with its limits.

    scale: factor of the shown number.  smaller_is_worse: order of a measure without a lower limit.
    """

    key: str
    words: str
    low: float = -math.inf
    high: float = math.inf
    scale: float = 1.0
    smaller_is_worse: bool = False

    @property
    def promised(self) -> bool:
        """Return true if the measure has a limit."""
        return math.isfinite(self.low) or math.isfinite(self.high)

    @property
    def limits(self) -> str:
        """Limits in words."""
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"{self.low:g} to {self.high:g}"
        return "" if not self.promised else f">= {self.low:g}" if math.isfinite(self.low) else f"<= {self.high:g}"

    def spread(self, rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
        """Median, 95th, 99th percentile and worst, ordered towards the limit and beyond it; NaN is the worst."""
        values = self.scale * np.array([row[self.key] for row in rows], dtype=np.float64)
        if math.isfinite(self.low) and math.isfinite(self.high):
            badness = np.abs(values - 0.5 * (self.low + self.high))
        else:
            badness = -values if self.smaller_is_worse or math.isfinite(self.low) else values
        return _picked(values[np.argsort(badness, kind="stable")])

    def cell(self, rows: Sequence[Mapping[str, float]]) -> str:
        """Median / 99th percentile / worst, and pass or FAIL of the 99th percentile."""
        found = self.spread(rows)
        text = " / ".join(number(found[at]) for at in ("median", "p99", "worst"))
        if not self.promised:
            return text
        return f"{text} ({'pass' if self.low <= found['p99'] <= self.high else 'FAIL'}, {self.limits})"
