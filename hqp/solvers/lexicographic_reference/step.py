"""One step of the descent: towards the working set's solution until something blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from hqp.arrays import Vec
from hqp.solvers.lexicographic_reference.equality import Point
from hqp.solvers.lexicographic_reference.table import Table

if TYPE_CHECKING:
    from hqp.solvers.lexicographic_reference.active_set import ActiveSet


_Blocking: TypeAlias = tuple[str, int]

LENGTHS = (0.2, 0.04, 0.008)
"""Parts of a step at the top level that are tried clipped into the box."""


class Step:
    """From x along d = point.x - x; a blocking bound joins the working set."""

    def __init__(self, table: Table, owner: ActiveSet, point: Point) -> None:
        self.table, self.owner, self.point = table, owner, point
        self.d = point.x - owner.x
        self.value = table.A @ owner.x
        self.change = point.value - self.value
        self.size = table.span(point.x)
        self.level = self._level()

    def take(self) -> bool:
        """Move x; True if the whole step was taken."""
        t, owner = self.table, self.owner
        level = self.level
        alpha, blocking = self._variables()
        above = t.usable & (owner.W == 0) & (t.level < level)
        ratio, row = self._rows(above)
        if ratio < alpha:
            alpha, blocking = ratio, ("row", row)
        if level < len(t.levels):
            alpha, blocking = self._bend(level, alpha, blocking)
        if blocking is None:
            return True
        if level == 0 and self._project(alpha):
            return False
        owner.x = np.where(owner.F == 0, t.box.clip(owner.x + alpha * self.d), owner.x)
        kind, index = blocking
        if kind == "row":
            owner.W[index] = 1 if self.change[index] > 0.0 else -1
        elif kind == "variable":
            owner.F[index] = 1 if self.d[index] > 0.0 else -1
            owner.x[index] = t.box.hi[index] if self.d[index] > 0.0 else t.box.lo[index]
        return False

    def _project(self, alpha: float) -> bool:
        """At the top level only the box blocks: a longer step, clipped into it, if that lowers the level more."""
        t, owner = self.table, self.owner
        straight = t.missed(0, self.value + alpha * self.change)
        for a in LENGTHS:
            if a <= 2.0 * alpha:
                return False
            end = np.where(owner.F == 0, owner.x + a * self.d, owner.x)
            x = t.box.clip(end)
            if t.missed(0, t.A @ x) < straight:
                owner.x = x
                owner.F = np.where(owner.F == 0, (end > t.box.hi).astype(np.int8) - (end < t.box.lo), owner.F)
                return True
        return False

    def _level(self) -> int:
        """The first level that the step changes: those above must not suffer, those below do not count."""
        t, W = self.table, self.owner.W
        length = float(np.sqrt(self.d @ self.d)) + 1e-3 * t.span(self.owner.x)
        for k, rows in enumerate(t.levels):
            change = self.change[rows[W[rows] != 0]]
            if np.sqrt(change @ change) > max(1e-9 * t.scale[k], t.rounding[k]) * length:
                return k
        return len(t.levels)

    def _variables(self) -> tuple[float, _Blocking | None]:
        """Where the first free variable meets its bound, 1.0 if none does."""
        box, d = self.table.box, self.d
        bound = np.where(d > 0.0, box.hi, box.lo)
        over = np.where(d > 0.0, self.point.x - bound, bound - self.point.x)
        hit = np.flatnonzero((self.owner.F == 0) & (d != 0.0) & (over > self.owner.room(bound, self.size)))
        if not hit.size:
            return 1.0, None
        ratio = np.maximum(0.0, (bound[hit] - self.owner.x[hit]) / d[hit])
        first = int(ratio.argmin())
        return float(ratio[first]), ("variable", int(hit[first]))

    def _rows(self, candidates: Vec) -> tuple[float, int]:
        """Where the first of some rows meets its bound, infinity if none is violated at the end."""
        t, change = self.table, self.change
        bound = np.where(change > 0.0, t.upper, t.lower)
        over = np.where(change > 0.0, self.point.value - bound, bound - self.point.value)
        hit = np.flatnonzero(candidates & (change != 0.0) & (over > self.owner.room(bound, self.size, t.norm)))
        if not hit.size:
            return np.inf, -1
        ratio = np.maximum(0.0, (bound[hit] - self.value[hit]) / change[hit])
        first = int(ratio.argmin())
        return float(ratio[first]), int(hit[first])

    def _bend(self, level: int, alpha: float, blocking: _Blocking | None) -> tuple[float, _Blocking | None]:
        """Rows of the level itself that the step would violate make its norm bend: stop where it is lowest.

        Where that is at once, by rounding, the first of them joins the working set instead.
        """
        first, row = self._rows(self.table.usable & (self.owner.W == 0) & (self.table.level == level))
        if row >= 0:
            lowest = self._lowest(level, alpha)
            if 1e-12 < lowest < alpha:
                return lowest, ("bend", level)
            if lowest <= 1e-12 and first <= alpha:
                return first, ("row", row)
        return alpha, blocking

    def _lowest(self, level: int, alpha: float) -> float:
        """Where ||w_level||^2, a convex piecewise quadratic along the step, is lowest on [0, alpha]."""
        t, rows = self.table, self.table.levels[level]
        start, change, lower, upper = self.value[rows], self.change[rows], t.lower[rows], t.upper[rows]

        def slope(a: float) -> float:
            value = start + a * change
            return float(change @ (value - np.minimum(np.maximum(value, lower), upper)))

        if slope(alpha) <= 1e-12 * abs(slope(0.0)):
            return alpha
        moving = t.usable[rows] & (change != 0.0)
        kinks = np.concatenate([(upper - start)[moving] / change[moving], (lower - start)[moving] / change[moving]])
        low, high = 0.0, alpha
        for kink in np.sort(kinks[(kinks > 0.0) & (kinks < alpha)]):
            if slope(float(kink)) >= 0.0:
                high = float(kink)
                break
            low = float(kink)
        a, b = slope(low), slope(high)
        bottom = low - (high - low) * a / (b - a) if b > a else high
        return max(bottom, 0.0) if bottom < alpha * (1.0 - 1e-12) else alpha
