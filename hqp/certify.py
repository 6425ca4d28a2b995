"""Certifies an answer from the problem alone: the optimality conditions, level by level, independent of every solver.

At x level k is optimal below the levels above it when (Nocedal and Wright 2006, theorem 12.1)

    A_k' w_k + sum_fixed a_i nu_i + sum_active s_i a_i mu_i = 0,    mu_i >= 0,

where all a_i belong to levels above k: *fixed* rows are equalities, violated inequalities (their optimal slack is
unique, hence their value is) and rows whose multiplier was positive at a level above; *active* rows are met
inequalities at a bound, s_i = +1 at upper and -1 at lower.  The gap is the length of what is left of A_k' w_k in
the null space of the fixed rows once the best mu >= 0 is taken away.  Levels are judged at the same x, so level
k's verdict means something only if the levels above it pass: all of them are needed.

A level with a price is judged at the optimum x_k of its own stage, the witness: x_k lies in the set that the levels
above leave, and with mu >= 0 for the active rows of that set

    A_k' u + c_k F'(F x_k - f) + sum_fixed a_i nu_i + sum_active s_i a_i mu_i = 0,

u = w_k / ||w_k|| where the level is not met, and some ||u|| <= 1 where it is.  The answer x is then judged as above on
the exact hierarchy in which every priced level is replaced by what it hands down (hqp.pricing).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hqp.arrays import Index, Mat, Vec, longest_row, row_lengths
from hqp.errors import ProblemError
from hqp.graded import is_graded, pull
from hqp.nnls import nonnegative_least_squares
from hqp.null_directions import without_rounding
from hqp.pricing import Coordinates, after_stages, feasible_set, is_met, stage_price
from hqp.problem import Hierarchy, Rows
from hqp.tolerances import (
    CERTIFIED_RANK_TOLERANCE,
    EITHER_RANK,
    LARGEST_ROUNDING,
    LOCK_TOLERANCE,
    NULL_SPACE_ROUNDING,
    ROUNDING,
    SMALLEST_LOCK,
)


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Verdict on an answer.

    gaps: ``(levels + 1,)``, dimensionless, the completion (metric, origin, least norm) last.  Level k's is the
    projected gradient divided by r_k (r_k + max |w_k| + max_i sum_j |a_ij x_j|), r_k its largest row norm: about the
    relative error of x in the directions that the level determines well, and blind to the scale of a level. Where its
    rows differ in length by more than 100 (hqp.graded) it is what the step to the best point on the face of the active
    rows takes away of a row, relative to its length, or the gradient there, divided by the sum of what the rows pull
    that the face cannot meet: errors in directions that only short rows determine show as well.
    norms: ``(levels,)``, ||w_k||.  ranks: ``(levels + 1,)``, directions that each level fixed.
    multipliers: per level k ``(m_0 + ... + m_k,)``, as in Solution.multipliers.
    rounding: ``(levels + 1,)``, the part of a gap that rounding of the rows above may have made (5e-7 at most): 4e-15
    times the multipliers, and times the inverse of the shortest direction that they fix.
    """

    gaps: Vec
    tolerance: float
    norms: Vec
    ranks: tuple[int, ...]
    multipliers: tuple[Vec, ...]
    rounding: Vec | float = 0.0

    @property
    def ok(self) -> bool:
        """Whether every gap is within the tolerance and its rounding."""
        return bool(np.all(self.gaps <= self.tolerance + self.rounding))

    @property
    def gap(self) -> float:
        """The largest gap."""
        return float(self.gaps.max(initial=0.0))

    def __str__(self) -> str:
        gaps = ", ".join(f"{gap:.1e}" for gap in self.gaps)
        return f"{'optimal' if self.ok else 'NOT optimal'} within {self.tolerance:g}: gaps {gaps}"


def certificate(
    problem: Hierarchy, x: Vec, tolerance: float = 1e-6, stages: Mat | None = None, *, settled: bool = False
) -> Certificate:
    """Whether x solves the problem, level by level and completion included.

    x: ``(n,)``; a value that is not finite has infinite gaps.  tolerance: on the gaps, and on how far from its
    bound a row still counts as active, relative to its terms.  stages: ``(levels, n)``, Solution.stage_points of a
    priced problem; what it lacks (NaN) is computed by the reference solver, which takes long, or with ``settled``
    believed to be met for its price by x.  Raises ProblemError for a wrong shape.
    """
    x = np.asarray(x, dtype=np.float64)
    if x.shape != (problem.n,):
        raise ProblemError(f"certificate: x has shape {x.shape}, the problem has n = {problem.n}")
    if not np.isfinite(x).all():
        levels = len(problem.levels)
        nothing = tuple(np.zeros(sum(r.m for r in problem.levels[: k + 1])) for k in range(levels))
        return Certificate(
            np.full(levels + 1, np.inf), tolerance, np.full(levels, np.inf), (0,) * (levels + 1), nothing
        )
    problem = without_rounding(problem)
    if problem.priced:
        return _priced(problem, x, tolerance, stages, settled)
    first: Certificate | None = None
    for rank in (
        CERTIFIED_RANK_TOLERANCE,
        CERTIFIED_RANK_TOLERANCE / EITHER_RANK,
        CERTIFIED_RANK_TOLERANCE * EITHER_RANK,
    ):
        for lock in (max(LOCK_TOLERANCE, 10.0 * tolerance), SMALLEST_LOCK):
            verdict, unclear = _verdict(problem, x, tolerance, lock, rank)
            if verdict.ok:
                return verdict
            first = first or verdict
        if not unclear:
            break
    assert first is not None
    return first


def _priced(problem: Hierarchy, x: Vec, tolerance: float, stages: Mat | None, settled: bool) -> Certificate:
    from hqp.solvers.reference import witness  # a solver: needed only where the caller has no witness

    problem = _without_rounding_levels(problem)
    if stages is not None and stages.shape != (len(problem.levels), problem.n):
        raise ProblemError(f"certificate: stages must be {(len(problem.levels), problem.n)}, given {stages.shape}")
    if settled:
        known = np.full((len(problem.levels), problem.n), np.nan) if stages is None else stages
    else:
        known = witness(problem, stages)
    at = Coordinates.of(problem.motion, problem.n)
    exact = after_stages(problem, known, at)
    final = certificate(exact, x, tolerance)
    gaps = final.gaps.copy()
    for k, priced in enumerate(problem.priced):
        lacking = np.isnan(known[: k + 1, 0])[np.array(problem.priced[: k + 1])].any()
        if priced and not lacking and _asks(problem.levels[k], problem.n):
            gaps[k] = max(gaps[k], _stage_gap(problem, known, k, x, at, tolerance))
    norms = np.array([float(np.linalg.norm(w)) for w in problem.slacks(x)])
    own = [rows.m for rows in problem.levels]
    places = [np.arange(m) + sum(rows.m for rows in exact.levels[:k]) for k, m in enumerate(own)]
    multipliers = tuple(final.multipliers[k][np.concatenate(places[: k + 1])] for k in range(len(own)))
    return Certificate(gaps, tolerance, norms, final.ranks, multipliers, final.rounding)


def _without_rounding_levels(problem: Hierarchy) -> Hierarchy:
    """The problem with zeros for levels that have no row above rounding: no solver follows them."""
    longest = [longest_row(rows.dense(problem.n)) for rows in problem.levels]
    none = [0.0 < length <= ROUNDING * max(longest) for length in longest]
    if not any(none):
        return problem
    levels = [
        Rows(np.zeros((rows.m, problem.n)), rows.lower, rows.upper) if zero else rows
        for rows, zero in zip(problem.levels, none, strict=True)
    ]
    return replace(problem, levels=tuple(levels), stacked=None)


def _asks(rows: Rows, n: int) -> bool:
    """Whether a row has a direction and a bound: a level of others has no stage."""
    return bool(np.any(rows.dense(n)[np.isfinite(rows.lower) | np.isfinite(rows.upper)]))


def stage_multipliers(problem: Hierarchy, stages: Mat, level: int, tolerance: float = 1e-6) -> tuple[Vec, float]:
    """Multipliers of the rows above an unmet priced level in its own stage ``(m_0 + ... + m_{k-1},)``, and its gap.

    A_k'u + c F'(F x_k - f) + sum_{j<k} A_j' lambda_j = 0 with u = w_k / ||w_k||; a guard's multiplier is shared out
    among the rows of its level as their part of it.  stages: ``(levels, n)``, as ``certificate`` takes them.
    """
    at, x_k, rows = Coordinates.of(problem.motion, problem.n), stages[level], problem.levels[level]
    stages = np.where(np.isnan(stages), x_k, stages)  # what needed no stage is met, here as well
    judge, above = _stage_judge(problem, stages, level, at, tolerance)
    A, y = at.rows(rows.dense(problem.n)), at.motion(x_k)
    w, price = rows.slack(x_k), stage_price(problem, stages, level)
    scale = longest_row(A) + price * float(np.linalg.norm(y))
    norm = float(np.linalg.norm(w))
    if not norm > 0.0 or not scale > 0.0:
        return np.zeros(sum(r.m for r in problem.levels[:level])), 0.0
    gap, shares = judge.judge(A.T @ (w / norm) + price * y, scale)
    found, here = [], 0
    for j in range(level):
        m = problem.levels[j].m
        own = shares[here : here + m].copy()
        here += m
        if problem.priced[j]:
            guard = above.A[here]  # type: ignore[index]  # its rows combined with u_j, of which it is the sum
            if shares[here] != 0.0 and np.any(guard):
                dense = problem.levels[j].dense(problem.n)
                own += shares[here] * np.linalg.lstsq(dense.T, guard, rcond=None)[0]
            here += 1
        found.append(own)
    return np.concatenate([np.zeros(0), *found]), gap


def _stage_judge(problem: Hierarchy, stages: Mat, k: int, at: Coordinates, tolerance: float) -> tuple[_Judge, Rows]:
    """The judge of level k's stage after the levels above, and the set that those leave, as rows."""
    x_k = stages[k]
    above = feasible_set(problem, stages, k, x_k, at)
    raw = above.dense(problem.n)
    judge = _Judge(problem.n, tolerance, LOCK_TOLERANCE)
    C, shift, y = at.rows(raw), raw @ at.still, at.motion(x_k)
    lengths = row_lengths(C)
    zero = ROUNDING * float(lengths.max(initial=0.0))
    judge.descend(C, C @ y, above.lower - shift, above.upper - shift, lengths, _terms(C, y), zero)
    return judge, above


def _stage_gap(problem: Hierarchy, stages: Mat, k: int, x: Vec, at: Coordinates, tolerance: float) -> float:
    """How far x_k is from the set that the levels above leave, and from the optimality conditions on it."""
    x_k, rows = stages[k], problem.levels[k]
    A = at.rows(rows.dense(problem.n))  # in coordinates in which E is 1/2 ||y||^2
    price = stage_price(problem, stages, k)
    judge, above = _stage_judge(problem, stages, k, at, tolerance)
    exact = [j for j in range(k) if not problem.priced[j]]
    moved = [float(np.abs(problem.levels[j].slack(x_k) - problem.levels[j].slack(x)).max(initial=0.0)) for j in exact]
    raw = above.dense(problem.n)
    lengths = row_lengths(raw)
    real = lengths > ROUNDING * lengths.max(initial=0.0)
    outside = np.divide(np.abs(above.slack(x_k)), lengths + _terms(raw, x_k), out=np.zeros(above.m), where=real)
    gap = _conditions(judge, A, rows, x_k, price * at.motion(x_k))
    size = 1.0 + float(np.abs(x_k).max(initial=0.0))
    return max(gap, float(outside.max(initial=0.0)), max(moved, default=0.0) / size)


def _conditions(judge: _Judge, A: Mat, rows: Rows, x: Vec, motion: Vec) -> float:
    """Gap of A'u + c y + (rows above) = 0, with u = w / ||w|| or, where w = 0, the shortest u that will do."""
    w = rows.slack(x)
    longest = longest_row(A)
    scale = longest + float(np.linalg.norm(motion))
    if scale == 0.0:
        return 0.0
    if not is_met(rows, x):
        return judge.judge(A.T @ (w / np.linalg.norm(w)) + motion, scale)[0]
    active = np.flatnonzero((judge.side != 0.0) & ~judge.fixed)
    cone = (judge.side[active, None] * (judge.unit[active] @ judge.Z)).T
    value = rows.A @ x
    slop = judge.tolerance * (row_lengths(rows.dense(x.size)) + _terms(rows.dense(x.size), x))
    upper, lower = value >= rows.upper - slop, value <= rows.lower + slop
    U = np.concatenate([A[upper], -A[lower]])
    small = 1e-7 * np.eye(len(U))
    pull = -(motion @ judge.Z) / scale
    G = np.block([[(U @ judge.Z).T / scale, cone], [small, np.zeros((len(U), active.size))]])
    both = nonnegative_least_squares(G, np.concatenate([pull, np.zeros(len(U))]))
    u = np.zeros(rows.m)
    u[upper] += both[: int(upper.sum())]
    u[lower] -= both[int(upper.sum()) : len(U)]
    gap = float(np.linalg.norm(pull - G[: pull.size] @ both))
    return max(gap, float(np.linalg.norm(u)) - 1.0)


def _verdict(problem: Hierarchy, x: Vec, tolerance: float, lock: float, rank: float) -> tuple[Certificate, bool]:
    """The certificate under one reading of locks and ranks; whether a rank may be read otherwise."""
    judge = _Judge(problem.n, tolerance, lock, rank)
    gaps, norms, ranks, multipliers, rounding = [], [], [], [], []
    dense = [rows.dense(problem.n) for rows in problem.levels]
    every = [row_lengths(A) for A in dense]
    zero = ROUNDING * max((float(lengths.max(initial=0.0)) for lengths in every), default=0.0)
    for rows, A, lengths in zip(problem.levels, dense, every, strict=True):
        w, terms = rows.slack(x), _terms(A, x)
        longest = float(lengths.max(initial=0.0))
        if longest <= zero:
            longest = 0.0
        scale = longest * (longest + np.abs(w).max(initial=0.0) + terms.max(initial=0.0))
        missed = np.where(np.abs(w) > NULL_SPACE_ROUNDING * terms, w, 0.0)  # what is less is rounding of the terms
        if is_graded(lengths, zero) and np.any(missed):
            gap, shares = judge.judge_graded(A, rows, missed, np.where(lengths > zero, lengths, 0.0), x)
        else:
            gap, shares = judge.judge(A.T @ missed, scale)
        gaps.append(gap)
        rounding.append(judge.rounding)
        norms.append(float(np.linalg.norm(w)))
        multipliers.append(np.concatenate([shares, w]))
        ranks.append(judge.descend(A, A @ x, rows.lower, rows.upper, lengths, terms, zero))
    gap, last = _completion(problem, x, judge)
    rounding.append(judge.rounding)
    found = Certificate(
        np.array([*gaps, gap]), tolerance, np.array(norms), (*ranks, last), tuple(multipliers), np.array(rounding)
    )
    return found, judge.unclear


def _completion(problem: Hierarchy, x: Vec, judge: _Judge) -> tuple[float, int]:
    """Gap of min (x - origin)' metric (x - origin), then of min ||x|| where the metric leaves a choice."""
    offset = x if problem.origin is None else x - problem.origin
    size = 1.0 + float(np.abs(x).max(initial=0.0)) + float(np.abs(offset).max(initial=0.0))
    if problem.metric is None:
        return judge.judge(offset, size)[0], judge.Z.shape[1]
    longest = longest_row(problem.metric)
    gap, _ = judge.judge(problem.metric @ offset, longest * size)
    before = judge.Z.shape[1]
    if longest > 0.0:
        judge.fix(problem.metric / longest)
    return max(gap, judge.judge(x, size)[0]), before - judge.Z.shape[1]


class _Judge:
    """What the levels above leave: a basis Z of the null space of fixed rows, and the active rows' cone."""

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
        self._positive = np.zeros(0, dtype=bool)
        self._own: Index = np.zeros(0, dtype=np.intp)  # rows of the level just judged that have a multiplier themselves

    @property
    def rounding(self) -> float:
        """What rounding of the rows, those that were fixed and those with a multiplier, may have made of the gap."""
        return min(NULL_SPACE_ROUNDING * (1.0 / self.shortest + self._forces), LARGEST_ROUNDING)

    def judge_graded(self, A: Mat, rows: Rows, slack: Vec, lengths: Vec, x: Vec) -> tuple[float, Vec]:
        """The same of A' slack where rows of the level differ in length; lengths: zero for a row that counts as none.

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
        held = np.concatenate([self.unit[(self.side != 0.0) & ~self.fixed], unit[own]]) @ self.Z
        _, sigma, Vt = np.linalg.svd(held, full_matrices=True)
        along, face = np.split(Vt, [int(np.count_nonzero(sigma > self.rank))])
        left = np.flatnonzero((lengths > 0.0) & (side == 0.0) & ((slack != 0.0) | equality))
        B = A[left] @ self.Z
        found = pull(B @ face.T, B @ along.T, slack[left], lengths[left], size, self.tolerance)
        gap, shares = self.judge(self.Z @ (along.T @ found.along), found.size, own, side[own, None] * unit[own])
        return max(gap, found.taken), shares

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
        force = mu * np.linalg.norm(cone, axis=0)  # in the null space: what the level rises by, a unit step off the row
        positive = force > max(self.lock, 100.0 * gap)  # what the gap could have made says nothing
        self._positive[active] = positive[: active.size]
        if own is not None:
            self._own = own[positive[active.size :]]
        rest = -gradient / scale - self.unit.T @ shares
        if normals is not None:
            rest -= normals.T @ mu[active.size :]
        if self.fixed.any():
            shares[self.fixed] = np.linalg.lstsq(self.unit[self.fixed].T, rest, rcond=1e-12)[0]
        return gap, scale * np.divide(shares, self.lengths, out=shares, where=self.lengths > 0.0)

    def descend(self, A: Mat, value: Vec, lower: Vec, upper: Vec, lengths: Vec, terms: Vec, zero: float) -> int:
        """Take in the level just judged; return how many directions it fixed.  zero: rows of this length have none."""
        floor = max(1e-13 * lengths.max(initial=0.0), zero)
        real = lengths > floor
        unit = np.divide(A, lengths[:, None], out=np.zeros_like(A), where=real[:, None])
        slop = self.tolerance * (lengths + terms)
        at_upper, at_lower = value >= upper - slop, value <= lower + slop
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
        self._positive = np.zeros(self.side.size, dtype=bool)
        return self.fix(np.concatenate([locked, unit[fixed]]))

    def fix(self, rows: Mat) -> int:
        """Shrink Z to the null space of rows of about unit length; return by how much."""
        projected = rows @ self.Z
        if not projected.size:
            return 0
        _, sigma, Vt = np.linalg.svd(projected, full_matrices=True)
        rank = int(np.count_nonzero(sigma > self.rank))
        ratio = sigma / CERTIFIED_RANK_TOLERANCE
        self.unclear |= bool(np.any((ratio > 1.0 / EITHER_RANK) & (ratio < EITHER_RANK)))
        self.shortest = min(self.shortest, float(sigma[:rank].min(initial=1.0)))
        self.Z = self.Z @ Vt[rank:].T
        return rank


def _terms(A: Mat, x: Vec) -> Vec:
    """sum_j |a_ij x_j| of each row: the size that rounding of a_i x is relative to."""
    return np.asarray(np.abs(A) @ np.abs(x))
