"""Strict levels for rows that others made: matrices and vectors in, x, status and residuals out."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hqp import dlpack
from hqp.arrays import Mat, Vec, floats
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
        """True if x is the optimum; of stacked problems a mask ``(N,)``."""
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
    and b ``(m,)``, or stacked ``(N, m, n)`` and ``(N, m)``; what is not stacked is shared by all N.  bounds: hard
    ``(lower, upper)`` on x, ``(n,)``, scalars or ``(N, n)``.  threads: of stacked problems, by default all that the
    process may use.  torch tensors on the CPU are read in place through DLPack, and x and residuals are then tensors.

    Raises ProblemError for shapes that disagree, NaN, lower above upper, or a tensor on another device.
    """
    if not isinstance(levels, Sequence) or not levels:
        raise ProblemError("solve_levels: takes a sequence of levels (A, b) or (A, lower, upper), given none")
    flat = [one for level in levels for one in _parts(level)]
    like = dlpack.first_foreign(*flat, *(bounds or ()))
    read = [_level(k, level) for k, level in enumerate(levels)]
    n = read[0][0].shape[-1]
    for k, (A, *_) in enumerate(read):
        if A.shape[-1] != n:
            raise ProblemError(f"solve_levels: level {k} has {A.shape[-1]} columns, level 0 has {n}")
    sides = () if bounds is None else tuple(floats("solve_levels: bounds", dlpack.numbers(side)) for side in bounds)
    if any(A.ndim == 3 for A, *_ in read) or any(b.ndim == 2 for b in (*sides, *(b for _, *two in read for b in two))):
        return _stacked(read, sides, n, threads, like)
    kept = _prepared(n, tuple(level[0].shape[0] for level in read), bool(sides))
    found = kept.solve(read, sides)
    residuals = np.array(found.norms[len(sides) // 2 :])
    return LevelsSolution(dlpack.returned(found.x.copy(), like), found.status, dlpack.returned(residuals, like))


def _parts(level: Any) -> tuple[Any, ...]:
    if not isinstance(level, (tuple, list)) or len(level) not in (2, 3):
        raise ProblemError(f"solve_levels: a level is (A, b) or (A, lower, upper), given {type(level).__name__}")
    return tuple(level)


def _level(k: int, level: Any) -> tuple[Any, Vec, Vec]:
    A, *sides = (floats(f"solve_levels: level {k}", dlpack.numbers(part)) for part in level)
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
        hard = [Rows(Selection(np.arange(n)), np.zeros(n), np.zeros(n))] if bounded else []
        self.A, self.sides = np.zeros((sum(rows), n)), np.zeros((2, sum(rows)))
        ends = np.cumsum((0, *rows))
        self._places = [slice(a, b) for a, b in pairwise(ends.tolist())]
        levels = [Rows(self.A[at], self.sides[0, at], self.sides[1, at]) for at in self._places]
        self.problem = Hierarchy((*hard, *levels), len(hard), n=n)
        self.workspace = load(exact()).workspace(self.problem.shape)

    def solve(self, levels: list[Any], bounds: tuple[Vec, ...]) -> Solution:
        for (A, *sides), at in zip(levels, self._places, strict=True):
            self.A[at], self.sides[0, at], self.sides[1, at] = A, sides[0], sides[-1]
        hard = self.problem.levels[0]
        for side, given in zip((hard.lower, hard.upper), bounds, strict=False):
            try:
                side[:] = given
            except ValueError:
                raise ProblemError(f"solve_levels: bounds of shape {given.shape}, allowed {side.shape}") from None
        usual = np.isfinite(self.A).all() and (self.sides[0] <= self.sides[1]).all()
        if not usual or bounds:
            for level in self.problem.levels if not usual else (hard,):
                level.check()
        self.workspace.reset()
        return self.workspace.solve(self.problem)


def _prepared(n: int, rows: tuple[int, ...], bounded: bool) -> _Prepared:
    """What this thread keeps for a shape, made anew for a shape that is not among its latest."""
    kept: dict[Any, _Prepared] = _local.__dict__.setdefault("kept", {})
    found = kept.pop((n, rows, bounded), None)
    if found is None:
        found = _Prepared(n, rows, bounded)
        if len(kept) >= _KEPT:
            kept.pop(next(iter(kept)))
    kept[n, rows, bounded] = found
    return found


def _stacked(levels: list[Any], sides: tuple[Vec, ...], n: int, threads: int | None, like: Any) -> LevelsSolution:
    rows = [(A, two[0], two[-1]) for A, *two in levels]
    if sides:
        low, high = (np.broadcast_to(s, (*s.shape[:-1], n)) for s in sides)
        rows.insert(0, (Selection(np.arange(n)), low, high))
    found = solve_many(HierarchyBatch(tuple(rows), len(sides) // 2, n=n), threads=threads)
    residuals: Mat = np.ascontiguousarray(found.norms[:, len(sides) // 2 :])
    return LevelsSolution(dlpack.returned(found.x, like), found.statuses, dlpack.returned(residuals, like))
