"""Row of a report: equation, check, robot, measured value."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SEEN = 100.0
"""A negative control passes if it misses the tolerance by this factor."""


@dataclass(frozen=True)
class Check:
    """A claim and its measurement.

    measured: the worst value.  passed: true if the claim holds.  note: context of the value.
    kind: ``product``, the library against something else; ``identity``, of the paper's formulas among themselves;
    ``negative control``, a mistake or a misprint that must miss the tolerance by far.
    """

    equation: str
    check: str
    robot: str
    tolerance: float
    measured: float
    passed: bool
    note: str = ""
    kind: str = ""


CONTROL = "negative control"


def at_most(
    equation: str,
    check: str,
    robot: str,
    tolerance: float,
    values: Iterable[float],
    note: str = "",
    kind: str = "",
) -> Check:
    """Passed if the largest value is within the tolerance; no value at all, or NaN, is a failure."""
    measured = worst(values)
    return Check(equation, check, robot, tolerance, measured, measured <= tolerance, note, kind)


def of_kind(checks: Iterable[Check], kind: str) -> list[Check]:
    """Set the kind of checks that have none."""
    return [check if check.kind else dataclasses.replace(check, kind=kind) for check in checks]


def exactly(
    equation: str, check: str, robot: str, expected: int, values: Iterable[int], note: str = "", kind: str = ""
) -> Check:
    """Passed if every value is the expected one; tolerance 0, measured: the largest deviation."""
    measured = worst(float(abs(value - expected)) for value in values)
    text = f"expected {expected}" + (f"; {note}" if note else "")
    return Check(equation, check, robot, 0.0, measured, measured == 0.0, text, kind)


def seen_to_fail(
    equation: str, check: str, robot: str, tolerance: float, values: Iterable[float], note: str = ""
) -> Check:
    """A negative control: passed if the median error misses the tolerance by SEEN or more."""
    listed = sorted(float(value) for value in values)
    measured = listed[len(listed) // 2] if listed else math.nan
    text = "negative control: must miss the tolerance" + (f"; {note}" if note else "")
    return Check(equation, check, robot, tolerance, measured, measured >= SEEN * tolerance, text, CONTROL)


def worst(values: Iterable[float]) -> float:
    """The largest value; NaN if there is none or one of them is NaN."""
    listed = [float(value) for value in values]
    if not listed or any(math.isnan(value) for value in listed):
        return math.nan
    return max(listed)


def write_json(path: Path, data: object) -> None:
    """Write dataclasses and plain mappings as JSON; numbers that are not finite become null."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(finite(data), indent=1, ensure_ascii=False) + "\n")


def finite(value: Any) -> Any:
    """The value in plain containers, with null for numbers that are not finite."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = dataclasses.asdict(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return value.item() if hasattr(value, "item") else value
