"""Priced levels natively: the exact answer while it settles every level, else a stage for each from the first."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from hqp.arrays import Signs, Vec
from hqp.problem import Hierarchy, Rows, Selection, Shape, Solution, Stats, Status
from hqp.solvers.base import Described, OneThread, check_shape, finish, require_hierarchy
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
    from hqp.solvers.lexicographic import NativeWorkspace

Counts: TypeAlias = tuple[int, int, int, bool]
"""As NativeWorkspace.kernel: outcome (0 for an optimum), iterations, factorisations, whether it was judged."""

Kernel: TypeAlias = tuple[Callable[[], Counts], Vec, Signs, object]
"""A bound kernel: its solve, live views of (x, slack) and of the marks, and the solve as native modules call it."""

UNSETTLED = 98
"""Outcome of a kernel's solve whose answer is that of stages: not every priced level is settled by the exact one."""


class StagedWorkspace:
    """A workspace for priced hierarchies: the workspace of the exact one, whose native part has the stages as well."""

    def __init__(self, shape: Shape, exact: NativeWorkspace) -> None:
        self._shape, self._exact, self.native = shape, exact, exact.native
        ends = np.concatenate(([0], np.cumsum(shape.rows))).astype(int).tolist()
        self._parts = [slice(a, b) for a, b in pairwise(ends)]
        self._one_thread = OneThread()
        self._last_x: Vec = np.zeros(shape.n)
        self._problem: Hierarchy | None = None
        self._has_prices = False
        self._seconds = 0.0

    def reset(self) -> None:
        """Forget the warm starts."""
        self.native.reset()
        self._last_x = np.zeros(self._shape.n)

    def turn(self, out: Sequence[bool]) -> None:
        """The next solves are without the rows of these elements: each such set goes on where its last solve ended."""
        self.native.turn(out)

    def limit(self, seconds: float) -> None:
        """Time for the next solves [s], as the exact workspace takes it."""
        self._exact.limit(seconds)
        self.native.limit_stages(seconds if seconds < math.inf else 0.0)
        self._seconds = seconds

    def solve(self, problem: Hierarchy) -> Solution:
        """The exact answer where it settles every priced level, else that of the stages, with their points.

        Raises ProblemError for another shape or invalid prices, RuntimeError while another thread solves in this
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
        """The solution; if it was cut, that of the last x if it is lexicographically better."""
        if solution.status.cut:
            x = problem.better(solution.x, self._last_x)
            if x is not solution.x:
                self.native.without_multipliers()  # no multipliers
                solution = finish(problem, x, solution.status, solution.stats, solution.detail, describe=self._describe)
        self._last_x = solution.x.copy()  # a caller may modify the returned array
        return solution

    def _solved(self, problem: Hierarchy) -> Solution:
        if self._problem is not problem:
            self._bind(problem)
        problem.check_prices(self._shape.priced)  # they may have been refilled
        if (counts := self.native.begin()) is not None:
            return self.answer(problem, counts)
        return self._priced(problem, *self._exact.found(self._plain))

    def kernel(self, problem: Hierarchy) -> Kernel | None:
        """Call the kernel of all levels; its outcome is UNSETTLED where the answer is that of stages."""
        if not problem.readable:
            return None
        if self._problem is not problem:
            self._bind(problem)
        return self._exact.kernel(self._plain)

    def parts(self, problem: Hierarchy) -> dict[str, Any]:
        """Data of a problem's stages for a file (docs/plan_file.md)."""
        if self._problem is not problem:
            self._bind(problem)
        exact = self._exact.parts(self._plain)
        if not self._has_prices:
            return exact
        return {**exact, "stages": {"priced": problem.priced, **stage_tolerances(), **law_parts(problem)}}

    def exact_multipliers(self) -> Vec | None:
        """Multipliers of the latest answer: rows above each level, then its own.

        For a solution of stages, the multipliers of the levels above the stages may be missing.
        """
        return self._exact.exact_multipliers()

    def answer(self, problem: Hierarchy, counts: Counts) -> Solution:
        """The solution of the latest solve of ``kernel``."""
        if counts[0] == UNSETTLED:
            return self._staged(problem, Stats(*counts[1:3]))
        return self._priced(problem, self._exact.reported(counts), self._plain)

    def _priced(self, problem: Hierarchy, exact: Solution, bound: Any) -> Solution:
        """The exact solution, or that of the stages from the first level that it does not settle.

        bound: the exact problem as the kernel read it. An exact solution that only begins the stages is not judged:
        they are.
        """
        doubtful = self._exact.is_doubtful(exact)

        def judged() -> Solution:
            certified = self._exact.judged(self._plain, exact, bound)
            return self._staged(problem, certified.stats) if self._follows(certified) else certified

        if not self._follows(exact):
            return judged() if doubtful else self._exact.judged(self._plain, exact, bound)
        return self._staged(problem, exact.stats, [judged] if doubtful else [])

    def _follows(self, exact: Solution) -> bool:
        """Solve the stages that an exact solution does not settle; return true if there are any.

        Far out of reach the exact answer is so large that its lower levels cannot be certified; the stages need only
        that the levels without a price are met.
        """
        status, x = exact.status, exact.x
        near = status.solved or (status is Status.NOT_CERTIFIED and self._has_prices and self.native.unpriced_met(x))
        return near and bool(self.native.follow(x))

    def _staged(self, problem: Hierarchy, exact: Stats, others: Sequence[Callable[[], Solution]] = ()) -> Solution:
        """The answer of the latest stages; if stopped early, a point that satisfies the rows of the levels above.

        others: levels to solve if the certificate refuses it; stages that begin at a doubtful exact answer are judged.
        """
        steps, ended, uncertain, undecided, doubtful = self.native.effort()
        unsure = undecided or (doubtful and self._seconds > 0.0)  # without a clock the certificate decides
        status = Status.RANK_UNCERTAIN if unsure else Status.OPTIMAL
        if not ended:
            status = Status.TIME_LIMIT if self._seconds else Status.ITERATION_LIMIT
        stats = Stats(exact.iterations + steps, exact.factorisations, exact.build_s, self.native.elapsed())
        x, points = self.native.end().copy(), self.native.points().copy()
        solution = finish(problem, x, status, stats, stages=points, describe=self._describe)
        doubtful = doubtful or uncertain or not ended or bool(others)
        return second_opinion(problem, solution, others) if doubtful and not self._seconds else solution

    def _describe(self, problem: Hierarchy, x: Vec) -> Described:
        """Compute hqp.solvers.base.describe natively."""
        slack, marks = np.empty(self._parts[-1].stop), np.empty(self._parts[-1].stop, dtype=np.int8)
        broken = self.native.describe(x, slack, marks)
        return tuple(slack[part] for part in self._parts), tuple(marks[part] for part in self._parts), broken

    def _bind(self, problem: Hierarchy) -> None:
        check_shape(problem, self._shape)
        self._problem = None  # until all of it is bound
        self._plain, self._has_prices = problem.exact(), any(problem.priced)
        self.native.price(problem if self._has_prices else self._plain)
        self._problem = problem


def stage_tolerances() -> dict[str, float]:
    """Tolerances of the native stages from hqp.tolerances, by the same names."""
    return {
        "met": MET_TOLERANCE,
        "flat": FLAT_TOLERANCE,
        "accurate": ACCURATE,
        "resting": RESTING,
        "rounded": ROUNDED,
        "activity": ACTIVITY_TOLERANCE,
        "violation": VIOLATION_TOLERANCE,
    }


def law_parts(problem: Hierarchy) -> dict[str, Any]:
    """The prices of a hierarchy by name, for a file."""
    motion = problem.motion
    return {
        "prices": problem.prices,
        "turning": problem.turning,
        "eta": problem.eta,
        "F": None if motion is None else motion.F,
        "f": None if motion is None else motion.f,
        "F_rows": 0 if motion is None or motion.F.ndim == 1 else motion.F.shape[0],
    }


def row_parts(rows: Rows) -> dict[str, object]:
    """The arrays of rows by name, for a file."""
    A = rows.A
    index, scale = (A.index, A.scale) if isinstance(A, Selection) else (None, None)
    return {
        "A": None if isinstance(A, Selection) else A,
        "index": index,
        "scale": scale,
        "lower": rows.lower,
        "upper": rows.upper,
    }
