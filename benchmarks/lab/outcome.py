"""Outcome of an experiment: figures with their limits, tables, parameters, files."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Figure:
    """Number with its limits; passed if ``low <= measured <= high``, failed if it is NaN.

    before: the number of earlier studies on the same tables, or of the paper.
    binding: true if a miss fails the experiment; false for speed, which depends on the machine.
    """

    what: str
    measured: float
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    before: str = ""
    binding: bool = True

    @property
    def passed(self) -> bool:
        return bool(self.low <= self.measured <= self.high)  # a numpy bool is no JSON

    @property
    def asked(self) -> str:
        """The limits in words."""
        low, high, unit = self.low, self.high, self.unit
        if unit == "yes/no":
            return "yes" if low > 0.5 else "no"
        if low == -math.inf and high == math.inf:
            return "reported"
        if low == -math.inf:
            return f"<= {high:g} {unit}".rstrip()
        if high == math.inf:
            return f">= {low:g} {unit}".rstrip()
        return f"{low:g} to {high:g} {unit}".rstrip()

    @property
    def shown(self) -> str:
        """The measured value in words."""
        if self.unit == "yes/no":
            return "yes" if self.measured > 0.5 else "no"
        return f"{number(self.measured)} {self.unit}".rstrip()

    def cells(self) -> tuple[str, ...]:
        """As a row of a table under HEADER."""
        reported = self.low == -math.inf and self.high == math.inf and self.unit != "yes/no"
        missed = "FAIL" if self.binding else "slow"
        verdict = "" if reported and self.passed else "pass" if self.passed else missed
        return verdict, self.what, self.asked, self.shown, self.before


HEADER = ("", "figure", "asked", "measured", "earlier")


def holds(what: str, found: bool, wanted: bool = True, before: str = "") -> Figure:
    """Figure of a fact: found or not, with the wanted one of the two."""
    return Figure(what, float(found), "yes/no", float(wanted), float(wanted), before)


def number(x: float) -> str:
    """Three significant digits."""
    return f"{x:.3g}" if math.isfinite(x) else str(x)


@dataclass(frozen=True)
class Table:
    """Numbers without a verdict, or with one in each cell's words."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass
class Outcome:
    """One experiment: its figures, tables, parameters, real-time factor, and files written (caption, path)."""

    name: str
    figures: list[Figure] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    parameters: dict[str, Any] = field(default_factory=dict)
    files: list[tuple[str, Path]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        return not self.missed

    @property
    def missed(self) -> list[Figure]:
        """Binding figures outside their limits."""
        return [figure for figure in self.figures if figure.binding and not figure.passed]

    def plain(self) -> dict[str, Any]:
        """As numbers and text, for JSON."""
        return {
            "experiment": self.name,
            "passed": self.passed,
            "parameters": self.parameters,
            "figures": [
                {**dataclasses.asdict(f), "low": _finite(f.low), "high": _finite(f.high), "passed": f.passed}
                for f in self.figures
            ],
            "tables": [dataclasses.asdict(table) for table in self.tables],
            "files": [path.name for _, path in self.files],
            "notes": self.notes,
        }


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table from any sequences."""
    return Table(title, tuple(header), tuple(tuple(row) for row in rows))


def parameter_rows(parameters: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Parameters as rows of a table."""
    return [(key, str(value)) for key, value in parameters.items()]


def _finite(x: float) -> float | None:
    return x if math.isfinite(x) else None
