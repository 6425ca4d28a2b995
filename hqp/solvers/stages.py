"""Priced levels natively: the exact answer while it settles every level, else a stage for each from the first."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np

from hqp.arrays import Mat, Signs, Vec
from hqp.problem import Hierarchy, Rows, Selection, Shape, Solution, Stats, Status
from hqp.problem.pricing import is_met
from hqp.solvers.base import UNSURE, Described, OneThread, Workspace, check_shape, finish, require_hierarchy, turn
from hqp.solvers.second_opinion import second_opinion
from hqp.tolerances import (
    ACCURATE,
    ACTIVITY_TOLERANCE,
    FLAT_TOLERANCE,
    MET_TOLERANCE,
    RESTING,
    ROUNDED,
    VIOLATION_TOLERANCE,
)

if TYPE_CHECKING:
    from hqp._priced import Stages as NativeStages

T = TypeVar("T")

Counts: TypeAlias = tuple[int, int, int, bool]
"""As NativeWorkspace.kernel: outcome (0 for an optimum), iterations, factorisations, whether it was judged."""

Kernel: TypeAlias = tuple[Callable[[], Counts], Vec, Signs, object]
"""A bound kernel: its solve, live views of (x, slack) and of the marks, and the solve as native modules call it."""

BEGINS = (0, 1)
"""Outcomes of a kernel from which stages can start: an optimum, also one of uncertain rank."""

CUT = (4, 5)
"""Outcomes of a kernel that ended before an optimum, by its count or its time."""

UNSETTLED = 99
"""Outcome of a kernel's solve that does not settle every priced level."""

UNSETTLED_NATIVE = 98
"""The same, found without Python, whose answer is still to be told from an optimum."""


class StagedWorkspace:
    """A workspace for priced hierarchies: the kernel of the exact one and the native stages.

    exact: makes a workspace for an exact shape.
    """

    def __init__(self, shape: Shape, exact: Callable[[Shape], Workspace]) -> None:
        self._shape = shape
        self._make = exact
        self._exact = exact(replace(shape, priced=()))
        self._latest: Workspace | None = self._exact
        self._staged_it = False
        self._native = stages_of(shape.n, shape.rows, shape.priced)
        self._points: Mat = np.full((len(shape.rows), shape.n), np.nan)
        self._end: Vec = np.zeros(shape.n)
        ends = np.concatenate(([0], np.cumsum(shape.rows))).astype(int).tolist()
        self._parts = [slice(a, b) for a, b in pairwise(ends)]
        self._one_thread = OneThread()
        self._last_x: Vec = np.zeros(shape.n)
        self._problem: Hierarchy | None = None
        self._has_prices = False
        self._heads = dict[int, tuple[Workspace, Kernel | None]]()
        self._seconds = self._began = 0.0
        self._law: dict[str, Any] = {}
        self._sets: dict[Sequence[bool], None] = {}

    def reset(self) -> None:
        """Forget the warm starts."""
        self._exact.reset()
        self._last_x = np.zeros(self._shape.n)
        for workspace, _ in self._heads.values():
            workspace.reset()
        self._native.reset()

    def turn(self, out: Sequence[bool]) -> None:
        """The next solves are without the rows of these elements: each such set goes on where its last solve ended."""
        self._sets.pop(out, None)
        self._sets[out] = None  # the latest last
        for part in (self._exact, self._native, *(workspace for workspace, _ in self._heads.values())):
            turn(part, out)

    def limit(self, seconds: float) -> None:
        """Time for the next solves [s], as the solver's own workspace takes it."""
        self._seconds = seconds
        for workspace in (self._exact, *(workspace for workspace, _ in self._heads.values())):
            _limit(workspace, seconds)
        self._native.limit(seconds if seconds < math.inf else 0.0)

    def solve(self, problem: Hierarchy) -> Solution:
        """The exact answer where it settles every priced level, else that of the stages, with their points.

        Raises ProblemError for another shape, or prices that are none, RuntimeError while another thread solves in this
        workspace.
        """
        require_hierarchy(problem)
        self._one_thread.enter()
        try:
            if not problem.readable:
                problem = problem.copy()
            return self._no_worse(problem, self._solved(problem))
        finally:
            self._one_thread.leave()

    def _no_worse(self, problem: Hierarchy, solution: Solution) -> Solution:
        """The solution; where it was cut, that of the last x if it is lexicographically better."""
        if solution.status.cut:
            x = problem.better(solution.x, self._last_x)
            if x is not solution.x:
                self._latest, self._staged_it = None, False  # no multipliers
                solution = finish(problem, x, solution.status, solution.stats, solution.detail, describe=self._describe)
        self._last_x = solution.x.copy()  # a caller may write into what is given away
        return solution

    def _solved(self, problem: Hierarchy) -> Solution:
        if self._problem is not problem:
            self._bind(problem)
        problem.check_prices(self._shape.priced)  # they may have been refilled
        self._began = perf_counter()
        if not self._native.head:
            return self._priced(problem, self._exact.solve(self._plain))
        if (counts := self._from_head()) is not None:
            return self.answer(problem, counts)
        return self._priced(problem, self._in_the_rest(lambda: self._exact.solve(self._plain)))

    def kernel(self, problem: Hierarchy) -> Kernel | None:
        """The exact hierarchy's kernel, as NativeWorkspace.kernel; its outcome is UNSETTLED where stages follow."""
        if not problem.readable:
            return None
        if self._problem is not problem:
            self._bind(problem)
        exact: Kernel | None = getattr(self._exact, "kernel", lambda _: None)(self._plain)
        if exact is None or not self._has_prices:
            return exact
        solve, values, marks, call = exact
        native, x, stages, points, end = self._native, values[: problem.n], self._native.solve, self._points, self._end
        native.answers(problem.constraints)

        def alone() -> Counts:
            self._one_thread.enter()
            try:
                return settled()
            finally:
                self._one_thread.leave()

        def settled() -> Counts:
            self._began = perf_counter()
            if not native.head:
                counts = solve()
            elif (found := self._from_head()) is not None:
                return found
            else:
                counts = self._in_the_rest(solve)
            self._latest, self._staged_it = self._exact, False
            if counts[0] not in BEGINS:
                return counts
            first = stages(x, points, end, 0, self._left())
            return counts if first < 0 else (UNSETTLED, *counts[1:])

        return alone, values, marks, native.after(call, x, points, end)

    def parts(self, problem: Hierarchy) -> dict[str, Any]:
        """What the stages of a problem are made of, for a file (docs/plan_file.md)."""
        if self._problem is not problem:
            self._bind(problem)
        exact: dict[str, Any] = self._exact.parts(self._plain)  # type: ignore[attr-defined]
        if not self._has_prices:
            return exact
        priced, motion = problem.priced, problem.motion
        heads = {k: self._above_level(k) for k in range(1, len(priced)) if priced[k]}
        stages = {
            "priced": priced,
            **stage_tolerances(),
            **self._law,
            "F_rows": 0 if motion is None or motion.F.ndim == 1 else motion.F.shape[0],
            "points": self._points,
            "end": self._end,
            "heads": [
                {"level": k, **self._make(above.shape).parts(above)}  # type: ignore[attr-defined]
                for k, above in heads.items()
            ],
        }
        return {**exact, "stages": stages}

    def _from_head(self) -> Counts | None:
        """Stages from the exact answer of the levels above the one that was not met a tick ago.

        Far out of reach the exact answer of all levels is large, ill-conditioned and of no use.  None where that level
        is met by now, or the levels above have no optimum: the exact hierarchy decides.
        """
        head, self._native.head = self._native.head, 0
        kernel = self._heads[head][1] if head in self._heads else self._make_head(head)
        if kernel is None:
            return None
        solve, values, *_ = kernel
        counts = solve()
        if counts[0] in CUT:  # nothing tells that another level is the first that is not met
            self._native.head = head
        if counts[0] not in BEGINS:
            return None
        self._latest = self._heads[head][0]
        first = self._native.solve(values[: self._shape.n], self._points, self._end, head, self._left())
        return None if first < 0 else (UNSETTLED, *counts[1:])

    def _make_head(self, head: int) -> Kernel | None:
        above = self._above_level(head)
        workspace = self._make(above.shape)
        _limit(workspace, self._seconds)
        for out in self._sets:  # it has nothing to go on from in any of them
            turn(workspace, out)
        kernel: Kernel | None = getattr(workspace, "kernel", lambda _: None)(above)
        self._heads[head] = workspace, kernel
        if kernel is not None:
            self._native.above(head, kernel[3], kernel[1][: self._shape.n])
        return kernel

    def _above_level(self, head: int) -> Hierarchy:
        """The exact hierarchy of the levels above one."""
        plain = self._plain
        constraints = min(plain.constraints, head)
        return replace(plain, levels=plain.levels[:head], constraints=constraints, n=self._shape.n, stacked=None)

    @property
    def stages(self) -> tuple[Any, Mat]:
        """The native stages and the points ``(levels, n)`` of their latest solve."""
        return self._native, self._points

    def tell(self) -> Vec | None:
        """Multipliers of the workspace that gave the latest answer: rows above each level, then its own.

        Those of the levels above the stages, none where they are not at hand, where these gave it.
        """
        settled, answered, head, _ = self._native.latest()
        latest, staged = self._latest, self._staged_it
        if settled or answered:
            latest, staged = self._heads[head][0] if head else self._exact, answered
        told: Vec | None = getattr(latest, "tell", lambda: None)()
        return np.zeros(0) if told is None and staged else told

    def answer(self, problem: Hierarchy, counts: Counts) -> Solution:
        """The solution of the latest solve of ``kernel``."""
        if counts[0] == UNSETTLED_NATIVE:
            self._began = perf_counter() - self._native.latest()[-1]
        elif counts[0] != UNSETTLED:
            return self._priced(problem, self._exact.answer(self._plain, counts))  # type: ignore[attr-defined]
        return self._staged(problem, Stats(*counts[1:3]))

    def _priced(self, problem: Hierarchy, exact: Solution) -> Solution:
        """The exact solution, or that of the stages from the first level that it does not settle."""
        self._latest, self._staged_it = self._exact, False
        if not self._has_prices or not self._begins(problem, exact):
            self._native.unasked()
            return exact
        first = self._native.solve(exact.x, self._points, self._end, 0, self._left())
        return exact if first < 0 else self._staged(problem, exact.stats)

    @staticmethod
    def _begins(problem: Hierarchy, exact: Solution) -> bool:
        """Whether stages can start from this answer: it must be the optimum of the levels without a price.

        Far out of reach the exact answer is so large that its lower levels cannot be certified; the stages need only
        that the levels without a price are met.
        """
        if exact.status is not Status.NOT_CERTIFIED:
            return exact.status.solved
        last = max(k for k, priced in enumerate(problem.priced) if priced)
        return all(is_met(problem.levels[k], exact.x) for k in range(last) if not problem.priced[k])

    def _staged(self, problem: Hierarchy, exact: Stats) -> Solution:
        """The answer of the latest stages; stopped early, a point that keeps to what the levels above left."""
        steps, ended, uncertain, undecided, doubtful = self._native.effort()
        self._staged_it = ended
        if not ended:
            self._latest = None
        unsure = undecided or (doubtful and self._seconds > 0.0)  # without a clock the certificate decides
        status, detail = (Status.RANK_UNCERTAIN, UNSURE) if unsure else (Status.OPTIMAL, "")
        if not ended:
            status, detail = Status.TIME_LIMIT if self._seconds else Status.ITERATION_LIMIT, ""
        stats = Stats(
            exact.iterations + steps,
            exact.factorisations,
            exact.build_s,
            perf_counter() - self._began,
        )
        solution = finish(
            problem, self._end.copy(), status, stats, detail, self._points.copy(), describe=self._describe
        )
        doubtful = doubtful or uncertain or not ended
        return second_opinion(problem, solution) if doubtful and not self._seconds else solution

    def _in_the_rest(self, solve: Callable[[], T]) -> T:
        """The exact hierarchy solved in what is left of the time."""
        if not self._seconds:
            return solve()
        _limit(self._exact, self._left())
        found = solve()
        _limit(self._exact, self._seconds)
        return found

    def _left(self) -> float:
        """What is left of the time for this solve [s], 0 for no limit."""
        return max(self._seconds - (perf_counter() - self._began), 1e-6) if 0.0 < self._seconds < math.inf else 0.0

    def _describe(self, problem: Hierarchy, x: Vec) -> Described:
        """As hqp.solvers.base.describe, natively."""
        slack, marks = np.empty(self._parts[-1].stop), np.empty(self._parts[-1].stop, dtype=np.int8)
        broken = self._native.describe(x, problem.constraints, slack, marks)
        return tuple(slack[part] for part in self._parts), tuple(marks[part] for part in self._parts), broken

    def _bind(self, problem: Hierarchy) -> None:
        check_shape(problem, self._shape)
        self._problem = None  # until all of it is bound
        self._plain, self._has_prices = problem.exact(), any(problem.priced)
        self._heads.clear()
        if self._has_prices:
            self._bind_stages(problem)
        self._problem = problem

    def _bind_stages(self, problem: Hierarchy) -> None:
        motion, turning = problem.motion, problem.turning
        self._law = {
            "prices": np.ascontiguousarray(problem.prices),
            "turning": None if turning is None else np.ascontiguousarray(turning),
            "eta": problem.eta,
            "F": None if motion is None else motion.F,
            "f": None if motion is None else motion.f,
        }
        levels = [row_arrays(rows) for rows in problem.levels]
        self._native.bind(levels, **self._law, metric=problem.metric, origin=problem.origin)


def _limit(workspace: Workspace, seconds: float) -> None:
    getattr(workspace, "limit", lambda _: None)(seconds)


def stage_tolerances() -> dict[str, float]:
    """What the native stages take of hqp.tolerances, by the names that they have there."""
    return {
        "met": MET_TOLERANCE,
        "flat": FLAT_TOLERANCE,
        "accurate": ACCURATE,
        "resting": RESTING,
        "rounded": ROUNDED,
        "activity": ACTIVITY_TOLERANCE,
        "violation": VIOLATION_TOLERANCE,
    }


def stages_of(n: int, rows: Sequence[int], priced: Sequence[bool]) -> NativeStages:
    """Native stages of a hierarchy, to be bound to its arrays."""
    from hqp import _priced  # built with a compiler, as every user of this function

    return _priced.Stages(n, list(rows), [int(p) for p in priced], **stage_tolerances())


def row_arrays(rows: Rows) -> tuple[object, ...]:
    """What the native stages read: (A, None, None) or (None, index, scale), then the bounds; live where they can be."""
    if isinstance(rows.A, Selection):
        index = np.ascontiguousarray(rows.A.index, dtype=np.int64)
        return None, index, np.ascontiguousarray(rows.A.scale), rows.lower, rows.upper
    return rows.A, None, None, rows.lower, rows.upper


def row_parts(rows: Rows) -> dict[str, object]:
    """The arrays of rows by name, for a file."""
    A, index, scale, lower, upper = row_arrays(rows)
    return {"A": A, "index": index, "scale": scale, "lower": lower, "upper": upper}
