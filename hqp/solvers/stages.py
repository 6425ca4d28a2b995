"""Priced levels through any solver of exact hierarchies: a stage for each level from the first that is not clear.

A level is clear where it is met at its point of least motion, that point keeps to all rows above, and the shortest u
with A_k'u + c F'(F x - f) + (rows above) = 0 has ||u|| <= 1.  While every priced level is clear, the answer is that of
the exact hierarchy, to the bit.  From the first level that is not, each stage is min ||w||^2 + m |y|^2, y the motion,
for the m with m = c ||w||, found by a secant on log m; the last solve is of the exact hierarchy with what the levels
hand down (hqp.pricing).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np

from hqp.arrays import Mat, Signs, Vec, longest_row
from hqp.pace import is_paced
from hqp.pricing import Coordinates, after_stages, at_optimum, feasible_set, is_met, room, stack_rows, stage_price
from hqp.problem import SHARE, Hierarchy, Rows, Selection, Shape, Solution, Stats, Status
from hqp.solvers.base import Described, OneThread, Workspace, check_shape, describe, finish, require_hierarchy
from hqp.solvers.second_opinion import second_opinion
from hqp.tolerances import (
    ACTIVITY_TOLERANCE,
    FLAT_TOLERANCE,
    MET_TOLERANCE,
    SLACK_TOLERANCE,
    VIOLATION_TOLERANCE,
)

if TYPE_CHECKING:
    from hqp._priced import Stages as NativeStages

try:
    from hqp import _priced as native_stages
except ImportError:  # no compiler was there
    native_stages = None  # type: ignore[assignment]

LEAST = 1e-6
"""sqrt(m) of a priced level below which it counts as met, relative to its largest row."""

ROOT = 1e-12
"""m is found to this relative accuracy."""

SECANTS = 8
"""Steps of a secant from the last multiplier before the search is bracketed."""

T = TypeVar("T")

Counts: TypeAlias = tuple[int, int, int, bool]
"""As NativeWorkspace.kernel: outcome (0 for an optimum), iterations, factorisations, whether it was judged."""

Kernel: TypeAlias = tuple[Callable[[], Counts], Vec, Signs, object]
"""A bound kernel: its solve, live views of (x, slack) and of the marks, and the solve as native modules call it."""

Found: TypeAlias = tuple[Mat, Vec, int, Hierarchy]
"""The stage points, the last of them, steps taken, and the exact hierarchy that is left."""

BEGINS = (0, 1)
"""Outcomes of a kernel from which stages can start: an optimum, also one of uncertain rank."""

UNSETTLED = 99
"""Outcome of a kernel's solve that does not settle every priced level."""

UNSETTLED_NATIVE = 98
"""The same, found without Python, whose answer is still to be told from an optimum."""


def multiplier(unmet: Callable[[float], float], price: float, size: float, near: float | None = None) -> float | None:
    """The m with m = c ||w(m)||, None where the level is met for its price; the last call of ``unmet`` is at it.

    unmet: ||w(m)|| of argmin ||w||^2 + m |y|^2, which grows with m more slowly than m does.  size: largest row.
    near: the m of a tick ago, for a secant to begin with; where that leaves the interval the search is bracketed.
    """

    def excess(log: float) -> float:
        return log - math.log(max(price * unmet(math.exp(log)), 1e-300))

    low = 2.0 * math.log(LEAST * size)
    if near is not None:
        old, guess = math.log(near), math.log(near)
        before, slope = 0.0, 1.0
        for turn in range(SECANTS):
            if not guess > low:
                break
            here = excess(guess)
            if abs(here) <= ROOT:
                return math.exp(guess)
            if turn:
                slope = (here - before) / (guess - old)
            if not 0.0 < slope <= 2.0:
                break
            old, before, guess = guess, here, guess - here / slope
    if excess(low) >= 0.0:
        return None
    high = low + 4.0
    while (far := excess(high)) < 0.0:
        low, high = high, 2.0 * high - low + 4.0
    close, guess = excess(low), high
    for _ in range(100):  # regula falsi with the Illinois rule, halving where it is slow
        guess = high - far * (high - low) / (far - close)
        here = excess(guess)
        if abs(here) <= ROOT or high - low <= ROOT:
            break
        if here > 0.0:
            high, far, close = guess, here, 0.5 * close
        else:
            low, close, far = guess, here, 0.5 * far
    return math.exp(guess)


def first_unclear(problem: Hierarchy, x: Vec, at: Coordinates) -> int | None:
    """The first priced level that the exact answer x does not settle; None where it settles all of them."""
    A, b, hard = np.zeros((0, problem.n)), np.zeros(0), []
    prices = problem.prices if problem.prices is not None else np.zeros(len(problem.levels))
    last = max((k for k, price in enumerate(prices) if price > 0.0), default=-1)
    for k in range(last + 1):
        rows = at_optimum(problem.levels[k], x) if prices[k] == 0.0 else problem.levels[k]
        dense, equal = rows.dense(problem.n), rows.equality
        A = np.concatenate([A, at.rows(dense[equal])])
        b = np.concatenate([b, rows.lower[equal] - dense[equal] @ at.still])
        hard.append(rows)
        if prices[k] == 0.0:
            continue
        shares, *_ = np.linalg.lstsq(A @ A.T, b, rcond=1e-12)
        y = shares @ A
        own = shares[shares.size - int(equal.sum()) :]
        terms = 1.0 + np.abs(A) @ np.abs(y)
        clear = bool(np.all(np.abs(A @ y - b) <= 1e-9 * terms)) and prices[k] * float(np.sqrt(own @ own)) <= 1.0
        point = at.point(y)
        if not clear or any(np.any(np.abs(r.slack(point)) > 1e-9 * (1.0 + np.abs(r.A @ point))) for r in hard):
            return k
    return None


class StagedWorkspace:
    """A workspace for priced hierarchies: one for the exact hierarchy, one for what the stages leave.

    exact: makes a workspace for an exact shape.  native: whether the stages are solved by the native code, else each
    by a secant over exact hierarchies in the same solver.
    """

    def __init__(self, shape: Shape, exact: Callable[[Shape], Workspace], native: bool = False) -> None:
        self._shape = shape
        self._exact = exact(replace(shape, priced=()))
        rows = tuple(m + priced for m, priced in zip(shape.rows, shape.priced, strict=True))
        selections = tuple(s and not p for s, p in zip(shape.selections, shape.priced, strict=True))
        self._last = exact(replace(shape, rows=rows, selections=selections, inequalities=True, priced=()))
        self._latest: Workspace | None = self._exact
        self._make, self._workspaces = exact, dict[Shape, Workspace]()
        self._multipliers = dict[int, float]()
        self._native = stages_of(shape.n, shape.rows, shape.priced) if native and native_stages else None
        self._points: Mat = np.full((len(rows), shape.n), np.nan)
        self._end: Vec = np.zeros(shape.n)
        ends = np.concatenate(([0], np.cumsum(shape.rows))).astype(int).tolist()
        self._parts = [slice(a, b) for a, b in pairwise(ends)]
        self._one_thread = OneThread()
        self._last_x: Vec = np.zeros(shape.n)
        self._problem: Hierarchy | None = None
        self._has_prices = False
        self._heads = dict[int, tuple[Workspace, Kernel | None]]()
        self._seconds = self._began = 0.0

    def reset(self) -> None:
        """Forget the warm starts."""
        self._exact.reset()
        self._last.reset()
        self._last_x = np.zeros(self._shape.n)
        self._workspaces.clear()
        self._multipliers.clear()
        for workspace, _ in self._heads.values():
            workspace.reset()
        if self._native is not None:
            self._native.reset()

    def limit(self, seconds: float) -> None:
        """Time for the next solves [s], as the solver's own workspace takes it."""
        self._seconds = seconds
        for workspace in (self._exact, self._last, *(workspace for workspace, _ in self._heads.values())):
            _limit(workspace, seconds)
        if self._native is not None:
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
                self._latest = None  # no multipliers
                solution = finish(problem, x, solution.status, solution.stats, solution.detail, describe=self._describe)
        self._last_x = solution.x.copy()  # a caller may write into what is given away
        return solution

    def _solved(self, problem: Hierarchy) -> Solution:
        if self._problem is not problem:
            self._bind(problem)
        problem.check_prices(self._shape.priced)  # they may have been refilled
        self._began = perf_counter()
        if self._native is None or not self._native.head:
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
        if exact is None or self._native is None or not self._has_prices:
            return exact
        solve, values, marks, call = exact
        native, x, stages, points, end = self._native, values[: problem.n], self._native.solve, self._points, self._end
        last: Kernel | None = getattr(self._last, "kernel", lambda _: None)(self._final)
        if last is not None:
            tolerances = ACTIVITY_TOLERANCE, VIOLATION_TOLERANCE
            native.below(last[3], last[1][: problem.n], problem.constraints, *tolerances)

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
            self._latest = self._exact
            if counts[0] not in BEGINS:
                return counts
            first = stages(x, points, end, 0, self._left())
            return counts if first < 0 else (UNSETTLED, *counts[1:])

        return alone, values, marks, self._native.after(call, x, points, end)

    def _from_head(self) -> Counts | None:
        """Stages from the exact answer of the levels above the one that was not met a tick ago.

        Far out of reach the exact answer of all levels is large, ill-conditioned and of no use.  None where that level
        is met by now, or the levels above have no optimum: the exact hierarchy decides.
        """
        if self._native is None:
            return None
        head, self._native.head = self._native.head, 0
        kernel = self._heads[head][1] if head in self._heads else self._make_head(head)
        if kernel is None:
            return None
        solve, values, *_ = kernel
        counts = solve()
        if counts[0] not in BEGINS:
            return None
        first = self._native.solve(values[: self._shape.n], self._points, self._end, head, self._left())
        return None if first < 0 else (UNSETTLED, *counts[1:])

    def _make_head(self, head: int) -> Kernel | None:
        plain = self._plain
        above = replace(
            plain, levels=plain.levels[:head], constraints=min(plain.constraints, head), n=self._shape.n, stacked=None
        )
        workspace = self._make(above.shape)
        _limit(workspace, self._seconds)
        kernel: Kernel | None = getattr(workspace, "kernel", lambda _: None)(above)
        self._heads[head] = workspace, kernel
        if kernel is not None and self._native is not None:
            self._native.above(head, kernel[3], kernel[1][: self._shape.n])
        return kernel

    @property
    def stages(self) -> tuple[Any, Mat] | None:
        """The native stages and the points ``(levels, n)`` of their latest solve; None where they are not native."""
        return None if self._native is None else (self._native, self._points)

    def tell(self) -> Vec | None:
        """Multipliers of the workspace that gave the latest answer; those of guards are among them after stages."""
        latest = self._latest
        if self._native is not None:
            _, settled, answered, _ = self._native.latest()
            latest = self._exact if settled else self._last if answered else latest
        told: Callable[[], Vec | None] = getattr(latest, "tell", lambda: None)
        return told()

    def answer(self, problem: Hierarchy, counts: Counts) -> Solution:
        """The solution of the latest solve of ``kernel``."""
        if counts[0] == UNSETTLED_NATIVE and self._native is not None:
            self._began = perf_counter() - self._native.latest()[-1]
        elif counts[0] != UNSETTLED:
            return self._priced(problem, self._exact.answer(self._plain, counts))  # type: ignore[attr-defined]
        return self._below(problem, Stats(*counts[1:3]), self._native_stages())

    def _priced(self, problem: Hierarchy, exact: Solution) -> Solution:
        """The exact solution, or that of the stages from the first level that it does not settle."""
        found = None
        if self._has_prices and self._begins(problem, exact):
            found = self._stages(problem, exact.x)
        elif self._native is not None:
            self._native.unasked()
        self._latest = self._exact
        return exact if found is None else self._below(problem, exact.stats, found)

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

    def _below(self, problem: Hierarchy, exact: Stats, found: Found) -> Solution:
        """The answer of the exact hierarchy that the stages leave."""
        stages, point, steps, final = found
        if self._native is not None and not self._native.effort()[1]:
            return self._stopped(problem, exact, found)
        self._latest = self._last
        if self._seconds:
            _limit(self._last, self._left())
        answer = self._last.solve(final)
        stats = Stats(
            exact.iterations + answer.stats.iterations + steps,
            exact.factorisations + answer.stats.factorisations,
            exact.build_s,
            perf_counter() - self._began,
        )
        # where the last solve ends without an answer, the last stage's point keeps to what every level handed down
        best = answer.x if answer.status.solved else point
        solution = finish(problem, best, answer.status, stats, answer.detail, stages, self._describe)
        uncertain = self._native is not None and self._native.effort()[2]
        return second_opinion(problem, solution) if uncertain and not self._seconds else solution

    def _stopped(self, problem: Hierarchy, exact: Stats, found: Found) -> Solution:
        """The point at which a stage was stopped: it keeps to what the levels above left."""
        _, point, steps, _ = found
        self._latest = None  # no multipliers: the stage has none yet
        status = Status.TIME_LIMIT if self._seconds else Status.ITERATION_LIMIT
        stats = Stats(exact.iterations + steps, exact.factorisations, exact.build_s, perf_counter() - self._began)
        return finish(problem, point, status, stats, describe=self._describe)

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
        return max(self._seconds - (perf_counter() - self._began), 1e-6) if self._seconds else 0.0

    def _describe(self, problem: Hierarchy, x: Vec) -> Described:
        """As hqp.solvers.base.describe, natively where the stages are."""
        if self._native is None:
            return describe(problem, x)
        slack, marks = np.empty(self._parts[-1].stop), np.empty(self._parts[-1].stop, dtype=np.int8)
        tolerances = ACTIVITY_TOLERANCE, VIOLATION_TOLERANCE
        broken = self._native.describe(x, problem.constraints, *tolerances, slack, marks)
        return tuple(slack[part] for part in self._parts), tuple(marks[part] for part in self._parts), broken

    def _bind(self, problem: Hierarchy) -> None:
        check_shape(problem, self._shape)
        self._problem = None  # until all of it is bound
        self._plain, self._has_prices = problem.exact(), any(problem.priced)
        self._heads.clear()
        if self._native is not None and self._has_prices:
            self._bind_stages(problem, self._native)
        self._problem = problem

    def _bind_stages(self, problem: Hierarchy, stages: NativeStages) -> None:
        """Bind the native stages to the arrays of a problem, and make the hierarchy that they leave."""
        priced = [bool(p) for p in problem.priced]
        below, handed = list[Rows](), list[tuple[Mat | None, Vec, Vec] | None]()
        for k, (rows, price) in enumerate(zip(problem.levels, priced, strict=True)):
            slowed = not any(priced[k:]) and problem.pace < math.inf and is_paced(problem, k)
            if price:
                below.append(own := room(rows, problem.n))
                handed.append((own.dense(problem.n), own.lower, own.upper))
            elif slowed:
                below.append(own := replace(rows, lower=rows.lower.copy(), upper=rows.upper.copy()))
                handed.append((None, own.lower, own.upper))
            else:
                below.append(rows)
                handed.append(None)
        self._final = replace(self._plain, levels=tuple(below), stacked=None)
        shares = problem.shares if problem.shares is not None else np.full(len(priced), SHARE)
        motion = problem.motion
        stages.bind(
            [row_arrays(rows) for rows in problem.levels],
            handed,
            np.ascontiguousarray(problem.prices),
            np.ascontiguousarray(shares),
            None if motion is None else motion.F,
            None if motion is None else motion.f,
            problem.guarded,
            problem.pace,
        )

    def _native_stages(self) -> Found:
        """What the latest native solve found."""
        steps = 0 if self._native is None else self._native.effort()[0]
        return self._points.copy(), self._end.copy(), steps, self._final

    def _stages(self, problem: Hierarchy, x: Vec) -> Found | None:
        """The stages from the first level that x does not settle; None where x settles all."""
        if self._native is not None:
            first = self._native.solve(x, self._points, self._end, 0, self._left())
            return None if first < 0 else self._native_stages()
        at = Coordinates.of(problem.motion, problem.n)
        start = first_unclear(problem, x, at)
        if start is None:
            return None
        stages = np.full((len(problem.levels), problem.n), np.nan)
        known = stages.copy()
        known[:start] = x  # levels above are met by x, which stands for the point of their stage
        for k in range(start, len(problem.levels)):
            if problem.priced[k]:
                price = stage_price(problem, known, k)
                x = self._by_secant(problem, at, feasible_set(problem, known, k, x, at), x, k, price)
                stages[k] = known[k] = x
            elif any(problem.priced[k + 1 :]):
                hard = feasible_set(problem, known, k, x, at)
                x = self._solve_exact(Hierarchy((hard, problem.levels[k]), constraints=1, n=problem.n), x)
        final = after_stages(problem, stages, at)
        levels = [
            room(rows, problem.n) if priced and rows.m == problem.levels[k].m else rows
            for k, (rows, priced) in enumerate(zip(final.levels, problem.priced, strict=True))
        ]
        return stages, x, 0, replace(final, levels=tuple(levels))

    def _by_secant(self, problem: Hierarchy, at: Coordinates, above: Rows, x: Vec, k: int, price: float) -> Vec:
        rows, n = problem.levels[k], problem.n
        size = longest_row(rows.dense(n))
        point, motion = x, at.level()

        def unmet(m: float) -> float:
            nonlocal point
            root = math.sqrt(m)
            level = stack_rows([rows, Rows(root * motion.dense(n), root * motion.lower, root * motion.upper)], n)
            point = self._solve_exact(Hierarchy((above, level), constraints=1), x)
            w = rows.slack(point)
            return float(np.sqrt(w @ w))

        if size == 0.0:
            return x
        found = multiplier(unmet, price, size, self._multipliers.get(k))
        if found is not None:
            self._multipliers[k] = found
        else:
            self._multipliers.pop(k, None)
            point = self._solve_exact(Hierarchy((above, rows, motion), constraints=1, n=n), x)
        return point

    def _solve_exact(self, problem: Hierarchy, otherwise: Vec) -> Vec:
        """The answer of an exact hierarchy, in a workspace kept for its shape."""
        shape = replace(problem.shape, inequalities=True)
        if shape not in self._workspaces:
            self._workspaces[shape] = self._make(shape)
        answer = self._workspaces[shape].solve(problem)
        return answer.x if np.isfinite(answer.x).all() else otherwise


def _limit(workspace: Workspace, seconds: float) -> None:
    getattr(workspace, "limit", lambda _: None)(seconds)


def stages_of(n: int, rows: Sequence[int], priced: Sequence[bool]) -> NativeStages:
    """Native stages of a hierarchy, to be bound to its arrays."""
    assert native_stages is not None
    tolerances = MET_TOLERANCE, SLACK_TOLERANCE, FLAT_TOLERANCE
    return native_stages.Stages(n, list(rows), [int(p) for p in priced], *tolerances)


def row_arrays(rows: Rows) -> tuple[object, ...]:
    """What the native stages read: (A, None, None) or (None, index, scale), then the bounds; live where they can be."""
    if isinstance(rows.A, Selection):
        index = np.ascontiguousarray(rows.A.index, dtype=np.int64)
        return None, index, np.ascontiguousarray(rows.A.scale), rows.lower, rows.upper
    return rows.A, None, None, rows.lower, rows.upper
