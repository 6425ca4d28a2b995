"""Strict levels for rows that others made: matrices and vectors in, x, status and residuals out."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hqp import dlpack
from hqp.arrays import FLOAT, Mat, Vec, floats
from hqp.errors import ProblemError
from hqp.problem import Hierarchy, Rows, Selection, Solution, Status
from hqp.solvers import exact, load
from hqp.solvers.many import HierarchyBatch, solve_many

_KEPT = 16
"""Shapes whose workspaces a thread keeps."""

_local = threading.local()


class LevelsSolution(NamedTuple):
    """Result of solve_levels.

    x: ``(n,)``, or ``(N, n)`` of stacked problems.  status: a Status, or N of them.  residuals: distance ||w_k|| of
    every level from its bounds, ``(levels,)`` or ``(N, levels)``, without the bounds on x.
    """

    x: Any
    status: Status | tuple[Status, ...]
    residuals: Any

    @property
    def solved(self) -> bool | NDArray[np.bool_]:
        """True if x is the optimum; a mask ``(N,)`` for stacked problems."""
        if isinstance(self.status, tuple):
            return np.array([status.solved for status in self.status], dtype=bool)
        return self.status.solved


def solve_levels(
    levels: Sequence[Sequence[ArrayLike]],
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    threads: int | None = None,
) -> LevelsSolution:
    """Solve strict priority levels of plain rows by lexicographic least squares.

    Level k minimises ||w_k|| with ``lower_k <= A_k x - w_k <= upper_k`` among the optima of the levels before it; x is
    the optimum of least norm.  levels: ``(A, b)`` or ``(A, lower, upper)`` each, the most important first; A ``(m, n)``
    and b ``(m,)``, or stacked ``(N, m, n)`` and ``(N, m)``; all N share arrays that are not stacked.  bounds: hard
    ``(lower, upper)`` on x, ``(n,)``, scalars or ``(N, n)``.  threads: of stacked problems, by default all that the
    process may use.  torch tensors on the CPU are read in place through DLPack, and x and residuals are then tensors.

    Raises ProblemError for shapes that disagree, NaN, lower above upper, or a tensor on another device.
    """
    if not isinstance(levels, Sequence) or not levels:
        raise ProblemError("solve_levels: takes a sequence of levels (A, b) or (A, lower, upper), given none")
    read = [_level(k, level) for k, level in enumerate(levels)]
    n = read[0][0].shape[-1]
    for k, (A, *_) in enumerate(read):
        if A.shape[-1] != n:
            raise ProblemError(f"solve_levels: level {k} has {A.shape[-1]} columns, level 0 has {n}")
    sides = () if bounds is None else tuple([_array("bounds", side) for side in bounds])
    given = [part for level in levels for part in level] + list(bounds or ())
    like = None if all(type(part) is np.ndarray for part in given) else dlpack.first_foreign(*given)
    dimensions = [A.ndim - 1 for A, *_ in read] + [
        b.ndim for level in (sides, *(two for _, *two in read)) for b in level
    ]
    if max(dimensions) == 2:
        return _stacked(read, sides, n, threads, like)
    kept = _prepared(n, tuple([A.shape[0] for A, *_ in read]), bool(sides))
    found, residuals = kept.solve(read, sides)
    return LevelsSolution(dlpack.returned(found.x.copy(), like), found.status, dlpack.returned(residuals, like))


def _array(what: str, part: Any) -> Any:
    """Return float64 numbers, in place if possible; the usual case first, which takes most of the calls."""
    if type(part) is np.ndarray and part.dtype == FLOAT:
        return part
    return floats(f"solve_levels: {what}", dlpack.numbers(part))


def _level(k: int, level: Any) -> tuple[Any, Vec, Vec]:
    if not isinstance(level, (tuple, list)) or len(level) not in (2, 3):
        raise ProblemError(f"solve_levels: a level is (A, b) or (A, lower, upper), given {type(level).__name__}")
    what = f"level {k}"
    A, *sides = [_array(what, part) for part in level]
    if A.ndim not in (2, 3):
        raise ProblemError(f"solve_levels: A of level {k} has shape {A.shape}, allowed (m, n) and (N, m, n)")
    m = A.shape[-2]
    for side in sides:
        if side.ndim not in (1, 2) or side.shape[-1] != m:
            raise ProblemError(f"solve_levels: a bound of level {k} has shape {side.shape}, A has {m} rows")
    return A, sides[0], sides[-1]


class _Prepared:
    """A hierarchy of one shape, whose arrays are filled anew for each problem, and its workspace."""

    def __init__(self, n: int, rows: tuple[int, ...], bounded: bool) -> None:
        first = n if bounded else 0
        ends = np.cumsum((first, *rows)).tolist()
        self.A, self.lower, self.upper = np.zeros((ends[-1] - first, n)), np.zeros(ends[-1]), np.zeros(ends[-1])
        levels = [Rows(Selection(np.arange(n)), self.lower[:n], self.upper[:n])] if bounded else []
        self._places = [
            (self.A[a - first : b - first], self.lower[a:b], self.upper[a:b]) for a, b in pairwise(ends)
        ]  # fmt: skip
        self.problem = Hierarchy((*levels, *(Rows(*place) for place in self._places)), len(levels), n=n)
        self.workspace = load(exact()).workspace(self.problem.shape)

    def solve(self, levels: list[Any], bounds: tuple[Vec, ...]) -> tuple[Solution, Vec]:
        """Return the solution and ||w_k|| of the levels."""
        for place, level in zip(self._places, levels, strict=True):
            place[0][:], place[1][:], place[2][:] = level
        if bounds:
            hard = self.problem.levels[0]
            try:
                hard.lower[:], hard.upper[:] = bounds
            except ValueError:
                shapes = tuple(side.shape for side in bounds)
                raise ProblemError(f"solve_levels: bounds of shapes {shapes}, allowed {hard.lower.shape}") from None
        self.workspace.reset()
        found = self.workspace.solve(self.problem)
        if not found.status.solved:  # numbers that are not usable among others
            for level in self.problem.levels:
                level.check()
        missed = found.residuals[1:] if bounds else found.residuals
        return found, np.array([math.sqrt(w @ w) for w in missed])


def _prepared(n: int, rows: tuple[int, ...], bounded: bool) -> _Prepared:
    """This thread's workspace of a shape; it keeps those of the latest shapes."""
    kept: dict[Any, _Prepared] = _local.__dict__.setdefault("kept", {})
    found = kept.pop((n, rows, bounded), None)
    if found is None:
        found = _Prepared(n, rows, bounded)
        if len(kept) >= _KEPT:
            kept.pop(next(iter(kept)))
    kept[n, rows, bounded] = found
    return found


def _stacked(levels: list[Any], sides: tuple[Vec, ...], n: int, threads: int | None, like: Any) -> LevelsSolution:
    rows = list(levels)
    if sides:
        low, high = (np.broadcast_to(s, (*s.shape[:-1], n)) for s in sides)
        rows.insert(0, (Selection(np.arange(n)), low, high))
    found = solve_many(HierarchyBatch(tuple(rows), len(sides) // 2, n=n), threads=threads)
    residuals: Mat = np.ascontiguousarray(found.norms[:, len(sides) // 2 :])
    return LevelsSolution(dlpack.returned(found.x, like), found.statuses, dlpack.returned(residuals, like))
