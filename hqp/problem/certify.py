"""Certifies an answer from the problem alone: the optimality conditions, level by level, independent of every solver.

At x level k is optimal below the levels above it when (Nocedal and Wright 2006, theorem 12.1)

    A_k' w_k + sum_fixed a_i nu_i + sum_active s_i a_i mu_i = 0,    mu_i >= 0,

with all a_i in levels above k: *fixed* rows are equalities, violated inequalities (their optimal slack is unique, hence
their value is) and rows whose multiplier was positive at a level above; *active* rows are met inequalities at a bound,
s_i = +1 at upper and -1 at lower.  The gap is the length of the remainder of A_k' w_k in the null space of the fixed
rows after subtracting the best mu >= 0.  Levels are judged at the same x, so level k's verdict means something only if
the levels above it pass: all of them are needed.

Levels with a price, and those below one that is not met, are judged in stages of their own
(hqp.problem.stage_conditions).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from hqp.arrays import Mat, Vec, longest_row, row_lengths
from hqp.errors import ProblemError
from hqp.problem import Hierarchy, Rows
from hqp.problem.completion import Choice, metric_factor, unseen
from hqp.problem.graded import Errors, is_graded
from hqp.problem.judge import Judge, terms
from hqp.problem.null_directions import without_rounding
from hqp.problem.stage_conditions import Walk
from hqp.tolerances import (
    CERTIFIED_RANK_TOLERANCE,
    EITHER_RANK,
    LOCK_TOLERANCE,
    NULL_SPACE_ROUNDING,
    ROUNDING,
    SMALLEST_LOCK,
)


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Verdict on an answer.

    gaps: ``(levels + 1,)``, dimensionless, the completion (metric, origin, choice) last.  Level k's is the
    projected gradient divided by r_k (r_k + max |w_k| + max_i sum_j |a_ij x_j|), r_k its largest row norm: about the
    relative error of x in the directions that the level determines well, and blind to the scale of a level; or, if that
    is more, the possible decrease of ||w_k|| along clear directions, relative to its terms. If its rows differ in
    length by more than 100 (see graded), the gap is the reduction of a row by the step to the best point on the face of
    the active rows, relative to the row's length, or the gradient there, divided by the sum of the row pulls that the
    face cannot meet: errors in directions that only short rows determine show as well.  A row above that this step
    reaches before it reduces a row by the tolerance is active.
    norms: ``(levels,)``, ||w_k||.
    ranks: ``(levels + 1,)``, directions that each level fixed.  multipliers: per level k ``(m_0 +... + m_k,)``, as in
    Solution.multipliers.  rounding: ``(levels + 1,)``, the part of a gap that rounding of the rows above may have made
    (5e-7 at most): 4e-15 times the multipliers, and times the inverse of the shortest direction that they fix; for the
    completion ROUNDED times its multipliers, if that is more, because nearly opposed rows have large ones.
    """

    gaps: Vec
    tolerance: float
    norms: Vec
    ranks: tuple[int, ...]
    multipliers: tuple[Vec, ...]
    rounding: Vec | float = 0.0

    @property
    def ok(self) -> bool:
        """Return true if every gap is within the tolerance and its rounding."""
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
    """Check that x solves the problem, level by level and completion included.

    x: ``(n,)``; a value that is not finite has infinite gaps.  tolerance: on the gaps, and on how far from its bound a
    row still counts as active, relative to its terms.  stages: ``(levels, n)``, Solution.stage_points of a priced
    problem; missing points (NaN) are computed by the reference solver, which is slow, or with ``settled`` the levels
    are assumed to be met for their price by x.  Raises ProblemError for a wrong shape.
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
    choice = Choice(problem, x)  # of the problem as given: it moves by 1e5 times an error of its directions
    given, problem = problem, without_rounding(problem)

    def judged(at: Vec) -> Certificate:
        if problem.priced:
            return _priced(problem, at, tolerance, stages, settled, given)
        return _exact(problem, at, tolerance)

    points = choice.within()  # equal to x in all directions that levels determine: one that passes is a proof
    found = judged(next(points))
    for at in points:
        if found.ok:
            break
        if (verdict := judged(at)).ok:
            found = verdict
    gaps = found.gaps.copy()
    apart = float(np.linalg.norm(x - choice.minimum()))
    gaps[-1] = max(gaps[-1], apart / (1.0 + float(np.linalg.norm(x))))
    return replace(found, gaps=gaps)


def _exact(problem: Hierarchy, x: Vec, tolerance: float, stop: int | None = None) -> Certificate:
    """The verdict on an exact hierarchy; stop: on its first levels alone, without completion."""
    first: Certificate | None = None
    for rank in (
        CERTIFIED_RANK_TOLERANCE,
        CERTIFIED_RANK_TOLERANCE / EITHER_RANK,
        CERTIFIED_RANK_TOLERANCE * EITHER_RANK,
    ):
        for lock in (max(LOCK_TOLERANCE, 10.0 * tolerance), SMALLEST_LOCK):
            verdict, unclear = _verdict(problem, x, tolerance, lock, rank, stop)
            if verdict.ok:
                return verdict
            first = first or verdict
        if not unclear:
            break
    assert first is not None
    return first


def _priced(
    problem: Hierarchy, x: Vec, tolerance: float, stages: Mat | None, settled: bool, given: Hierarchy
) -> Certificate:
    """Above the first level that is not met the exact conditions at x; from there on, and of every price, stages.

    given: the problem with the rounding of its rows."""
    problem, count = _without_rounding_levels(problem), len(problem.levels)
    if stages is not None and stages.shape != (count, problem.n):
        raise ProblemError(f"certificate: stages must be {(count, problem.n)}, given {stages.shape}")
    pairs = zip(given.levels, problem.levels, strict=True)
    turned = np.concatenate([rows.dense(x.size) - clean.dense(x.size) for rows, clean in pairs])
    walk = Walk(problem, x, tolerance, stages, settled, turned)
    found = list(walk)
    first = next((k for k, stage in enumerate(found) if stage.unmet), None)
    exact = _exact(problem.exact(), x, tolerance, first)
    if first is None:
        gaps = np.maximum(exact.gaps, [*(stage.gap for stage in found), 0.0])
        rounding = np.maximum(exact.rounding, [*(stage.rounding for stage in found), 0.0])
        return replace(exact, gaps=gaps, rounding=rounding)
    gaps = np.array([max(stage.gap, out) for stage, out in zip(found, walk.outside(x), strict=True)])
    gaps[:first] = np.maximum(gaps[:first], exact.gaps)
    gap, last = completion_gap(problem, x, judge := walk.below())
    free = [*(stage.free for stage in found[first:]), judge.Z.shape[1]]
    ranks = (*exact.ranks, *(before - after for before, after in pairwise(free)), last)
    norms = np.array([float(np.linalg.norm(w)) for w in problem.slacks(x)])
    multipliers = (*exact.multipliers, *(stage.multipliers for stage in found[first:]))
    rounding = np.array([*(stage.rounding for stage in found), judge.choice_rounding])
    rounding[:first] = np.maximum(rounding[:first], exact.rounding)
    return Certificate(np.append(gaps, gap), tolerance, norms, ranks, multipliers, rounding)


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


def _verdict(
    problem: Hierarchy, x: Vec, tolerance: float, lock: float, rank: float, stop: int | None
) -> tuple[Certificate, bool]:
    """The certificate under one reading of locks and ranks; also return true if another reading of a rank is
    possible."""
    judge = Judge(problem.n, tolerance, lock, rank)
    gaps, norms, ranks, multipliers, rounding = [], [], [], [], []
    dense = [rows.dense(problem.n) for rows in problem.levels]
    every = [row_lengths(A) for A in dense]
    zero = ROUNDING * max((float(lengths.max(initial=0.0)) for lengths in every), default=0.0)
    far = float(np.linalg.norm(x))
    for rows, A, lengths in list(zip(problem.levels, dense, every, strict=True))[:stop]:
        w, sizes = rows.slack(x), terms(A, x)
        longest = float(lengths.max(initial=0.0))
        if longest <= zero:
            longest = 0.0
        scale = longest * (longest + np.abs(w).max(initial=0.0) + sizes.max(initial=0.0))
        least = NULL_SPACE_ROUNDING * np.maximum(sizes, far * lengths)  # rounding, if less
        missed = np.where(np.abs(w) > least, w, 0.0)
        if is_graded(lengths, zero) and np.any(missed):
            own = np.where(lengths > zero, lengths, 0.0)
            gap, shares = judge.judge_graded(A, rows, missed, own, x, Errors.none(rows.m))
        else:
            counted, before = (missed != 0.0) | rows.equality, 0.0
            pull, at = A.T @ missed, (A, rows, missed, sizes, counted, x)
            gap, shares = judge.judge(pull, scale)
            fall = judge.fall(*at) if longest > 0.0 else 0.0
            if max(gap, fall) > tolerance + judge.rounding:
                own = counted & (lengths > zero)
                before = judge.hold(A[own], missed[own], lengths[own], x, np.zeros((0, problem.n)))
                gap, shares = judge.judge(pull, scale)
                fall = judge.fall(*at)
            gap = max(gap, fall, before)
        gaps.append(gap)
        rounding.append(judge.rounding)
        norms.append(float(np.linalg.norm(w)))
        multipliers.append(np.concatenate([shares, w]))
        ranks.append(judge.descend(A, A @ x, rows.lower, rows.upper, lengths, sizes, zero, far))
    if stop is None:
        gap, last = completion_gap(problem, x, judge)
        gaps.append(gap)
        ranks.append(last)
        rounding.append(judge.choice_rounding)
    found = Certificate(
        np.array(gaps), tolerance, np.array(norms), tuple(ranks), tuple(multipliers), np.array(rounding)
    )
    return found, judge.unclear


def completion_gap(problem: Hierarchy, x: Vec, judge: Judge) -> tuple[float, int]:
    """Gap of min (x - origin)' metric (x - origin), then of min ||x|| where levels see what the metric leaves."""
    offset = x if problem.origin is None else x - problem.origin
    size = 1.0 + float(np.abs(x).max(initial=0.0)) + float(np.abs(offset).max(initial=0.0))
    before, gap, unit = judge.Z.shape[1], 0.0, np.eye(problem.n)
    if problem.metric is None:
        return _tie(judge, unit, offset, size, x), before
    F, longest = metric_factor(problem.metric), longest_row(problem.metric)
    if longest > 0.0:
        F /= math.sqrt(longest)
        gap = _tie(judge, F[np.any(F, axis=1)], offset, size, x)
        before = judge.Z.shape[1]
        judge.fix(problem.metric / longest)
    judge.fix(unseen(problem).T)
    return max(gap, _tie(judge, unit, x, size, x)), before - judge.Z.shape[1]


def _tie(judge: Judge, F: Mat, offset: Vec, size: float, x: Vec) -> float:
    """Gap of min ||F offset||; rows that the best step reaches before it counts are active."""
    gap, before = judge.judge(F.T @ (F @ offset), size)[0], 0.0
    if gap > judge.tolerance + judge.choice_rounding:
        before = judge.hold(F, F @ offset, row_lengths(F), x, np.zeros((0, x.size)))
        gap = judge.judge(F.T @ (F @ offset), size)[0]
    return max(gap, before)
