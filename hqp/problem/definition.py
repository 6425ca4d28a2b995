"""The definition as a program: one level after the other, single changes, no history; allowed to be slow.

Level k is min ||T v - t||^2 over the points v = (y, slacks) that the levels above leave, y the coordinates of motion,
solved by a primal active-set method from the point of the level above (Nocedal and Wright 2006, chapter 16).  At a
point, the least residual r of the optimality conditions over multipliers mu >= 0 of the active rows (non-negative
least squares, Lawson and Hanson 1974) is zero at the optimum only; elsewhere -r is a feasible descent direction, at
degenerate vertices too.  The step goes to the minimiser on the face that -r stays on, the shortest where T is flat.
Rows of T may differ in length as they like: residuals and steps are those of hqp.problem.graded.

A level with a price is min ||w|| + c (E + R) (hqp.problem.pricing): min 1/2 ||w||^2 + m c (E + R) with the m at which m
= ||w||, found on log m.  Inequality rows a x, and rows of an anchored level, 1/2 ||A (x - x_a)||^2 / give, are hard
rows a x - |a| s with a cost on s, so that short rows keep their rounding and give may be 1e-12.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hqp.arrays import Mask, Mat, Vec, longest_row, right_vectors, row_lengths
from hqp.problem import Hierarchy, Rows
from hqp.problem.completion import chosen, completion
from hqp.problem.graded import Errors, best_step, pull
from hqp.problem.nnls import nonnegative_least_squares
from hqp.problem.pricing import UNNAMED, Above, Coordinates, at_optimum, is_met, row_sizes, stack_rows
from hqp.tolerances import MET_TOLERANCE, NULL_SPACE_ROUNDING, RANK_TOLERANCE, RESTING, ROUNDING

HELD, ALONG = 1e-11, 1e-9
"""Active: a row this close to its bound, relative to its terms.  Along it: a unit direction of less than this rate."""

OPTIMAL, FLAT = 1e-13, 1e-9
"""Relative residual of the optimality conditions of an optimal point, and of one whose last step lowered nothing."""

STALLED = 10
"""Steps beyond the number of rows that lower nothing: rounding turns them round."""

DEPENDENT = 1e-10
"""Singular values of rows of unit length up to this count as zero."""

ROOT = 1e-12
"""m is found to this relative accuracy."""


@dataclass(frozen=True)
class Limits:
    """When a level ends: a row of which no more than rank_tolerance of its length is left adds no direction,
    max_iterations steps of a level, factorisations of a whole problem, None for any number."""

    rank_tolerance: float = RANK_TOLERANCE
    max_iterations: int = 1000
    factorisations: int | None = None


def solve_level(rows: Rows, above: Above, x: Vec, price: float, at: Coordinates, limits: Limits | None = None) -> Vec:
    """Compute the stage point of one level under the rows from the levels above, starting at a point x of S."""
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
        return np.array([*points[1:], chosen(problem, x)])

    def level(self, rows: Rows, above: Above, x: Vec, price: float) -> Vec:
        """The stage point of a level, from a point of S."""
        if longest_row(rows.dense(x.size)) <= self._zero:
            rows = Rows(np.zeros((0, x.size)), np.zeros(0), np.zeros(0))
            return self._search(rows, above, x, 1.0, price > 0.0) if above.anchors or price > 0.0 else x
        return self._priced(rows, above, x, price) if price > 0.0 else self._search(rows, above, x, 1.0)

    def _priced(self, rows: Rows, above: Above, x: Vec, price: float) -> Vec:
        """argmin ||w|| + c (E + R) by root finding on log m; min E + R where the level is met for its price.

        The search begins at the latter if the level can be met: at most other points a small m leaves w as rounding.
        """
        nothing = Rows(np.zeros((0, x.size)), np.zeros(0), np.zeros(0))
        best = self._search(rows, replace(above, anchors=()), x, 1.0)
        met = above.with_rows(at_optimum(rows, best), UNNAMED)
        settled = self._search(nothing, met, best, 1.0, moves=True)
        point = settled if is_met(rows, best) else x

        def unmet(m: float) -> float:
            nonlocal point
            point = self._search(rows, above, point, m * price, moves=True)
            return float(np.linalg.norm(rows.slack(point)))

        lengths = row_lengths(rows.dense(x.size))
        least = MET_TOLERANCE * float(row_sizes(rows, x)[lengths > self._zero].min(initial=np.inf))
        rounding = NULL_SPACE_ROUNDING * float(lengths.max(initial=0.0)) * max(1.0, float(np.abs(x).max(initial=0.0)))
        if _root(unmet, max(least, rounding, 1e-300)) is not None:
            return point
        return settled

    def _search(self, rows: Rows, above: Above, x: Vec, m: float, moves: bool = False) -> Vec:
        """argmin 1/2 ||w||^2 + m (E + R) over S, from a point x of it; m R without ``moves``."""
        n, at = x.size, self._at
        A, unequal = rows.dense(n), ~rows.equality & (np.isfinite(rows.lower) | np.isfinite(rows.upper))
        A = A * (row_lengths(A) > self._zero)[:, None]
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
        if not left.size and not q:
            return x
        hard = stack_rows([above.hard, *(Rows(C, lower, upper) for C, lower, upper, _ in soft)], n)
        dense = hard.dense(n)
        units = np.concatenate([_units(C) for C, *_ in soft])
        worth = np.repeat([s for *_, s in soft], sizes)
        whole = np.block([[left, np.zeros((len(left), q))], [np.zeros((q, n)), np.diag(units / worth)]])
        C = np.concatenate([at.rows(dense), np.eye(hard.m, q, -above.hard.m) * -units], axis=1)
        shift = dense @ at.still
        program = _Program(
            whole,
            np.concatenate([*t, np.zeros(q)]),
            C,
            hard.lower - shift,
            hard.upper - shift,
            q,
            self._limits.rank_tolerance,
        )
        off = np.concatenate([Rows(C, lower, upper).slack(x) / _units(C) for C, lower, upper, _ in soft])
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
    guess, side = high, 0
    for _ in range(100):  # regula falsi with the Illinois rule: an end that stays counts half
        guess = high - far * (high - low) / (far - close)
        here = excess(guess)
        if abs(here) <= ROOT or high - low <= ROOT:
            break
        if here > 0.0:
            high, far, close, side = guess, here, 0.5 * close if side > 0 else close, 1
        else:
            low, close, far, side = guess, here, 0.5 * far if side < 0 else far, -1
    return math.exp(guess)


class _Effort:
    """Number of factorisations left."""

    __slots__ = ("left",)

    def __init__(self, most: int | None) -> None:
        self.left = math.inf if most is None else most

    @property
    def spent(self) -> bool:
        """Return true if none is left."""
        return self.left <= 0


class _Program:
    """min ||T v - t||^2 over lower <= C v <= upper, from a point of that set.

    T's rows may differ in length as they like (hqp.problem.graded); a row that adds a direction keeps more than
    ``least`` of its length.
    """

    def __init__(self, T: Mat, t: Vec, C: Mat, lower: Vec, upper: Vec, slacks: int, least: float) -> None:
        """slacks: the last of v, which are zero where they rest."""
        self.slacks, lengths = slacks, row_lengths(C)
        real = (lengths > ROUNDING * lengths.max(initial=0.0)) & ((lower > -np.inf) | (upper < np.inf))
        scale = lengths[real]
        asks = row_lengths(T) > 0.0
        self.T, self.t, self.lengths, self.least = T[asks], t[asks], row_lengths(T[asks]), least
        self.C, self.lower, self.upper = C[real] / scale[:, None], lower[real] / scale, upper[real] / scale
        self.equal = self.lower == self.upper
        self.Z = _null_space(self.C[self.equal])

    def solve(self, v: Vec, limit: int, effort: _Effort) -> tuple[Vec, int, bool]:
        """The optimum, how many steps it took, and whether it was reached."""
        lowest, since, face = math.inf, 0, None
        for step in range(limit):
            if effort.spent:
                return v, step, False
            w = self.T @ v - self.t
            if np.all(np.abs(w) <= ROUNDING * self.lengths):
                return v, step, True
            direction, held, gap, taken = self._descent(v, w)
            value = float(np.sqrt(w @ w))
            since = 0 if value < (1.0 - OPTIMAL) * lowest else since + 1
            on_face = since > 0 and face is not None and np.array_equal(face, self._sides(v))
            if (taken <= OPTIMAL or on_face) and (gap <= OPTIMAL or (gap <= FLAT and since > 0)):
                return v, step, True
            lowest = min(lowest, value)
            before, (v, ended) = v, self._advance(v, direction, held, gap > FLAT and value > FLAT, effort)
            face = self._sides(v) if ended else None
            if np.array_equal(before, v) or since > STALLED + self.upper.size:
                return v, step, False  # the multipliers are known no better: the certificate has the last word
        return v, limit, False

    def _sides(self, v: Vec) -> Vec:
        """+1 at upper, -1 at lower, 0 elsewhere and for equalities."""
        value = self.C @ v
        reach = HELD * (1.0 + np.abs(self.C) @ np.abs(v))
        side = np.where(value >= self.upper - reach, 1.0, np.where(value <= self.lower + reach, -1.0, 0.0))
        return np.where(self.equal, 0.0, side)

    def _descent(self, v: Vec, w: Vec) -> tuple[Vec, Mask, float, float]:
        """The steepest feasible direction at the best point on the face of all active rows, the step there where that
        is zero; also the rows that it stays on, its length relative to the terms, and the reduction of each row by the
        step."""
        side = self._sides(v)
        active = np.flatnonzero(side)
        cone = side[active, None] * self.C[active] @ self.Z
        sigma, Vt = right_vectors(cone)
        along, face = np.split(Vt, [int(np.count_nonzero(sigma > DEPENDENT))])
        n = v.size - self.slacks
        size = np.abs(v)
        size[:n] += RESTING * size[:n].max(initial=0.0)
        rows, sizes = self.T @ self.Z, np.maximum(np.abs(self.T) @ size + np.abs(self.t), 1e-150)
        exact = Errors.none(w.size)
        found = pull(rows @ face.T, rows @ along.T, w, self.lengths, sizes, NULL_SPACE_ROUNDING / FLAT, exact)
        held, normals = np.zeros(side.size, dtype=bool), (cone @ along.T).T
        left = -found.along / max(found.size, 1e-300)
        left = left - normals @ nonnegative_least_squares(normals, left)
        gap = float(np.sqrt(left @ left))
        if gap <= OPTIMAL:
            held[active] = True
            step = best_step(rows @ face.T, w, self.lengths, self.least)
            return self.Z @ face.T @ step, held, gap, found.taken
        held[active] = left @ normals >= -HELD * gap
        return self.Z @ along.T @ left, held, gap, found.taken

    def _advance(self, v: Vec, direction: Vec, held: Mask, steep: bool, effort: _Effort) -> tuple[Vec, bool]:
        """To the minimiser on the face of the held rows, which ends the step, or the first row in the way; at it, down
        a steep direction."""
        face, side = held.copy(), self._sides(v)
        while not effort.spent:
            effort.left -= 1
            Z = self.Z @ _null_space(self.C[face] @ self.Z)
            step = Z @ best_step(self.T @ Z, self.T @ v - self.t, self.lengths, self.least)
            far, row = self._room(v, step, face)
            here = steep and np.abs(step).max() <= 1e-13 * np.abs(v).max()
            against = far < ALONG and side[row] != 0.0  # an active row: the room that it leaves is rounding
            if far > 1e-14 and not here and not against:
                return np.asarray(v + min(1.0, far) * step), far >= 1.0
            if row < 0 or here or not np.any(step):  # the face has its minimum at v
                break
            face[row] = True
        curvature = self.T @ direction
        best = float((self.t - self.T @ v) @ curvature) / max(float(curvature @ curvature), 1e-300)
        unheld = np.zeros(held.size, dtype=bool)  # nearly opposed rows: a long step leaves a row at a small rate
        # if the direction is rounding it may lead upwards: a negative step would leave rows that nothing checks
        return np.asarray(v + min(max(best, 0.0), self._room(v, direction, unheld)[0]) * direction), False

    def _room(self, v: Vec, step: Vec, held: Mask) -> tuple[float, int]:
        """Return how many times the step fits, and the blocking row, -1 if there is none."""
        value, rate = self.C @ v, self.C @ step
        rate[held | self.equal] = 0.0
        floor = HELD * float(np.abs(step).max(initial=0.0))
        room = np.where(rate > floor, self.upper - value, np.where(rate < -floor, self.lower - value, np.inf))
        times = np.maximum(np.divide(room, rate, out=np.full(rate.size, np.inf), where=np.abs(rate) > floor), 0.0)
        row = int(np.argmin(times)) if times.size else -1
        return (float(times[row]), row) if row >= 0 and times[row] < np.inf else (np.inf, -1)


def _null_space(A: Mat) -> Mat:
    """Orthonormal basis ``(n, r)`` of the null space of rows of unit length."""
    sigma, Vt = right_vectors(A)
    return np.asarray(Vt[int(np.count_nonzero(sigma > DEPENDENT)) :].T)


def _units(A: Mat) -> Vec:
    """The length of each row, one for rows of none."""
    lengths = row_lengths(A)
    lengths[lengths == 0.0] = 1.0
    return lengths
