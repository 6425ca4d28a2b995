"""Feasible directions of a level below the levels above: the null space of fixed rows, the cone of others."""

from __future__ import annotations

import numpy as np

from hqp.arrays import Index, Mask, Mat, Vec, longest_row, right_vectors
from hqp.problem import Rows
from hqp.problem.graded import Errors, Pull, best_step, pull
from hqp.problem.nnls import nonnegative_least_squares
from hqp.tolerances import (
    CERTIFIED_RANK_TOLERANCE,
    CLEAR_DIRECTION,
    EITHER_RANK,
    LARGEST_ROUNDING,
    NULL_SPACE_ROUNDING,
    RESTING,
    ROUNDED,
)


class Judge:
    """Feasible directions below the levels above: a basis Z of the null space of fixed rows, and the active rows'
    cone."""

    def __init__(self, n: int, tolerance: float, lock: float, rank: float = CERTIFIED_RANK_TOLERANCE) -> None:
        self.tolerance, self.lock, self.rank = tolerance, lock, rank
        self.unclear = False  # a singular value may count as a direction or not
        self.shortest = 1.0  # singular value of a direction that was fixed
        self._forces = 0.0  # sum of the multipliers of the level just judged
        self.Z: Mat = np.eye(n)
        self.unit: Mat = np.zeros((0, n))  # every row so far, of unit length
        self.lengths: Vec = np.zeros(0)
        self.fixed = np.zeros(0, dtype=bool)
        self.side: Vec = np.zeros(0)  # +1 active at upper, -1 at lower, 0 neither
        self.room: Mat = np.zeros((0, 2))  # distance to lower and to upper, of rows of unit length
        self._positive = np.zeros(0, dtype=bool)
        self._own: Index = np.zeros(0, dtype=np.intp)  # rows of the level just judged that have a multiplier themselves

    @property
    def choice_rounding(self) -> float:
        """Bound on the gap of a tie-break from rounding of the rows that hold it.

        Rows that are nearly opposed hold it by large multipliers.
        """
        return max(self.rounding, ROUNDED * self._forces)

    @property
    def rounding(self) -> float:
        """Bound on the gap from rounding of the fixed rows and the rows with a multiplier."""
        return min(NULL_SPACE_ROUNDING * (1.0 / self.shortest + self._forces), LARGEST_ROUNDING)

    def judge_graded(
        self, A: Mat, rows: Rows, slack: Vec, lengths: Vec, x: Vec, errors: Errors, counted: int | None = None
    ) -> tuple[float, Vec]:
        """Judge A' slack if rows of the level differ in length; lengths: zero for a row that counts as none.  errors:
        beside the rounding of the rows' terms.  counted: a step counts by its change of so many rows, the first, by
        default of all.

        The level's own inequalities within a step that does not count of a bound have a multiplier like the rows above.
        """
        size, value = max(1.0, float(np.abs(x).max(initial=0.0))), A @ x
        near = self.tolerance * size * lengths
        at_upper, at_lower = np.abs(value - rows.upper) <= near, np.abs(value - rows.lower) <= near
        equality = (rows.lower == rows.upper) | (at_upper & at_lower)
        side = np.where(at_upper, 1.0, np.where(at_lower, -1.0, 0.0))
        side[equality | (lengths == 0.0)] = 0.0
        unit = np.divide(A, lengths[:, None], out=np.zeros_like(A), where=lengths[:, None] > 0.0)
        own = np.flatnonzero(side)
        left = np.flatnonzero((lengths > 0.0) & (side == 0.0) & ((slack != 0.0) | equality))
        B = A[left] @ self.Z
        rounded = NULL_SPACE_ROUNDING * (np.abs(slack) + terms(A, x))
        error = Errors(errors.entry[left], (rounded + errors.slack)[left], errors.row[left])
        sizes, rounding = size * lengths[left], ROUNDED / self.tolerance
        parts, before = (slack[left], lengths[left], sizes, rounding, error), 0.0

        def taken(face: Mat, found: Pull) -> float:
            """The most that the best step changes a row that counts."""
            if found.taken <= self.tolerance or counted is None:
                return found.taken
            change = B @ face.T @ best_step(B @ face.T, slack[left], lengths[left])
            return float((np.abs(change) / sizes).max(initial=0.0, where=left < counted))

        along, face = self._split(unit[own])
        found = pull(B @ face.T, B @ along.T, *parts)
        if found.taken > self.tolerance:
            before = self.hold(A[left], slack[left], lengths[left], x, unit[own])
            along, face = self._split(unit[own])
            found = pull(B @ face.T, B @ along.T, *parts)
        gap, shares = self._along(along, found, own, side, unit)
        off = before + taken(face, found)
        if max(gap, off) > self.tolerance:
            # optimal without some rows is optimal with them: those without a multiplier may go
            along, face = self._split(unit[self._own], self._positive)
            less = pull(B @ face.T, B @ along.T, *parts)
            if (alone := taken(face, less)) <= self.tolerance:
                off = alone
                gap, shares = self._along(along, less, self._own, side, unit)
        return max(gap, off), shares

    def _along(self, along: Mat, found: Pull, own: Index, side: Vec, unit: Mat) -> tuple[float, Vec]:
        """Judge the gradient along active rows; own, side, unit: rows of the level that have a multiplier."""
        return self.judge(self.Z @ (along.T @ found.along), found.size, own, side[own, None] * unit[own])

    def hold(self, A: Mat, slack: Vec, lengths: Vec, x: Vec, own: Mat) -> float:
        """Count the rows above as active that the best step for ||slack|| reaches before it changes a row of A by the
        tolerance, however far they are.

        Return the change until the last of them, relative to the row's length and x.  own: active rows of the level
        itself, of unit length.
        """
        size, changed = max(1.0, float(np.abs(x).max(initial=0.0))), 0.0
        while True:
            face = self._split(own)[1]
            step = face.T @ best_step(A @ self.Z @ face.T, slack, lengths)
            change = float((np.abs(A @ self.Z @ step) / (size * lengths)).max(initial=0.0))
            row, share = self._first(self.Z @ step)
            if row == 0 or changed + share * change > self.tolerance:
                return changed
            changed += share * change
            self.side[abs(row) - 1] = np.sign(row)

    def _split(self, own: Mat, active: Mask | None = None) -> tuple[Mat, Mat]:
        """Orthonormal rows that span the active rows in Z, by default all, and those of their face."""
        active = (self.side != 0.0) & ~self.fixed if active is None else active
        held = np.concatenate([self.unit[active], own]) @ self.Z
        sigma, Vt = right_vectors(held)
        along, face = np.split(Vt, [int(np.count_nonzero(sigma > self.rank))])
        return along, face

    def _first(self, step: Vec) -> tuple[int, float]:
        """The first row that a step reaches, counted from one and negative at its lower bound, and the share of the
        step until there: one if the step reaches no row."""
        slope = self.unit @ step
        room = np.where(slope > 0.0, self.room[:, 1], self.room[:, 0])
        meets = (self.side == 0.0) & ~self.fixed & (slope != 0.0)
        shares = np.divide(room, np.abs(slope), out=np.ones(room.size), where=meets)
        k = int(np.argmin(shares)) if shares.size else 0
        return (int(np.sign(slope[k])) * (k + 1), float(shares[k])) if shares.size and shares[k] < 1.0 else (0, 1.0)

    def fall(self, A: Mat, rows: Rows, slack: Vec, sizes: Vec, counted: Mask, x: Vec) -> float:
        """Return the possible decrease of ||w|| along clear directions on the face of the active rows, relative to its
        terms.

        It counts beyond rounding and the tolerance of a row of the level's length; a gradient means little if the rows
        are short in the null space of those above.  counted: rows that are equalities or violated; a row that the step
        leaves counts as well.  sizes: their terms.
        """
        longest, value, counted, slack = longest_row(A), A @ x, counted.copy(), slack.copy()
        sigma, Vt = right_vectors(self.unit[(self.side != 0.0) & ~self.fixed] @ self.Z)
        face = A @ self.Z @ Vt[int(np.count_nonzero(sigma > self.rank)) :].T
        rounding = min(NULL_SPACE_ROUNDING / self.shortest, LARGEST_ROUNDING)
        rest = longest * max(RESTING, float(np.abs(x).max(initial=0.0)))
        while True:
            U, sigma, Vt = np.linalg.svd(face[counted], full_matrices=False)
            clear = sigma > longest * max(CLEAR_DIRECTION, NULL_SPACE_ROUNDING / self.shortest)
            taken = U[:, clear].T @ slack[counted]
            reach = max(float(np.linalg.norm(taken)) - (rounding + self.tolerance) * rest, 0.0)
            end = value - face @ (Vt[clear].T @ (taken / sigma[clear]))
            bound = np.clip(end, rows.lower, rows.upper)
            left = ~counted & (end != bound)
            if reach == 0.0 or not left.any():
                return reach / float(np.max(np.abs(slack) + sizes, initial=rest, where=counted))
            counted |= left
            slack[left] = (value - bound)[left]

    def judge(
        self, gradient: Vec, scale: float, own: Index | None = None, normals: Mat | None = None
    ) -> tuple[float, Vec]:
        """Relative gap of a gradient, and the multiplier of every row so far.

        own, normals: rows of the level itself that have a multiplier, of unit length and outwards.
        """
        shares = np.zeros(self.side.size)
        self._positive = np.zeros(self.side.size, dtype=bool)
        self._own = np.zeros(0, dtype=np.intp)
        self._forces = 0.0
        if scale <= 0.0:
            return 0.0, shares
        target = -(gradient @ self.Z) / scale
        active = np.flatnonzero((self.side != 0.0) & ~self.fixed)
        cone = (self.side[active, None] * (self.unit[active] @ self.Z)).T
        if normals is not None:
            cone = np.column_stack([cone, (normals @ self.Z).T])
        mu = nonnegative_least_squares(cone, target)
        gap = float(np.linalg.norm(target - cone @ mu))
        self._forces = float(mu.sum())
        shares[active] = self.side[active] * mu[: active.size]
        force = mu * np.linalg.norm(cone, axis=0)  # in the null space: increase of the level per unit step off the row
        positive = force > max(self.lock, 100.0 * gap)  # below the effect of the gap: not significant
        self._positive[active] = positive[: active.size]
        if own is not None:
            self._own = own[positive[active.size :]]
        rest = -gradient / scale - self.unit.T @ shares
        if normals is not None:
            rest -= normals.T @ mu[active.size :]
        if self.fixed.any():
            shares[self.fixed] = np.linalg.lstsq(self.unit[self.fixed].T, rest, rcond=1e-12)[0]
        return gap, scale * np.divide(shares, self.lengths, out=shares, where=self.lengths > 0.0)

    def descend(
        self,
        A: Mat,
        value: Vec,
        lower: Vec,
        upper: Vec,
        lengths: Vec,
        sizes: Vec,
        zero: float,
        far: float,
        moved: Mat | None = None,
    ) -> int:
        """Take in the level just judged; return how many directions it fixed.

        zero: rows of this length have none.  far: ||x||, whose rounding each row has.  moved: ``(m, 2)``, by how much
        rounding elsewhere moved each lower and upper bound.
        """
        floor = max(1e-13 * lengths.max(initial=0.0), zero)
        real = lengths > floor
        unit = np.divide(A, lengths[:, None], out=np.zeros_like(A), where=real[:, None])
        slop = self.tolerance * (lengths + sizes) + NULL_SPACE_ROUNDING * far * lengths
        by_lower, by_upper = np.zeros((2, value.size)) if moved is None else moved.T
        at_lower, at_upper = value <= lower + slop + by_lower, value >= upper - slop - by_upper
        beyond = (value > upper + slop) | (value < lower - slop)
        fixed = real & ((at_upper & at_lower) | beyond)
        fixed[self._own] = True
        side = np.where(at_upper, 1.0, np.where(at_lower, -1.0, 0.0)) * (real & ~fixed)
        locked = self.unit[self._positive]
        self.fixed[self._positive] = True
        self.unit = np.concatenate([self.unit, unit])
        self.lengths = np.concatenate([self.lengths, lengths * real])
        self.fixed = np.concatenate([self.fixed, fixed])
        self.side = np.concatenate([self.side, side])
        room = np.maximum(np.column_stack([value - lower, upper - value]), 0.0)
        own = np.where(real, lengths, 0.0)[:, None]
        self.room = np.concatenate([self.room, np.divide(room, own, out=np.full_like(room, np.inf), where=own > 0.0)])
        self._positive = np.zeros(self.side.size, dtype=bool)
        return self.fix(np.concatenate([locked, unit[fixed]]))

    def fix(self, rows: Mat) -> int:
        """Shrink Z to the null space of rows of about unit length; return by how much."""
        projected = rows @ self.Z
        if not projected.size:
            return 0
        sigma, Vt = right_vectors(projected)
        rank = int(np.count_nonzero(sigma > self.rank))
        ratio = sigma / CERTIFIED_RANK_TOLERANCE
        self.unclear |= bool(np.any((ratio > 1.0 / EITHER_RANK) & (ratio < EITHER_RANK)))
        self.shortest = min(self.shortest, float(sigma[:rank].min(initial=1.0)))
        self.Z = self.Z @ Vt[rank:].T
        return rank


def terms(A: Mat, x: Vec) -> Vec:
    """sum_j |a_ij x_j| of each row: the size that rounding of a_i x is relative to."""
    return np.asarray(np.abs(A) @ np.abs(x))
