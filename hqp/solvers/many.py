"""Many hierarchies of one shape in one native call, on several threads."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec, floats, readable
from hqp.errors import DeclarationError, ProblemError, SolverNotInstalled
from hqp.numbers import whole
from hqp.problem import ETA, Hierarchy, Motion, Rows, Selection, Shape, Solution, Status
from hqp.solvers.base import check_shape, require_hierarchy
from hqp.solvers.lexicographic import DOUBTFUL, NO_KERNEL, STATUSES, Lexicographic, native_module
from hqp.solvers.stages import stage_tolerances


@dataclass(frozen=True, slots=True, eq=False)
class HierarchyBatch:
    """N hierarchies of one shape as stacked arrays, read where they are.

    levels: (A, lower, upper) each, A ``(N, m, n)``, or ``(m, n)`` or a Selection that all share; lower, upper ``(N,
    m)`` or ``(m,)``.  constraints: number of leading hard levels.  n: needed only where every level is a Selection.
    prices, motion, eta, turning: see Hierarchy, shared by all.
    """

    levels: tuple[tuple[Mat | Selection, Vec, Vec], ...]
    constraints: int = 0
    n: int = 0
    prices: Vec | None = None
    motion: Motion | None = None
    eta: float = ETA
    turning: Vec | None = None

    def __getitem__(self, i: int) -> Hierarchy:
        """Problem i, views of the arrays."""
        levels = [
            Rows(A if isinstance(A, Selection) or A.ndim == 2 else A[i], *(b if b.ndim == 1 else b[i] for b in bounds))
            for A, *bounds in self.levels
        ]
        law = {name: getattr(self, name) for name in ("prices", "motion", "eta", "turning")}
        return Hierarchy(tuple(levels), self.constraints, n=self.n, **law)

    def __len__(self) -> int:
        sizes = {len(A) for A, *_ in self.levels if not isinstance(A, Selection) and A.ndim == 3}
        sizes |= {len(b) for _, *bounds in self.levels for b in bounds if b.ndim == 2}
        if len(sizes) > 1:
            raise ProblemError(f"stacked arrays disagree on the number of problems: {sorted(sizes)}")
        return sizes.pop() if sizes else 1


@dataclass(frozen=True, slots=True, eq=False)
class Solutions:
    """Result of solve_many: x ``(N, n)``, norms ``(N, levels)`` of ||w_k||, statuses, and the slack of every row.

    slack, active: ``(N, m_0 + ... + m_p)``, level after level.  statuses: ``(N,)`` of Status.  iterations: ``(N,)``.
    stage_points: ``(N, levels, n)`` of priced problems, NaN where a level had no stage, ``(0, levels, n)`` of others.
    """

    x: Mat
    norms: Mat
    statuses: tuple[Status, ...]
    slack: Mat
    active: NDArray[np.int8]
    iterations: NDArray[np.int32]
    stage_points: NDArray[np.float64]

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Mask of solved problems, ``(N,)``."""
        return np.array([status.solved for status in self.statuses], dtype=bool)


def solve_many(
    problems: Sequence[Hierarchy] | HierarchyBatch, *, threads: int | None = None, solver: Lexicographic | None = None
) -> Solutions:
    """Solve each problem cold: bits equal to those of ``solver.solve`` one by one, with the interpreter's lock
    released.

    threads: number of threads, by default all that the process may use.  solver: its options; multipliers are not
    returned.  Raises ProblemError where the problems differ in shape, DeclarationError for a number of threads below
    one or a solver with a deadline, SolverNotInstalled without the native kernel.
    """
    module = native_module()
    if module is None:
        raise SolverNotInstalled(NO_KERNEL)
    solver = Lexicographic() if solver is None else solver
    if not isinstance(solver, Lexicographic):
        raise DeclarationError("solve_many", "bad solver", value=solver, allowed="Lexicographic(...)")
    count = _threads(threads)
    if solver.deadline:
        raise DeclarationError("solve_many", "supports no deadline", value=solver)
    if not isinstance(problems, (Sequence, HierarchyBatch)):
        allowed = "a sequence of problems or a HierarchyBatch"
        raise ProblemError(f"solve_many: takes {allowed}, given {type(problems).__name__}")
    if len(problems) == 0:
        raise ProblemError("solve_many: no problem given")
    if not isinstance(problems, HierarchyBatch):
        for problem in problems:
            require_hierarchy(problem)
    shape = problems[0].shape
    priced = list(shape.priced) or [False] * len(shape.rows)
    batch = module.Batch(shape.n, shape.rows, shape.metric, solver.options, priced, stage_tolerances())
    kept = _fill(batch, problems, shape)
    N, total = len(problems), sum(shape.rows)
    x, slack = np.empty((N, shape.n)), np.empty((N, total))
    active, effort = np.empty((N, total), dtype=np.int8), np.empty((N, 4), dtype=np.int32)
    points = np.empty((N if shape.priced else 0, len(shape.rows), shape.n))
    batch.solve(count, x, slack, active, effort, points)
    del kept
    return _finished(problems, solver, shape, x, slack, active, effort, points)


def _threads(threads: int | None) -> int:
    if threads is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return whole("solve_many", "threads", threads, 1)


def _fill(batch: Any, problems: Sequence[Hierarchy] | HierarchyBatch, shape: Shape) -> Any:
    """Give the batch its views; return the objects that must stay alive with it."""
    if isinstance(problems, HierarchyBatch):
        levels = [_stacked(A, lower, upper) for A, lower, upper in problems.levels]
        like = problems[0]
        batch.stack(len(problems), levels, problems.constraints, like)
        return levels, like
    kept = list(problems)
    wrong = batch.read(kept)
    if wrong >= 0:
        for problem in kept[wrong:]:
            check_shape(problem, shape)
        kept = [problem.copy() for problem in kept]  # contiguous and of the right type
        if batch.read(kept) >= 0:
            raise ProblemError(
                f"solve_many: the arrays of problem {wrong} do not have the shapes or types that its levels need"
            )
    return kept


def _stacked(A: Mat | Selection, lower: Vec, upper: Vec) -> tuple[object, ...]:
    bounds = [readable(np.atleast_2d(floats("rows: bounds", b))) for b in (lower, upper)]
    if isinstance(A, Selection):
        return None, readable(A.index, np.int64), readable(A.scale), *bounds
    A = readable(floats("rows: A", A))
    return A[None] if A.ndim == 2 else A, None, None, *bounds


def _finished(
    problems: Sequence[Hierarchy] | HierarchyBatch, solver: Lexicographic, shape: Shape, x: Mat, slack: Mat,
    active: NDArray[np.int8], effort: NDArray[np.int32], points: NDArray[np.float64],
) -> Solutions:  # fmt: skip
    """Statuses; doubtful or unreadable problems are solved again one by one."""
    statuses = [STATUSES[outcome] if outcome < len(STATUSES) else Status.NOT_CERTIFIED for outcome in effort[:, 0]]
    doubtful = [STATUSES.index(status) for status in (*DOUBTFUL, Status.ITERATION_LIMIT)]
    unsure = (effort[:, 0] >= len(STATUSES)) | np.isin(effort[:, 0], doubtful) | (effort[:, 3] != 0)
    for i in map(int, np.flatnonzero(unsure)):
        solution: Solution = solver.solve(problems[i])
        x[i], statuses[i] = solution.x, solution.status
        slack[i] = np.concatenate([*solution.residuals, np.zeros(0)])
        active[i] = np.concatenate([*solution.active, np.zeros(0, dtype=np.int8)])
        if shape.priced:
            points[i] = np.nan if solution.stage_points is None else solution.stage_points
    ends = np.cumsum([0, *shape.rows])
    norms = np.stack([np.linalg.norm(slack[:, a:b], axis=1) for a, b in pairwise(ends)], axis=1)
    return Solutions(x, norms, tuple(statuses), slack, active, effort[:, 1].copy(), points)
