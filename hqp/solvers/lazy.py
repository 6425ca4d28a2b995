"""A Solution whose parts are cut out of the kernel's numbers when they are first asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hqp.arrays import Signs, Vec
from hqp.problem import Solution, Stats


class LazySolution(Solution):
    """What the kernel sets up: x and status at once; residuals, active and stats, as of Solution, when asked for.

    _values: ``(n + rows,)``, x and the slacks.  _marks: ``(rows,)``.  _parts: where each level's slacks stand, and its
    marks.  _counts: what Stats is made of.
    """

    __slots__ = ("_counts", "_marks", "_parts", "_values")
    _values: Vec
    _marks: Signs
    _parts: tuple[tuple[slice, ...], tuple[slice, ...]]
    _counts: tuple[int, int, float, float]


def _when_asked(name: str, make: Callable[[LazySolution], Any]) -> property:
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


for _name, _make in (
    ("residuals", lambda s: tuple(s._values[part] for part in s._parts[0])),
    ("active", lambda s: tuple(s._marks[part] for part in s._parts[1])),
    ("stats", lambda s: Stats(*s._counts)),
):
    setattr(LazySolution, _name, _when_asked(_name, _make))
