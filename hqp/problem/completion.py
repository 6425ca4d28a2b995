"""Tie-breaking among the optima of all levels, written as levels: metric and origin, then least norm.

If the metric is singular, directions may remain that neither the metric, nor the motion, nor a level below the
constraints sees, such as internal forces, which move nothing.  Along them, Z ``(n, r)`` orthonormal, the answer is the
minimum of

    1/2 ||x||^2 + sum_i e_i^2 / (2 SOFTNESS^2),    e_i: excess of row i of the constraints, of unit length, at x.

With hard rows the least norm may be the apex of a wedge: two feet at the edges of their friction cones, turned against
each other by 1e-9 rad, leave a wedge whose apex moves by 1e3 N m if a row moves by 1e-6 N.  The minimum above is
strictly convex: an error e of a row moves it by at most e / (2 SOFTNESS), on every machine and from every start.  A row
is exceeded by at most SOFTNESS ||y|| times its length, y the shortest point within all rows.  Bounds on single
variables are stiffer, by SINGLE, because what is sent must keep to them.  A row that the levels violate by more keeps
its value.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from hqp.arrays import Mask, Mat, Vec, longest_row, right_vectors, row_lengths
from hqp.problem import Hierarchy, Rows, Selection
from hqp.tolerances import (
    FEASIBILITY_TOLERANCE,
    GRADED_ROWS,
    METRIC_TOLERANCE,
    RANK_TOLERANCE,
    ROUNDING,
    SOFTNESS,
    VIOLATION_TOLERANCE,
)

HARD = 1e-11
"""A softness that keeps rows to their bounds but for rounding."""

INSET = 1e-10
"""Share of a row's terms by which within() keeps off its bounds: above rounding of x, below tolerances of active rows.

Without it the point is on one side of a wedge that rounding opens, and rows with multipliers of 1e-6 are 1e-6 off."""

SINGLE = 1e-2
"""Softness of bounds on single variables, relative to that of other rows."""

STILL = 1e-9
"""Share of 1 + |z|: after a shorter step the rows that count as exceeded are certain."""

SHRINKS = 0.1
"""Share of the step before, on the same rows: a longer second step is rounding of nearly opposed rows."""


def metric_factor(metric: Mat, tolerance: float = METRIC_TOLERANCE) -> Mat:
    """F ``(n, n)`` with F' F = metric, by pivoted Cholesky; zero rows where the metric is singular.

    metric: ``(n, n)`` symmetric positive semidefinite; indefinite parts below the tolerance, which come from rounding,
    are cut.
    """
    from scipy.linalg import get_lapack_funcs  # heavy, and most stacks have no metric

    F = np.zeros_like(metric)
    largest = float(metric.diagonal().max(initial=0.0))
    if largest > 0.0:
        (pstrf,) = get_lapack_funcs(("pstrf",), (metric,))
        factor, pivots, rank, _ = pstrf(metric, tol=tolerance * largest)
        F[:rank, pivots - 1] = np.triu(factor)[:rank]
    return F


def completion(problem: Hierarchy) -> tuple[Rows, ...]:
    """Levels of n rows for the completion, below the levels of the problem: metric about origin, least norm."""
    n, origin = problem.n, problem.origin
    if problem.metric is None:
        return (_identity(np.zeros(n) if origin is None else origin),)
    F = metric_factor(problem.metric)
    target = np.zeros(n) if origin is None else F @ origin
    return Rows(F, target, target), _identity(np.zeros(n))


def unseen(problem: Hierarchy) -> Mat:
    """Orthonormal basis ``(n, r)`` of the directions that neither metric, motion nor a level below the constraints
    sees.

    A row sees a direction of which it has more than RANK_TOLERANCE of its length, and of GRADED_ROWS of its level's
    longest row: rounding of rows that are products leaves 1e-12, rows of forces have 1e-3 and more. Rows count in their
    order, so that a nearly dependent row does not tilt the directions that those before it leave.
    """
    n = problem.n
    if problem.metric is None:
        return np.zeros((n, 0))
    F = metric_factor(problem.metric)
    rank = int(np.count_nonzero(np.any(F, axis=1)))
    Z = right_vectors(F[:rank])[1][rank:].T if rank else np.eye(n)
    levels = problem.levels[problem.constraints :]
    rows = [level.dense(n)[np.isfinite(level.lower) | np.isfinite(level.upper)] for level in levels]
    if problem.priced:
        motion = problem.motion
        rows.append(np.eye(n) if motion is None else np.diag(motion.F) if motion.F.ndim == 1 else motion.F)
    for A in rows:
        Z = _held(Z, A, np.maximum(row_lengths(A), GRADED_ROWS * longest_row(A)))
    return np.asarray(Z)


def _held(Z: Mat, A: Mat, sizes: Vec) -> Mat:
    """The directions without those that rows see, one row after the other; sizes: seen is a share of these."""
    for a, size in zip(A, sizes, strict=True):
        length = float(np.linalg.norm(own := a @ Z))
        if length > RANK_TOLERANCE * size:
            own[0] += np.copysign(length, own[0])
            Z = (Z - np.outer(Z @ own, own) * (2.0 / (own @ own)))[:, 1:]
    return Z


def chosen(problem: Hierarchy, x: Vec) -> Vec:
    """x moved along the unseen directions to the minimum, ``(n,)``; x itself if there is no such direction."""
    return Choice(problem, x).minimum()


def allowed(problem: Hierarchy, x: Vec) -> Vec:
    """Permitted excess of each row of the constraints at x, ``(m_0 + ...,)`` [unit of the row]."""
    return Choice(problem, x).allowed


class Choice:
    """Points x + Z z along the unseen directions Z ``(n, r)`` of a problem.

    allowed: ``(m_0 + ...,)``, by how much each row of the constraints may be exceeded: SOFTNESS of the shortest point
    within all rows, or of x if there is none [unit of the row].
    """

    def __init__(self, problem: Hierarchy, x: Vec) -> None:
        self.Z, self._x = unseen(problem), x
        levels, n = problem.levels[: problem.constraints], problem.n
        A = np.concatenate([np.zeros((0, n)), *(rows.dense(n) for rows in levels)])
        self._lower = np.concatenate([np.zeros(0), *(rows.lower for rows in levels)])
        self._upper = np.concatenate([np.zeros(0), *(rows.upper for rows in levels)])
        self._A, self._lengths, self._size = A, row_lengths(A), float(np.linalg.norm(x))
        sees = row_lengths(A @ self.Z) > RANK_TOLERANCE * self._lengths
        self.allowed = np.zeros(sees.size)
        self._within = x
        if not self.Z.shape[1]:
            return
        self._within = y = self._point(HARD, self.Z, INSET)
        size = self._size
        if not self._beyond(A @ y)[sees].any():  # else the levels violate some
            size = max(size, float(np.linalg.norm(y)))
        self.allowed = SOFTNESS * size * self._lengths * sees
        broken = self._beyond(A @ x)
        self._left = _held(self.Z, A[broken], self._lengths[broken])  # rows that are broken keep their values

    def _beyond(self, value: Vec) -> Mask:
        """Mask of rows that these values violate by more than is allowed."""
        nearest = np.clip(value, self._lower, self._upper)
        slop = VIOLATION_TOLERANCE * (1.0 + np.abs(nearest)) + self.allowed
        return np.asarray(np.abs(value - nearest) > slop + FEASIBILITY_TOLERANCE * self._size * self._lengths)

    def minimum(self) -> Vec:
        """The answer, ``(n,)``."""
        return self._point(SOFTNESS, self._left, 0.0) if self.Z.shape[1] else self._x

    def within(self) -> Iterator[Vec]:
        """Points within the rows, and x, at any of which the levels may be judged, each ``(n,)``.

        A row that holds a level is at its bound at each of them but for INSET of its terms, or for rounding of x,
        divided by the angle of a wedge: one or the other may be more than the tolerance of an active row.
        """
        if self.Z.shape[1]:
            yield self._within if self._left is self.Z else self._point(HARD, self._left, INSET)
            yield self._point(HARD, self._left, 0.0)
        yield self._x

    def _point(self, softness: float, Z: Mat, inset: float) -> Vec:
        off = inset * (self._lengths + np.abs(self._A) @ np.abs(self._x))
        off = np.minimum(off, 0.5 * (self._upper - self._lower))
        sees = row_lengths(B := self._A @ Z) > RANK_TOLERANCE * self._lengths
        still = self._x - Z @ (z := self._x @ Z)
        lengths = self._lengths[sees]
        base = (self._A[sees] @ still) / lengths
        lower, upper = (self._lower + off)[sees] / lengths - base, (self._upper - off)[sees] / lengths - base
        single = np.count_nonzero(self._A[sees], axis=1) == 1
        weight = 1.0 / np.where(single, max(SINGLE * softness, HARD), softness)
        return np.asarray(still + Z @ _minimum(B[sees] / lengths[:, None], lower, upper, weight, z))


def _minimum(B: Mat, lower: Vec, upper: Vec, weight: Vec, z: Vec) -> Vec:
    """argmin |z|^2 / 2 + |weight * excess of B z|^2 / 2, by Newton's method from z.

    side: rows that count as exceeded. The excess of a stiff row is less than rounding of its bound: the step tells it.
    """
    side, last = np.sign(B @ z - np.clip(B @ z, lower, upper)), np.inf
    for _ in range(100):
        value, out = B @ z, side != 0.0
        beyond = value - np.where(side > 0.0, upper, np.where(side < 0.0, lower, 0.0))
        step = _newton(B[out], weight[out], beyond[out], z)
        slope, length = B @ step, float(np.linalg.norm(step))
        off = value + slope - np.clip(value + slope, lower, upper)
        stays = out & (side * (beyond + slope) >= 0.0)
        there = np.where(stays, side, np.sign(off) * (np.abs(off) > ROUNDING * (1.0 + np.abs(value))))
        same = np.array_equal(there, side)
        small = length <= STILL * (1.0 + float(np.linalg.norm(z)))
        ended = same and (small or length > SHRINKS * last)
        last = length if same else np.inf

        def rise(far: Vec, z: Vec = z, step: Vec = step, value: Vec = value, slope: Vec = slope) -> Vec:
            """Derivative of the function along the step, at each share of it."""
            off = value + far[:, None] * slope
            off -= np.clip(off, lower, upper)
            return np.asarray(z @ step + far * (step @ step) + (off * weight) @ (weight * slope))

        if same or small or rise(np.ones(1))[0] <= 0.0:
            z, side = z + step, there
            if ended:
                break
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            up, down, moves = (upper - value) / slope, (lower - value) / slope, slope != 0.0
        ends = np.concatenate([up[moves], down[moves]])
        ends = np.concatenate([[0.0], np.sort(ends[(ends > 0.0) & (ends < 1.0)]), [1.0]])
        k = int(np.argmax((rises := rise(ends)) > 0.0))  # between two ends the derivative is linear
        far = ends[k - 1] - rises[k - 1] * (ends[k] - ends[k - 1]) / (rises[k] - rises[k - 1]) if k else 0.0
        above = np.where(slope > 0.0, up <= far, up > far) & moves
        below = np.where(slope > 0.0, down > far, down <= far) & moves
        side, z = np.where(moves, 1.0 * above - 1.0 * below, side), z + far * step
    return z


def _newton(B: Mat, weight: Vec, beyond: Vec, z: Vec) -> Vec:
    """argmin |z + step|^2 + |weight * (beyond + B step)|^2: QR with pivoting below sorted rows keeps the short ones."""
    from scipy.linalg import lstsq  # slow to import, and not every problem has such directions

    order = np.argsort(-weight, kind="stable")
    M = np.concatenate([B[order] * weight[order, None], np.eye(z.size)])
    target = -np.concatenate([(weight * beyond)[order], z])
    found: Any = lstsq(M, target, cond=0.0, lapack_driver="gelsy", check_finite=False)
    return np.asarray(found[0])


def _identity(target: Vec) -> Rows:
    return Rows(Selection(np.arange(target.size)), target, target)
