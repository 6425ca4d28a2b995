"""From an answer of limited accuracy to the exact one: guess its active set, solve it as equalities, check the signs.

With every active or violated inequality row taken as an equality of its own level the hierarchy is solved by one
recursion.  The guess was right, and x is the optimum, when no row left out is violated and every row taken in has a
multiplier vector (lambda at its own level, at the next, ...) whose first non-zero entry points out of the row's side.
Rows that fail are exchanged, all at once a few times, then by a primal active set along which no level gets worse
before a more important one gets better; an answer that cannot be confirmed is left as it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Index, Mask, Signs, Vec, row_lengths
from hqp.solvers.flat import Flat
from hqp.solvers.recursion import Recursion
from hqp.tolerances import MET_TOLERANCE, ROUNDING

BLOCK = 4
"""Number of exchanges of all failing rows at once; then one at a time, never losing ground."""

TINY = 1e-300


@dataclass(frozen=True, slots=True)
class Refined:
    """The outcome: x, whether every sign confirmed it, how many exchanges of rows that took."""

    x: Vec
    confirmed: bool
    exchanges: int
    uncertain: bool


class Refiner:
    """Works on a Flat with its completion; keeps the recursion's buffers."""

    def __init__(self, flat: Flat, rank_tolerance: float, exchanges: int) -> None:
        self.flat, self.exchanges = flat, exchanges
        self.recursion = Recursion(flat.shape.n, rank_tolerance)
        self._determined = False  # true if the levels alone determined the last optimum

    def refine(self, x: Vec, nearness: float) -> Refined:
        """The optimum near x, if the signs confirm one within the exchanges allowed; x itself otherwise.

        nearness: rows this close to a bound, relative to their terms, are first guessed to be active.
        """
        if not np.isfinite(x).all():
            x = np.zeros_like(x)
        self._measure()
        start = self._guess(x, nearness)
        sides, count = start, 0
        for count in range(min(BLOCK, self.exchanges) + 1):
            found, wrong = self._optimum(sides)
            above, below = self._violated(found, sides)
            if not wrong.size and not above.any() and not below.any():
                return Refined(found, True, count, self.recursion.uncertain)
            sides = sides.copy()
            sides[above], sides[below] = 1, -1
            sides[wrong] = 0
        return self._descend(x, start, count)

    def _descend(self, x: Vec, sides: Signs, count: int) -> Refined:
        """Monotone primal active set: to the first row in the way, or drop one wrong row where none is."""
        begin, sides, dropped = x, sides.copy(), -1
        stuck = np.zeros(sides.size, dtype=bool)
        above, below = self._violated(x, sides)
        sides[above], sides[below] = 1, -1
        for count in range(count, self.exchanges):  # noqa: B020
            found, wrong = self._optimum(sides)
            step, row, side = self._blocking(x, found - x, sides)
            wrong = wrong[~stuck[wrong]]
            if row >= 0:
                x = x + step * (found - x)
                sides[row] = side
                stuck[row] = row == dropped and step < MET_TOLERANCE  # its sign is within rounding: it stays
            elif wrong.size:
                x, dropped = found, int(wrong[0])
                sides[dropped] = 0
            else:
                return Refined(found, not stuck.any(), count, self.recursion.uncertain)
        return Refined(begin, False, count, self.recursion.uncertain)

    def _measure(self) -> None:
        flat = self.flat
        self._lengths = row_lengths(flat.A)
        starts = [0, *flat.stops]
        self._longest = np.array(
            [self._lengths[a:z].max(initial=0.0) for a, z in zip(starts, flat.stops, strict=False)]
        )
        self._longest[self._longest <= ROUNDING * self._longest.max(initial=0.0)] = np.inf  # ignored in every sign

    def _guess(self, x: Vec, nearness: float) -> Signs:
        flat = self.flat
        value = flat.A @ x
        reach = nearness * (self._lengths + np.abs(flat.A) @ np.abs(x))
        sides: Signs = (value >= flat.upper - reach).astype(np.int8)
        sides[(value <= flat.lower + reach) & (sides == 0)] = -1
        sides[~flat.inequality] = 0
        return sides

    def _optimum(self, sides: Signs) -> tuple[Vec, Index]:
        """x with the rows at ``sides`` as equalities, and those of them that pull from the wrong side.

        The completion is left out while the levels leave nothing to choose and every sign is theirs.
        """
        flat, own = self.flat, len(self.flat.shape.rows)
        taken = flat.equality | (sides != 0)
        counts = np.concatenate([[0], np.cumsum(taken)])
        stops = [int(counts[stop]) for stop in flat.stops]
        rows = np.flatnonzero(taken)
        target = np.where(sides < 0, flat.lower, flat.upper)[rows]
        levels = own if self._determined else len(stops)
        while True:
            part = rows[: stops[levels - 1]] if levels else rows[:0]
            A, b = flat.A[part], target[: part.size]
            self.recursion.solve(A, b, stops[:levels])
            x = self.recursion.point()
            wrong, undecided = self._wrong(A @ x - b, stops[:levels], part, sides, x)
            self._determined = not undecided and sum(self.recursion.ranks[:own]) == flat.shape.n
            if self._determined or levels == len(stops):
                return x, wrong
            levels = len(stops)

    def _violated(self, x: Vec, sides: Signs) -> tuple[Mask, Mask]:
        """Rows left out that x violates, above and below."""
        flat = self.flat
        value = flat.A @ x
        slop = MET_TOLERANCE * (self._lengths + np.abs(flat.A) @ np.abs(x))
        out = flat.inequality & (sides == 0)
        return out & (value > flat.upper + slop), out & (value < flat.lower - slop)

    def _blocking(self, x: Vec, d: Vec, sides: Signs) -> tuple[float, int, int]:
        """Return the step length of x along d, and the blocking row with its side, -1 if there is none."""
        flat = self.flat
        value, rate = flat.A @ x, flat.A @ d
        slop = MET_TOLERANCE * (self._lengths + np.abs(flat.A) @ np.abs(x + d))
        out = flat.inequality & (sides == 0)
        up = out & (value + rate > flat.upper + slop)
        down = out & (value + rate < flat.lower - slop)
        steps = np.full(rate.size, np.inf)
        gone = np.where(up, flat.upper - value, np.where(down, flat.lower - value, 0.0))
        steps[up | down] = np.divide(gone, rate, out=np.zeros(rate.size), where=rate != 0.0)[up | down]
        row = int(np.argmin(steps)) if steps.size else -1
        if row < 0 or not steps[row] < np.inf:
            return 1.0, -1, 0
        return max(0.0, float(steps[row])), row, 1 if up[row] else -1

    def _wrong(self, residual: Vec, stops: list[int], rows: Index, sides: Signs, x: Vec) -> tuple[Index, bool]:
        """Rows whose first non-zero multiplier has the wrong sign, most important level first.

        Also return true if a row has only zeros at the problem's own levels, so that the completion decides.
        """
        signed = np.flatnonzero(sides[rows])
        if not signed.size:
            return signed, False
        own, side = self.flat.level[rows[signed]], sides[rows[signed]]
        L = self.recursion.multipliers(residual, stops)[signed] * side[:, None]
        size = 1.0 + float(np.abs(x).max(initial=0.0))
        # a multiplier times its row's length is a share of its level's gradient, whose scale is r_k (r_k size + max|w|)
        worst = np.array([np.abs(residual[a:z]).max(initial=0.0) for a, z in zip([0, *stops], stops, strict=False)])
        longest = self._longest[: len(stops)]
        scale = longest * (longest * size + worst)
        pull = L * self._lengths[rows[signed], None] / np.maximum(scale, TINY)
        each = np.arange(own.size)
        pull[each, own] = L[each, own] / np.maximum(longest[own] * size, TINY)
        pull[np.abs(pull) <= MET_TOLERANCE] = 0.0
        first = np.argmax(pull != 0.0, axis=1)
        decisive = pull[each, first]
        bad = np.flatnonzero(decisive < 0.0)
        undecided = bool(np.any((decisive == 0.0) | (first >= len(self.flat.shape.rows))))
        return np.asarray(rows[signed[bad[np.lexsort((decisive[bad], first[bad]))]]]), undecided
