"""Solution whose parts are cut out of the kernel's arrays on first access."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hqp.arrays import Signs, Vec
from hqp.problem import Solution, Stats


class LazySolution(Solution):
    """Result of the kernel: x and status at once; residuals, active and stats are computed on first access.

    _numbers: x, the slacks, and the marks as bytes.  _parts: slices of each level's slacks, and of its marks among the
    bytes.  _counts: arguments of Stats.
    """

    __slots__ = ("_counts", "_numbers", "_parts")
    _numbers: Vec
    _parts: tuple[tuple[slice, ...], tuple[slice, ...]]
    _counts: tuple[int, int, float, float]


def _on_demand(name: str, make: Callable[[LazySolution], Any]) -> property:
    """The field of that name, made at the first call and kept where Solution keeps it."""
    field: Any = getattr(Solution, name)

    def read(solution: LazySolution) -> Any:
        try:
            return field.__get__(solution)
        except AttributeError:
            value = make(solution)
            field.__set__(solution, value)
            return value

    return property(read, field.__set__, doc=f"Solution.{name}.")


def _marks(solution: LazySolution) -> tuple[Signs, ...]:
    marks = solution._numbers.view(np.int8)
    return tuple(marks[part] for part in solution._parts[1])


for _name, _make in (
    ("residuals", lambda s: tuple(s._numbers[part] for part in s._parts[0])),
    ("active", _marks),
    ("stats", lambda s: Stats(*s._counts)),
):
    setattr(LazySolution, _name, _on_demand(_name, _make))
