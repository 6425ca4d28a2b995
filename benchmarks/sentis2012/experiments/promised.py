"""Every figure that the nominal runs promise, not the CoM error alone, as a distribution over runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.lab.outcome import Table, number, table


@dataclass(frozen=True)
class Asked:
    """A measure by its name in ``Measures``, in words, with the limits that a single run has in ``slope.acceptance``.

    scale: of the number shown over the measure.  sensed: limits of runs on the robot's own sensing, where they differ.
    """

    key: str
    words: str
    low: float = -math.inf
    high: float = math.inf
    scale: float = 1.0
    sensed: tuple[float, float] | None = None

    def limits(self, privileged: bool) -> tuple[float, float]:
        """Least and largest that was promised."""
        return (self.low, self.high) if privileged or self.sensed is None else self.sensed

    def badness(self, values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        """By which runs are ordered: how near to the limit, or beyond it."""
        if math.isfinite(self.low) and math.isfinite(self.high):
            return np.asarray(np.abs(values - 0.5 * (self.low + self.high)))
        return -values if math.isfinite(self.low) else values


NONE = (-math.inf, math.inf)

FIGURES = (
    Asked("com_up", "CoM error, way up [mm]", high=6.0, sensed=(-math.inf, 10.0)),
    Asked("com_back", "CoM error, way back [mm]", high=6.0, sensed=(-math.inf, 10.0)),
    Asked("com_first", "CoM error, first half second [mm]"),
    Asked("travel", "travel [m]", low=0.9),
    Asked("speed", "speed, median of the pull [m/s]", low=0.30, high=0.40, sensed=NONE),
    Asked("pull", "pull, max [N]", high=50.0, sensed=(-math.inf, 60.0)),
    Asked("hand_pulled", "hand error under pull [mm]", high=40.0, sensed=NONE),
    Asked("hand_rest", "hand error at rest [mm]", high=1.0, sensed=NONE),
    Asked("posture", "posture error, max [deg]", high=32.0, sensed=NONE),
    Asked("coupling", "biarticular coupling [deg]", high=0.02, sensed=NONE),
    Asked("unloaded", "a wheel unloaded [ms]", high=0.0, scale=1e3, sensed=NONE),
    Asked("load_quantile", "wheel load, 0.5 % quantile [N]", low=60.0, sensed=NONE),
    Asked("wheel_torque", "wheel torque, max [N m]", high=10.0, sensed=NONE),
)


def spread(rows: Sequence[Mapping[str, float]], asked: Asked) -> dict[str, float]:
    """Median, 95th, 99th percentile and worst by badness, NaN for the worst; each is a value that was met."""
    values = asked.scale * np.array([row[asked.key] for row in rows], dtype=np.float64)
    ordered = values[np.argsort(asked.badness(values), kind="stable")]  # NaN is last
    at = {"median": 0.5, "p95": 0.95, "p99": 0.99, "worst": 1.0}
    return {name: float(ordered[max(0, math.ceil(share * ordered.size) - 1)]) for name, share in at.items()}


def compared(cells: Mapping[str, Sequence[Mapping[str, float]]]) -> Table:
    """A row a figure, a column a cell: median / 99th percentile / worst, and the limit where one was promised."""
    rows = []
    for asked in FIGURES:
        row = [asked.words]
        for name, runs in cells.items():
            found = spread(runs, asked)
            low, high = asked.limits(privileged=name == "nominal")
            text = " / ".join(number(found[at]) for at in ("median", "p99", "worst"))
            if math.isfinite(low) or math.isfinite(high):
                text += f" ({'pass' if low <= found['p99'] <= high else 'FAIL'}, {_words(low, high)})"
            row.append(text)
        rows.append(row)
    header = ("figure", *(f"{name} ({len(runs)} runs)" for name, runs in cells.items()))
    return table("What is promised: median / 99th percentile / worst", header, rows)


def _words(low: float, high: float) -> str:
    if math.isfinite(low) and math.isfinite(high):
        return f"{low:g} to {high:g}"
    return f"at least {low:g}" if math.isfinite(low) else f"at most {high:g}"
