"""The working set: block exchange while it pays, then lexicographic descent by single changes."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Signs, Vec
from hqp.problem import Status
from hqp.solvers.lexicographic_reference.equality import Point, Wrong, equality_point, judge
from hqp.solvers.lexicographic_reference.step import Step
from hqp.solvers.lexicographic_reference.table import Box, Table

if TYPE_CHECKING:
    from hqp.solvers.lexicographic import Lexicographic

NEAR = 100.0
"""A pivot within this factor of the rank tolerance makes the rank uncertain."""

LOOSEST = 1e-6
"""Beyond it the rank tolerance is not raised where working sets repeat because of it."""

REPEATS = 20
"""So often may the working sets repeat before the search is given up."""

SAME = 1e-9
"""Slacks nearer than this, relative to 1 + slack, are no progress."""


class _Capped(Exception):
    """A cap was met."""


class ActiveSet:
    """W ``(M,)`` marks working rows, F ``(n,)`` variables held at a bound; x is the best point so far."""

    def __init__(self, table: Table, options: Lexicographic, warm: tuple[Signs, Signs] | None, begin: float) -> None:
        self.table, self.options = table, options
        self.W, self.F = self._start(warm)
        self.x: Vec = table.box.clip(np.zeros(table.A.shape[1]))
        self.factorisations = 0
        self._doubted, self._repeats = np.inf, 0
        self.status = Status.OPTIMAL
        self.shifted = self.uncertain = False
        self.point: Point | None = None
        self._cap = options.max_iterations or 100 + 10 * (table.M + self.x.size)
        self._deadline = np.inf if options.deadline is None else begin + options.deadline

    def run(self) -> None:
        """To the optimum, or to a cap with its status."""
        try:
            if not self._block_exchange():
                self._descend()
        except _Capped as cap:
            self.status = cap.args[0]

    def _start(self, warm: tuple[Signs, Signs] | None) -> tuple[Signs, Signs]:
        table, box = self.table, self.table.box
        W, F = table.start.copy(), np.where(box.fixed, 1, 0).astype(np.int8)
        if warm is not None:
            last, held = warm
            bound = np.where(last == -1, table.lower, table.upper)
            keep = table.usable & (abs(last) == 1) & np.isfinite(bound)
            W[keep] = last[keep]
            edge = np.where(held < 0, box.lo, box.hi)
            keep_x = ~box.fixed & (held != 0) & np.isfinite(edge)
            F[keep_x] = held[keep_x]
        return W, F

    def _solve(self) -> Point:
        if self.factorisations and perf_counter() > self._deadline:
            raise _Capped(Status.TIME_LIMIT)
        if self.factorisations >= self._cap:
            raise _Capped(Status.ITERATION_LIMIT)
        self.factorisations += 1
        self.point = equality_point(self.table, self.W, self.F, self.options)
        self._doubted = min(self._doubted, self.point.closest)
        return self.point

    def room(self, bound: Vec, size: float, norm: Vec | float = 1.0) -> Vec:
        """How far past a bound still counts as on it."""
        finite = np.where(np.isfinite(bound), abs(bound), 0.0)
        return np.asarray(self.options.feasibility_tolerance * (finite + norm * size))

    def _violations(self, point: Point) -> tuple[Signs, Signs]:
        """Sides of the rows and variables outside the working set that the point violates."""
        t, box, size = self.table, self.table.box, self.table.span(point.x)
        above = point.value > t.upper + self.room(t.upper, size, t.norm)
        below = point.value < t.lower - self.room(t.lower, size, t.norm)
        rows = np.where(t.usable & (self.W == 0), above.astype(np.int8) - below, 0)
        over = point.x > box.hi + self.room(box.hi, size)
        under = point.x < box.lo - self.room(box.lo, size)
        variables = np.where(self.F == 0, over.astype(np.int8) - under, 0)
        return rows.astype(np.int8), variables.astype(np.int8)

    def _accept(self, point: Point) -> None:
        self.x = self.table.box.clip(point.x)
        self.shifted = point.shifted
        if point.closest < NEAR or self.uncertain:
            self.status = Status.RANK_UNCERTAIN

    def _block_exchange(self) -> bool:
        """Swap everything violated or wrong-signed at once; False once that no longer lessens the trouble."""
        credit, best = self.options.exchange_credit, 1 << 30
        start, slacks = (self.W, self.F), np.full(len(self.table.levels), np.inf)
        while True:
            point = self._solve()
            rows, variables = self._violations(point)
            wrong = judge(self.table, self.W, self.F, point, self.options)
            trouble = int(np.count_nonzero(rows) + np.count_nonzero(variables)) + len(wrong)
            if not trouble:
                self._accept(point)
                return True
            W, F = np.where(rows != 0, rows, self.W), np.where(variables != 0, variables, self.F)
            x = self.table.box.clip(point.x)
            value = self.table.A @ x
            missed = np.array([self.table.missed(k, value) for k in range(len(slacks))])
            if _better(missed, slacks):
                start, slacks, self.x = (W.copy(), F.copy()), missed, x
            credit -= int(trouble >= best)
            best = min(best, trouble)
            if credit < 0 or trouble > 2 * best:
                self.W, self.F = start
                return False
            self.W, self.F = W, F
            for item in wrong:
                self._release(item)

    def _release(self, item: Wrong) -> None:
        if item.variable:
            self.F[item.index] = 0
        else:
            self.W[item.index] = 0

    def _descend(self) -> None:
        """From the best point so far: x stays in the box, and no level rises for the sake of a lower one."""
        seen: set[bytes] = set()
        silent: set[tuple[int, bool, int]] = set()
        released: list[Wrong] = []
        rank, original = 0, None
        while True:
            step = Step(self.table, self, self._solve_from_here())
            level = released[0].level if released else step.level
            if step.level > level and step.point.chain[level].s.size <= rank:  # by its rank it has no say in them
                silent |= {(item.level, item.variable, item.index) for item in released}
                self.uncertain = True
            released = []
            if not step.take():
                continue
            point = step.point
            self.x = self.table.box.clip(point.x)
            if any(side.any() for side in self._violations(point)):
                continue
            wrong = judge(self.table, self.W, self.F, point, self.options, silent)
            if not wrong:
                if original is None:
                    self._accept(point)
                    return
                self._undisturb(*original)
                original = None
                continue
            key = self.W.tobytes() + self.F.tobytes()
            if key in seen:
                seen.clear()
                if self._get_unstuck():
                    original = self._disturb()
                    continue
                if self._repeats > REPEATS:
                    self.status = Status.NOT_CERTIFIED
                    return
            seen.add(key)
            released = self._release_some(wrong, careful=self._repeats > 0)
            rank = point.chain[released[0].level].s.size

    def _get_unstuck(self) -> bool:
        """The working sets repeat: single changes, then a rank that comes and goes is let go; True to widen bounds."""
        doubted, self._doubted = self._doubted < NEAR, np.inf
        if self._repeats and doubted and self.options.rank_tolerance < LOOSEST:
            rank_tolerance = 10.0 * self.options.rank_tolerance
            self.options = replace(  # signs of directions given up are not heard
                self.options, rank_tolerance=rank_tolerance, multiplier_tolerance=10.0 * rank_tolerance
            )
            self.uncertain = True
            return False
        self._repeats += 1
        return self._repeats == 3

    def _release_some(self, wrong: list[Wrong], careful: bool) -> list[Wrong]:
        """At the highest level held back: the strongest and those at least half as strong, or one by index."""
        level = min(item.level for item in wrong)
        wrong = [item for item in wrong if item.level == level]
        if careful:
            wrong = [min(wrong, key=lambda item: (not item.variable, item.index))]
        most = max(item.size for item in wrong)
        wrong = [item for item in wrong if item.size >= 0.5 * most]
        for item in wrong:
            self._release(item)
        return wrong

    def _solve_from_here(self) -> Point:
        """Rows violated at x work at their side, rows well inside do not; then solve."""
        t, size = self.table, self.table.span(self.x)
        value = t.A @ self.x
        above, below = self.room(t.upper, size, t.norm), self.room(t.lower, size, t.norm)
        inside = ((self.W == 1) & (value < t.upper - above)) | ((self.W == -1) & (value > t.lower + below))
        self.W[t.usable & inside] = 0
        self.W[t.usable & (value > t.upper + above)] = 1
        self.W[t.usable & (value < t.lower - below)] = -1
        return self._solve()

    def _disturb(self) -> tuple[Vec, Vec, Box]:
        """Last resort against a degenerate vertex: widen every inequality by a tiny amount of its own."""
        t, rng = self.table, np.random.default_rng(7)
        size, kept = self.table.span(self.x), (t.lower, t.upper, t.box)
        widen = np.where(t.usable, 1e-9 * rng.uniform(0.5, 1.0, t.M) * t.norm * size, 0.0)
        widen_x = np.where(t.box.fixed, 0.0, 1e-9 * rng.uniform(0.5, 1.0, self.x.size) * size)
        t.lower, t.upper = t.lower - widen, t.upper + widen
        t.box = Box(t.box.lo - widen_x, t.box.hi + widen_x, t.box.taken)
        self.x = np.where(self.F > 0, t.box.hi, np.where(self.F < 0, t.box.lo, self.x))
        return kept

    def _undisturb(self, lower: Vec, upper: Vec, box: Box) -> None:
        self.table.lower, self.table.upper, self.table.box = lower, upper, box
        self.x = box.clip(self.x)


def _better(slacks: Vec, best: Vec) -> bool:
    """Whether slacks are lexicographically smaller; the last level, the least norm, does not count."""
    for new, old in zip(slacks[:-1], best[:-1], strict=True):
        same = SAME * (1.0 + min(new, old))
        if abs(new - old) > same:
            return bool(new < old)
    return False
