"""Tie-breaking among the optima of all levels, written as levels: metric and origin, then least norm.

If the metric is singular, directions may remain that neither the metric, nor the motion, nor a level below the
constraints sees, such as internal forces, which move nothing.  Along them, Z ``(n, r)`` orthonormal, the answer is the
minimum of

    1/2 ||x||^2 + sum_i e_i^2 / (2 SOFTNESS^2),    e_i: excess of row i of the constraints, of unit length, at x.

With hard rows the least norm may be the apex of a wedge: two feet at the edges of their friction cones, turned against
each other by 1e-9 rad, leave a wedge whose apex moves by 1e3 N m if a row moves by 1e-6 N.  The minimum above is
strictly convex: an error e of a row moves it by at most e / (2 SOFTNESS), on every machine and from every start.  A row
is exceeded by at most SOFTNESS ||y|| times its length, y any point within all rows.  Bounds on single variables are
stiffer, by SINGLE, because what is sent must keep to them.  A row that the levels violate by more keeps its value.
"""

from __future__ import annotations

import numpy as np

from hqp.arrays import Mat, Vec, longest_row, right_vectors, row_lengths
from hqp.problem import Hierarchy, Rows, Selection
from hqp.problem.graded import best_step
from hqp.tolerances import METRIC_TOLERANCE, RANK_TOLERANCE, ROUNDING, SOFTNESS, VIOLATION_TOLERANCE

HARD = 1e-11
"""A softness that keeps rows to their bounds but for rounding."""

SINGLE = 1e-2
"""Softness of bounds on single variables, relative to that of other rows."""


STILL = 1e-9
"""Share of 1 + |z|: after a shorter step the rows that count as exceeded are certain."""


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

    A row sees a direction of which it has more than RANK_TOLERANCE of the longest row: rounding of rows that are
    products leaves 1e-12, rows that ask anything of forces have 1e-3 and more.
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
    T = np.concatenate([np.zeros((0, n)), *rows])
    longest = longest_row(T)
    if not Z.shape[1] or longest == 0.0:
        return np.asarray(Z)
    sigma, Vt = right_vectors(T @ Z / longest)
    return np.asarray(Z @ Vt[int(np.count_nonzero(sigma > RANK_TOLERANCE)) :].T)


def chosen(problem: Hierarchy, x: Vec, softness: float = SOFTNESS) -> Vec:
    """x moved along the unseen directions to the minimum, ``(n,)``; x itself if there is no such direction.

    softness: HARD for a point within the rows, at which the levels may be judged.
    """
    Z = unseen(problem)
    if not Z.shape[1]:
        return x
    A, lower, upper = _constraints(problem)
    reach = allowed(problem, x, Z)
    value, nearest = A @ x, np.clip(A @ x, lower, upper)
    broken = np.abs(value - nearest) > VIOLATION_TOLERANCE * (1.0 + np.abs(nearest)) + reach
    lower, upper = np.where(broken, np.minimum(lower, value), lower), np.where(broken, np.maximum(upper, value), upper)
    sees = reach > 0.0
    lengths = row_lengths(A[sees])
    z = x @ Z
    still = x - Z @ z
    B, base = (A[sees] @ Z) / lengths[:, None], (A[sees] @ still) / lengths
    single = np.count_nonzero(A[sees], axis=1) == 1
    soft = np.where(single, max(SINGLE * softness, HARD), softness)
    weight = 1.0 / np.where(broken[sees], min(softness, HARD), soft)
    return np.asarray(still + Z @ _minimum(B, lower[sees] / lengths - base, upper[sees] / lengths - base, weight, z))


def allowed(problem: Hierarchy, x: Vec, Z: Mat | None = None) -> Vec:
    """By how much each row of the constraints may be exceeded at x, ``(m_0 + ...,)`` [unit of the row]."""
    A, *_ = _constraints(problem)
    Z = unseen(problem) if Z is None else Z
    lengths = row_lengths(A)
    return np.asarray(SOFTNESS * float(np.linalg.norm(x)) * lengths * (row_lengths(A @ Z) > RANK_TOLERANCE * lengths))


def _constraints(problem: Hierarchy) -> tuple[Mat, Vec, Vec]:
    levels = problem.levels[: problem.constraints]
    A = np.concatenate([np.zeros((0, problem.n)), *(rows.dense(problem.n) for rows in levels)])
    lower, upper = (np.concatenate([np.zeros(0), *(getattr(rows, side) for rows in levels)]) for side in _SIDES)
    return A, lower, upper


_SIDES = ("lower", "upper")


def _minimum(B: Mat, lower: Vec, upper: Vec, weight: Vec, z: Vec) -> Vec:
    """argmin |z|^2 / 2 + |weight * excess of B z|^2 / 2, by Newton's method from z.

    side: rows that count as exceeded. The excess of a stiff row is less than rounding of its bound: the step tells it.
    """
    side = np.sign(B @ z - np.clip(B @ z, lower, upper))
    for _ in range(100):
        value, out = B @ z, side != 0.0
        beyond = value - np.where(side > 0.0, upper, np.where(side < 0.0, lower, 0.0))
        M = np.concatenate([B[out] * weight[out, None], np.eye(z.size)])
        step = best_step(M, np.concatenate([(weight * beyond)[out], z]), row_lengths(M), 0.0)
        slope, small = B @ step, float(np.linalg.norm(step)) <= STILL * (1.0 + float(np.linalg.norm(z)))
        off = value + slope - np.clip(value + slope, lower, upper)
        stays = out & (side * (beyond + slope) >= 0.0)
        there = np.where(stays, side, np.sign(off) * (np.abs(off) > ROUNDING * (1.0 + np.abs(value))))
        same = np.array_equal(there, side)

        def rise(far: float, z: Vec = z, step: Vec = step, value: Vec = value, slope: Vec = slope) -> float:
            off = value + far * slope - np.clip(value + far * slope, lower, upper)
            return float((z + far * step) @ step + (weight * off) @ (weight * slope))

        if same or small or rise(1.0) <= 0.0:
            z, side = z + step, there
            if same and small:
                break
            continue
        low, far = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + far)
            low, far = (low, middle) if rise(middle) > 0.0 else (middle, far)
        with np.errstate(divide="ignore", invalid="ignore"):
            up, down, moves = (upper - value) / slope, (lower - value) / slope, slope != 0.0
        above = np.where(slope > 0.0, up <= far, up > far) & moves
        below = np.where(slope > 0.0, down > far, down <= far) & moves
        side, z = np.where(moves, 1.0 * above - 1.0 * below, side), z + far * step
    return z


def _identity(target: Vec) -> Rows:
    return Rows(Selection(np.arange(target.size)), target, target)
