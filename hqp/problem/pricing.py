"""Definition of a priced hierarchy: the stages of its levels, and the terms that a solved level hands down
(docs/calm.md).

Level k of a hierarchy with prices c_k, motion E = 1/2 ||F x - f||^2, eta and turning t_k is solved at its stage point

    x_k = argmin { ||w_k|| + c_k (E(x) + R_k(x)) :  x in S_{k-1},  lower_k <= A_k x - w_k <= upper_k }  where c_k > 0,
    x_k = argmin { 1/2 ||w_k||^2 + R_k(x)        :  x in S_{k-1},  lower_k <= A_k x - w_k <= upper_k }  elsewhere.

These terms depend on the result of the level, not on the kind or storage of its rows:

    met for its price (w_k = 0):   S_k has its rows as they are;
    without a price:               S_k has its rows at its optimum, y_k = A_k x_k: equalities keep their value, the
                                   slack of inequalities may not grow, a_i x in [min(lower_i, y_i), max(upper_i, y_i)];
    not met (omega_k = ||w_k||):   S_k = S_{k-1}: all its rows are anchored.

An anchored level resists motion of level k by the sum over all anchored levels above k,

    R_k(x) = 1/2 sum_a sum_i v_ai^2 / (eta c_a omega_a) + t_a omega_a^2 sum_j d_aj^2 (F (x - x_a))_j^2,
    v_ai = a_i (x - x_a) for an equality; for an inequality by how much its slack grows, as above,
    d_aj^2 = sum_i b_i^2 ((a_i F^+ e_j)^2 + (a_i N_a F^+ e_j)^2),    b_i = 1 for an equality, |w_i| / omega_a elsewhere,

N_a the projection, orthogonal in the coordinates of motion, onto the null space of the equality rows of S_{a-1}, with
motion-free directions left free: a joint turns the rows of level a itself, or through those of levels above, as an
elbow does those of a base whose hand is held.  Rows of an unmet level that are met stay no hard rows, and a violated
row is held from one side: while its slack falls to 0 either would turn a hard row into a spring, and the solution would
jump.  R has the unit of E.  The first term lets a level of the same price below move the level's result by eta omega_a,
a level without a price by eta c_a omega_a ||w_k||; it becomes the rows themselves as omega_a falls to 0.  The second
slows motion below in the joints that turn the rows of the level, beyond the level's own motion; it vanishes with
omega_a.  While every priced level is met R = 0.

The answer is x_p; if its argmin is not unique, the completion (metric, origin, least norm) chooses among its points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqp.arrays import Index, Mat, Vec, longest_row, row_lengths
from hqp.problem import Hierarchy, Motion, Rows
from hqp.tolerances import FEASIBILITY_TOLERANCE, FLAT_TOLERANCE, MET_TOLERANCE, NULL_SPACE_ROUNDING, RESTING, ROUNDED

DEPENDS = 1e-8
"""For a row: the part orthogonal to the rows before it, if it depends on them."""

UNNAMED = np.zeros(0, dtype=np.intp)
"""Places of rows that are no rows of a level."""


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """x = still + P y with E(x) = 1/2 ||y[:moving]||^2 + least: motion away from the point of least motion.

    still: ``(n,)``.  P: ``(n, n)``, or ``(n,)`` for a diagonal matrix.  inverse: part of P, in the same form.  moving:
    number of coordinates that E sees; singular values of F below FLAT_TOLERANCE of the largest are zero.  F: ``(r, n)``
    or ``(n,)``, as in Motion.  back: F^+, ``(n, r)`` or ``(n,)``.
    """

    still: Vec
    P: Mat | Vec
    inverse: Mat | Vec
    moving: int
    F: Mat | Vec
    back: Mat | Vec

    @staticmethod
    def of(motion: Motion | None, n: int) -> Coordinates:
        """The coordinates of a motion, 1/2 ||x||^2 for None."""
        F = np.ones(n) if motion is None else motion.F
        f = np.zeros(F.shape[0]) if motion is None or motion.f is None else motion.f
        if F.ndim == 1:
            return Coordinates(f / F, 1.0 / F, F, n, F, 1.0 / F)
        U, sigma, Vt = np.linalg.svd(F, full_matrices=F.shape[0] < n)
        r = int(np.count_nonzero(sigma > FLAT_TOLERANCE * sigma.max(initial=0.0)))
        scale = np.concatenate([sigma[:r], np.full(n - r, sigma[r - 1] if r else 1.0)])
        back = Vt[:r].T @ (U[:, :r] / sigma[:r]).T
        return Coordinates(back @ f, Vt.T / scale, scale[:, None] * Vt, r, F, back)

    def rows(self, A: Mat) -> Mat:
        """A P, ``(m, n)``: rows on y."""
        return A * self.P if self.P.ndim == 1 else A @ self.P

    def motion_rows(self, A: Mat) -> Mat:
        """A P of rows that are combinations of those of F, ``(m, n)``: exactly zero where E is flat."""
        seen = self.rows(A)
        seen[:, self.moving :] = 0.0
        return seen

    def error(self, A: Mat) -> Vec:
        """Error of the entries of A P where E is flat, ``(m,)``, from A's rounding as products: ROUNDED of a row."""
        flat = self.P[:, self.moving :] if self.P.ndim == 2 else np.zeros((0, 0))
        return np.asarray(ROUNDED * longest_row(flat.T) * row_lengths(A))

    def point(self, y: Vec) -> Vec:
        """x of y, ``(n,)``."""
        return self.still + (self.P * y if self.P.ndim == 1 else self.P @ y)

    def of_point(self, x: Vec) -> Vec:
        """y of x, ``(n,)``."""
        offset = x - self.still
        return np.asarray(self.inverse * offset if self.inverse.ndim == 1 else self.inverse @ offset)

    def motion(self, x: Vec) -> Vec:
        """The gradient of E in y, ``(n,)``: y of x, zero where E is flat."""
        y = self.of_point(x)
        y[self.moving :] = 0.0
        return y

    def left(self, A: Mat, C: Mat) -> Mat:
        """A N F^+, ``(m, r)``, N the projection off the motion of the rows C ``(k, n)``, with flat directions free."""
        left, r = self.rows(A), self.moving
        flat, basis = np.zeros((0, A.shape[1])), np.zeros((0, r))
        for row, length in zip(C := self.rows(C), row_lengths(C), strict=True):
            rest = row
            for _ in range(2):
                rest = rest - (rest[r:] @ flat[:, r:].T) @ flat
            if (size := float(np.sqrt(rest[r:] @ rest[r:]))) > DEPENDS * length:
                flat = np.concatenate([flat, rest[None] / size])
                continue
            rest = rest[:r]
            for _ in range(2):
                rest = rest - (rest @ basis.T) @ basis
            if (size := float(np.sqrt(rest @ rest))) > DEPENDS * length:
                basis = np.concatenate([basis, rest[None] / size])
        left[:, :r] -= (left[:, :r] @ basis.T) @ basis
        return left if self.F.ndim == 1 else np.asarray(left @ self.inverse @ self.back)

    def turning(self, A: Mat, C: Mat, weight: Vec, error: Vec) -> tuple[Mat, Vec]:
        """D F, ``(r, n)``, D the diagonal of d_j for rows of A that weigh that much; and the share of d_j, ``(r,)``, by
        which errors of the weights move it."""
        columns = self.columns(A, C)
        square = weight**2 @ columns
        share = np.divide((weight * error) @ columns, square, out=np.zeros(square.size), where=square > 0.0)
        d = np.sqrt(square)
        return (np.diag(d * self.F) if self.F.ndim == 1 else np.asarray(d[:, None] * self.F)), share

    def columns(self, A: Mat, C: Mat) -> Mat:
        """(A F^+)^2 + (A N F^+)^2, ``(m, r)``: turn of each row by each coordinate of the motion."""
        return np.asarray((A * self.back if self.F.ndim == 1 else A @ self.back) ** 2 + self.left(A, C) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class Anchor:
    """A level that is not met, at its stage point x_a: 1/2 ||v||^2 / give + 1/2 ||turning (x - x_a)||^2.

    rows: the anchored ones, dense, v their slack at x.  give: eta c_a omega_a.  turning: ``(r, n)``,
    sqrt(t_a) omega_a D_a F.  uncertain: ``(r,)``, the share of each of its rows that rounding of w may make: a short
    slack of a long row.  x: ``(n,)``, x_a.  places: ``(m,)``, of the rows among all rows of the hierarchy.
    """

    rows: Rows
    give: float
    turning: Mat
    uncertain: Vec
    x: Vec
    places: Index

    @property
    def A(self) -> Mat:
        """The anchored rows, ``(m, n)``."""
        return self.rows.dense(self.x.size)


@dataclass(frozen=True, slots=True, eq=False)
class Above:
    """Rows and anchors handed down by the levels solved so far: S as hard rows, and R as a sum of anchors.

    places: numbers of the hard rows among all rows of the hierarchy, -1 for other rows.  moved: ``(rows, 2)``, by how
    much rounding of a stage's end moved the lower and the upper bound of each: within that a row is at its bound.
    """

    hard: Rows
    anchors: tuple[Anchor, ...]
    places: Index
    moved: Mat

    @staticmethod
    def none(n: int) -> Above:
        """Above the first level."""
        return Above(Rows(np.zeros((0, n)), np.zeros(0), np.zeros(0)), (), np.zeros(0, dtype=np.intp), np.zeros((0, 2)))

    def after(self, problem: Hierarchy, level: int, x: Vec, at: Coordinates, near: Vec | None = None) -> Above:
        """With a level of the problem solved, whose stage ended at x; near: argument of at_optimum."""
        rows, first = problem.levels[level], sum(rows.m for rows in problem.levels[:level])
        places = np.arange(first, first + rows.m)
        if problem.prices is None or not problem.prices[level] > 0.0:
            at_end = kept(rows, x) if self.anchors else at_optimum(rows, x, near)  # equal if R = 0
            return self.with_rows(at_end, places, _moved(rows, at_end, x))
        if is_met(rows, x):
            return self.with_rows(rows, places)
        omega = float(np.linalg.norm(w := rows.slack(x)))
        asks, equal = np.isfinite(rows.lower) | np.isfinite(rows.upper), rows.equality
        held = Rows(rows.dense(x.size)[asks], rows.lower[asks], rows.upper[asks])
        A = held.dense(x.size)
        weight = np.where(equal, 1.0, np.abs(w) / omega)[asks]
        error = np.where(equal, 0.0, NULL_SPACE_ROUNDING / omega * row_sizes(rows, x))[asks]
        give = problem.eta * float(problem.prices[level]) * omega
        t = 0.0 if problem.turning is None else float(problem.turning[level])
        above = self.hard.dense(x.size)[self.hard.equality]
        turning, uncertain = at.turning(A, above, weight, error)
        anchor = Anchor(kept(held, x), give, math.sqrt(t) * omega * turning, uncertain, x, places[asks])
        return replace(self, anchors=(*self.anchors, anchor))

    def with_rows(self, rows: Rows, places: Index, moved: Mat | None = None) -> Above:
        """With more hard rows; moved: none by default."""
        hard = stack_rows([self.hard, rows], self.hard.A.shape[1])  # type: ignore[union-attr]
        named = places if places.size == rows.m else np.full(rows.m, -1)
        moved = np.zeros((rows.m, 2)) if moved is None else moved
        return Above(hard, self.anchors, np.concatenate([self.places, named]), np.concatenate([self.moved, moved]))

    def completed(self, x: Vec, priced: bool, at: Coordinates) -> Above:
        """Below the last level, whose stage ended at x: R keeps its value, and E where that level has a price."""
        below = replace(self, anchors=())
        for anchor in self.anchors:
            turning = anchor.turning / (longest_row(anchor.turning) or 1.0)  # they keep their value: any unit will do
            turned = Rows(turning, turning @ x, turning @ x)
            below = below.with_rows(kept(anchor.rows, x), anchor.places).with_rows(turned, UNNAMED)
        if self.anchors and priced:
            F = np.diag(at.F) if at.F.ndim == 1 else at.F
            below = below.with_rows(Rows(F, F @ x, F @ x), UNNAMED)
        return below


def is_met(rows: Rows, x: Vec) -> bool:
    """Return true if w at x is zero within rounding: for rows of unit length MET_TOLERANCE of their largest terms and
    bounds."""
    lengths = row_lengths(rows.dense(x.size))
    lengths[lengths == 0.0] = lengths.max(initial=0.0) or 1.0
    off = rows.slack(x) / lengths
    return float(np.sqrt(off @ off)) <= MET_TOLERANCE * float((row_sizes(rows, x) / lengths).max(initial=0.0))


def row_sizes(rows: Rows, x: Vec) -> Vec:
    """Size that the rounding of each row's slack is relative to, ``(m,)``: its terms and its bound.

    Entries that rest have the rounding of those that move: none counts for less than RESTING of the largest, or of one.
    A solve may leave FEASIBILITY_TOLERANCE of a row's length times ||x||: no more than that is met as well.
    """
    bounds = np.where(np.isfinite(rows.lower), rows.lower, np.where(np.isfinite(rows.upper), rows.upper, 0.0))
    left = FEASIBILITY_TOLERANCE / MET_TOLERANCE * float(np.linalg.norm(x))
    size = np.abs(x) + max(RESTING * float(np.abs(x).max(initial=1.0)), left)
    return np.asarray(np.abs(rows.dense(x.size)) @ size + np.abs(bounds))


def kept(rows: Rows, x: Vec) -> Rows:
    """Rows at a point: equalities keep their value, the slack of inequalities may not grow."""
    y, equal = rows.A @ x, rows.equality
    lower, upper = np.minimum(rows.lower, y), np.maximum(rows.upper, y)
    return Rows(rows.A, np.where(equal, y, lower), np.where(equal, y, upper))


def at_optimum(rows: Rows, x: Vec, near: Vec | None = None) -> Rows:
    """An exact level's optimal set: its slack is unique, so equalities and rows off by more than rounding, or than
    ``near``, keep their value.

    The others are met, and x is in their range."""
    y = rows.A @ x
    w = rows.slack(x)
    least = MET_TOLERANCE * row_sizes(rows, x)
    fixed = rows.equality | (np.abs(w) > (least if near is None else np.maximum(least, near)))
    held = kept(rows, x)
    return Rows(rows.A, np.where(fixed, y, held.lower), np.where(fixed, y, held.upper))


def _moved(rows: Rows, held: Rows, x: Vec) -> Mat:
    """Distance by which each bound of the held rows gives way to rounding of x, ``(m, 2)``; zero for unmet rows."""
    met = np.abs(rows.slack(x)) <= MET_TOLERANCE * row_sizes(rows, x)
    by = np.zeros((rows.m, 2))
    np.subtract(rows.lower, held.lower, out=by[:, 0], where=met & np.isfinite(rows.lower))
    np.subtract(held.upper, rows.upper, out=by[:, 1], where=met & np.isfinite(rows.upper))
    return np.maximum(by, 0.0)


def stack_rows(parts: Sequence[Rows], n: int) -> Rows:
    """Rows of several levels as one, dense."""
    A = [rows.dense(n) for rows in parts]
    return Rows(
        np.concatenate([*A, np.zeros((0, n))]),
        np.concatenate([*(rows.lower for rows in parts), np.zeros(0)]),
        np.concatenate([*(rows.upper for rows in parts), np.zeros(0)]),
    )
