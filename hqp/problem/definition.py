"""The definition as a program: one level after the other, single changes, no history; allowed to be slow.

Level k is min ||T v - t||^2 over the points v = (y, slacks) that the levels above leave, y the coordinates of motion,
solved by a primal active-set method from the point of the level above (Nocedal and Wright 2006, chapter 16).  At a
point, the least residual r of the optimality conditions over multipliers mu >= 0 of the active rows (non-negative
least squares, Lawson and Hanson 1974) is zero at the optimum only; elsewhere -r is a feasible descent direction, at
degenerate vertices too.  The step goes to the minimiser on the face that -r stays on, the shortest where T is flat.

A level with a price is min ||w|| + c (E + R) (hqp.problem.pricing): min 1/2 ||w||^2 + m c (E + R) with the m at which
m = ||w||, found on log m.  Rows of an anchored level, 1/2 ||A (x - x_a)||^2 / give, are hard rows A x - s v = A x_a
with s^2 = give / m and 1/2 ||v||^2 to pay, as give may be 1e-12.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hqp.arrays import Mask, Mat, Vec, longest_row, row_lengths
from hqp.problem import Hierarchy, Rows
from hqp.problem.completion import completion
from hqp.problem.nnls import nonnegative_least_squares
from hqp.problem.pricing import UNNAMED, Above, Coordinates, at_optimum, row_sizes, stack_rows
from hqp.tolerances import MET_TOLERANCE, RANK_TOLERANCE, ROUNDING

HELD, ALONG = 1e-11, 1e-9
"""Active: a row this close to its bound, relative to its terms.  Along it: a unit direction of less than this rate."""

OPTIMAL, FLAT = 1e-13, 1e-9
"""Relative residual of the optimality conditions of an optimal point, and of one whose last step lowered nothing."""

ROOT = 1e-12
"""m is found to this relative accuracy."""


@dataclass(frozen=True)
class Limits:
    """When a level ends: singular values below rank_tolerance times its largest row add no direction, max_iterations
    steps of a level, factorisations of a whole problem, None for any number."""

    rank_tolerance: float = RANK_TOLERANCE
    max_iterations: int = 1000
    factorisations: int | None = None


def solve_level(rows: Rows, above: Above, x: Vec, price: float, at: Coordinates, limits: Limits | None = None) -> Vec:
    """The stage point of one level below what the levels above handed down, from a point x of S."""
    return Levels(Hierarchy((rows,), n=x.size), limits or Limits(), at).level(rows, above, x, price)


class Levels:
    """One problem: the coordinates of its motion, the steps taken, and whether every level ended."""

    def __init__(self, problem: Hierarchy, limits: Limits, at: Coordinates | None = None) -> None:
        self.problem, self._limits = problem, limits
        self._at = at or Coordinates.of(problem.motion, problem.n)
        self.steps, self.ended, self._effort = 0, True, _Effort(limits.factorisations)
        self._zero = ROUNDING * max((longest_row(rows.dense(problem.n)) for rows in problem.levels), default=0.0)

    def points(self) -> Mat:
        """The stage point of every level and, last, the answer: ``(levels + 1, n)``."""
        problem, above, points = self.problem, Above.none(self.problem.n), [np.zeros(self.problem.n)]
        for k, rows in enumerate(problem.levels):
            price = 0.0 if problem.prices is None else float(problem.prices[k])
            points.append(self.level(rows, above, points[-1], price))
            above = above.after(problem, k, points[-1], self._at)
        x = points[-1]
        above = above.completed(x, bool(problem.priced) and problem.priced[-1], self._at)
        for rows in completion(problem):
            x = self.level(rows, above, x, 0.0)
            above = above.with_rows(at_optimum(rows, x), UNNAMED)
        return np.array([*points[1:], x])

    def level(self, rows: Rows, above: Above, x: Vec, price: float) -> Vec:
        """The stage point of a level, from a point of S."""
        if longest_row(rows.dense(x.size)) <= self._zero:
            rows = Rows(np.zeros((0, x.size)), np.zeros(0), np.zeros(0))
            return self._search(rows, above, x, 1.0, price > 0.0) if above.anchors or price > 0.0 else x
        return self._priced(rows, above, x, price) if price > 0.0 else self._search(rows, above, x, 1.0)

    def _priced(self, rows: Rows, above: Above, x: Vec, price: float) -> Vec:
        """argmin ||w|| + c (E + R) by root finding on log m; min E + R where the level is met for its price."""
        point = x

        def unmet(m: float) -> float:
            nonlocal point
            point = self._search(rows, above, x, m * price, moves=True)
            w = rows.slack(point)
            return float(np.sqrt(w @ w))

        if _root(unmet, max(MET_TOLERANCE * float(row_sizes(rows, x).max(initial=0.0)), 1e-300)) is not None:
            return point
        x = self._search(rows, replace(above, anchors=()), x, 1.0)
        met = above.with_rows(at_optimum(rows, x), UNNAMED)
        nothing = Rows(np.zeros((0, x.size)), np.zeros(0), np.zeros(0))
        return self._search(nothing, met, x, 1.0, moves=True)

    def _search(self, rows: Rows, above: Above, x: Vec, m: float, moves: bool = False) -> Vec:
        """argmin 1/2 ||w||^2 + m (E + R) over S, from a point x of it; m R without ``moves``."""
        n, at = x.size, self._at
        A, unequal = rows.dense(n), ~rows.equality & (np.isfinite(rows.lower) | np.isfinite(rows.upper))
        B, b = A[rows.equality], rows.lower[rows.equality]
        soft = [(A[unequal], rows.lower[unequal], rows.upper[unequal], 1.0)]
        T, t = [at.rows(B)], [b - B @ at.still]
        if moves:
            T.append(math.sqrt(m) * np.eye(at.moving, n))
            t.append(np.zeros(at.moving))
        for anchor in above.anchors:
            soft.append((anchor.A, anchor.rows.lower, anchor.rows.upper, math.sqrt(anchor.give / m)))
            turning = math.sqrt(m) * anchor.turning
            T.append(at.rows(turning))
            t.append(turning @ (anchor.x - at.still))
        sizes = [lower.size for _, lower, _, _ in soft]
        q = sum(sizes)
        left = np.concatenate(T)
        size = max(longest_row(A), longest_row(left))
        whole = np.block([[left, np.zeros((len(left), q))], [np.zeros((q, n)), np.eye(q)]])
        if not whole.size or (size <= self._zero and not q):
            return x
        hard = stack_rows([above.hard, *(Rows(C, lower, upper) for C, lower, upper, _ in soft)], n)
        dense = hard.dense(n)
        minus = -np.repeat([s for *_, s in soft], sizes)
        C = np.concatenate([at.rows(dense), np.eye(hard.m, q, -above.hard.m) * minus], axis=1)
        shift = dense @ at.still
        program = _Program(
            whole,
            np.concatenate([*t, np.zeros(q)]),
            C,
            hard.lower - shift,
            hard.upper - shift,
            self._limits.rank_tolerance * (longest_row(A) or size),
        )
        off = np.concatenate([Rows(C, lower, upper).slack(x) / s for C, lower, upper, s in soft])
        start = np.concatenate([at.of_point(x), off])
        v, steps, ended = program.solve(start, self._limits.max_iterations, self._effort)
        self.steps, self.ended = self.steps + steps, self.ended and ended
        return at.point(v[:n])


def _root(unmet: Callable[[float], float], least: float) -> float | None:
    """The m with m = ||w(m)||, None where it is below ``least``; the last call of ``unmet`` is at it.

    unmet: ||w(m)|| of argmin 1/2 ||w||^2 + m c (E + R), which grows with m more slowly than m does.
    """

    def excess(log: float) -> float:
        return log - math.log(max(unmet(math.exp(log)), 1e-300))

    low = math.log(least)
    if (close := excess(low)) >= 0.0:
        return None
    high = low + 4.0
    while (far := excess(high)) < 0.0:
        low, close, high = high, far, 2.0 * high - low + 4.0
    guess = high
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


class _Effort:
    """How many singular value decompositions are left."""

    __slots__ = ("left",)

    def __init__(self, most: int | None) -> None:
        self.left = math.inf if most is None else most

    @property
    def spent(self) -> bool:
        """Whether none is."""
        return self.left <= 0


class _Program:
    """min ||T v - t||^2 over lower <= C v <= upper, from a point of that set; singular values below cut are zero."""

    def __init__(self, T: Mat, t: Vec, C: Mat, lower: Vec, upper: Vec, cut: float) -> None:
        lengths = row_lengths(C)
        real = (lengths > 1e-13 * lengths.max(initial=0.0)) & ((lower > -np.inf) | (upper < np.inf))
        scale = lengths[real]
        self.T, self.t, self.cut = T, t, cut
        self.C, self.lower, self.upper = C[real] / scale[:, None], lower[real] / scale, upper[real] / scale
        self.equal = self.lower == self.upper
        self.Z = _null_space(self.C[self.equal])

    def solve(self, v: Vec, limit: int, effort: _Effort) -> tuple[Vec, int, bool]:
        """The optimum, how many steps it took, and whether it was reached."""
        lowest = math.inf
        for step in range(limit):
            if effort.spent:
                return v, step, False
            w = self.T @ v - self.t
            direction, held, gap = self._descent(v, w)
            value = float(np.sqrt(w @ w))
            if gap <= OPTIMAL or (gap <= FLAT and value >= lowest):
                return v, step, True
            lowest = min(lowest, value)
            before, v = v, self._advance(v, direction, held, gap > FLAT and value > FLAT, effort)
            if np.array_equal(before, v):  # the multipliers are known no better: the certificate has the last word
                return v, step, False
        return v, limit, False

    def _sides(self, v: Vec) -> Vec:
        """+1 at upper, -1 at lower, 0 elsewhere and for equalities."""
        value = self.C @ v
        reach = HELD * (1.0 + np.abs(self.C) @ np.abs(v))
        side = np.where(value >= self.upper - reach, 1.0, np.where(value <= self.lower + reach, -1.0, 0.0))
        return np.where(self.equal, 0.0, side)

    def _descent(self, v: Vec, w: Vec) -> tuple[Vec, Mask, float]:
        """The steepest feasible direction, which rows it stays on, and its length relative to the gradient's terms."""
        side = self._sides(v)
        held, active = np.zeros(side.size, dtype=bool), np.flatnonzero(side)
        pull = -(w @ self.T @ self.Z)
        cone = (side[active, None] * self.C[active] @ self.Z).T
        left = pull - cone @ nonnegative_least_squares(cone, pull)
        size = float(np.sqrt(left @ left))
        terms = longest_row(self.T) * float(np.max(np.abs(self.T) @ np.abs(v) + np.abs(self.t), initial=0.0))
        held[active] = left @ cone >= -HELD * size
        return self.Z @ left, held, size / max(terms, 1e-300)

    def _advance(self, v: Vec, direction: Vec, held: Mask, steep: bool, effort: _Effort) -> Vec:
        """To the minimiser on the face of the held rows or the first row in the way; at it, down a steep direction."""
        face, side = held.copy(), self._sides(v)
        while not effort.spent:
            effort.left -= 1
            Z = self.Z @ _null_space(self.C[face] @ self.Z)
            U, sigma, Vt = np.linalg.svd(self.T @ Z, full_matrices=False)
            kept = sigma > self.cut
            step = Z @ (Vt[kept].T @ ((self.t - self.T @ v) @ U[:, kept] / sigma[kept]))
            far, row = self._room(v, step, face)
            here = steep and np.abs(step).max() <= 1e-13 * np.abs(v).max()
            against = far < ALONG and side[row] != 0.0  # an active row: the room that it leaves is rounding
            if far > 1e-14 and not here and not against:
                return np.asarray(v + min(1.0, far) * step)
            if row < 0 or here or not kept.any():  # the face has its minimum at v
                break
            face[row] = True
        curvature = self.T @ direction
        best = float((self.t - self.T @ v) @ curvature) / max(float(curvature @ curvature), 1e-300)
        along = np.abs(self.C @ direction) <= ALONG * float(np.sqrt(direction @ direction))
        return np.asarray(v + min(best, self._room(v, direction, held & along)[0]) * direction)

    def _room(self, v: Vec, step: Vec, held: Mask) -> tuple[float, int]:
        """How many times the step fits, and the row in the way, -1 for none."""
        value, rate = self.C @ v, self.C @ step
        rate[held | self.equal] = 0.0
        floor = HELD * float(np.abs(step).max(initial=0.0))
        room = np.where(rate > floor, self.upper - value, np.where(rate < -floor, self.lower - value, np.inf))
        times = np.maximum(np.divide(room, rate, out=np.full(rate.size, np.inf), where=np.abs(rate) > floor), 0.0)
        row = int(np.argmin(times)) if times.size else -1
        return (float(times[row]), row) if row >= 0 and times[row] < np.inf else (np.inf, -1)


def _null_space(A: Mat) -> Mat:
    """An orthonormal basis ``(n, r)`` of what rows of unit length leave; singular values below 1e-10 count as zero."""
    _, sigma, Vt = np.linalg.svd(A, full_matrices=True)
    return np.asarray(Vt[int(np.count_nonzero(sigma > 1e-10)) :].T)
