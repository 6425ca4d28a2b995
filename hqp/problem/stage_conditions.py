"""Optimality conditions of the stages of a priced hierarchy (hqp.problem.pricing), from its rows alone.

At the stage point x_k of a level under the rows S_{k-1} and anchors R_k of the levels above, with mu >= 0 for active
rows,

    A_k' u + c_k (F'(F x_k - f) + grad R_k(x_k)) + sum_fixed a_i nu_i + sum_active s_i a_i mu_i = 0,

u = w_k / ||w_k|| where a level with a price is not met, some ||u|| <= 1 where it is; u = w_k where it has no price,
with grad R_k alone.  The force of an anchored row, a_i (x_k - x_a) / (eta c_a omega_a), and u are quotients of small
numbers, and the turning term is large far out of reach: each is known only as accurately as x_k meets its row, so the
check allows the resulting error. If rows of the level or of anchors differ in length, and the level is not met, they
are judged row by row (hqp.problem.graded).

A level without a price below unmet ones is judged at its stage point, if the solver returned it, or at the answer; if
both are refused, at the point that the reference solver finds from the rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hqp.arrays import Mat, Vec, longest_row, row_lengths
from hqp.problem import Hierarchy, Rows
from hqp.problem.definition import solve_level
from hqp.problem.graded import Errors, is_graded
from hqp.problem.judge import Judge, terms
from hqp.problem.nnls import nonnegative_least_squares
from hqp.problem.pricing import Above, Coordinates, is_met, stack_rows
from hqp.tolerances import LOCK_TOLERANCE, NULL_SPACE_ROUNDING, ROUNDING

SHORTEST, WITHIN = 1e-7, 1e-9
"""Weight of a unit of u, and of the allowance, relative to the gap: the least that will do is taken."""

SHORTER = 1e-12
"""Second weight of u, if the first fails: its rows may be so much shorter than others."""

ENDED = 1e-15
"""Share of its sum of squares: stop distributing the allowance when a step lowers it by less."""


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """Verdict on one stage point.

    multipliers: ``(m_0 + ... + m_k,)``, of the rows above and then u.  free: directions that S_{k-1} leaves, n above
    the first unmet level.  rounding: possible effect of rounding of the rows above on the gap, see Certificate.
    """

    x: Vec
    gap: float
    multipliers: Vec
    free: int
    unmet: bool
    rounding: float = 0.0


class Walk:
    """Yield the stages of a hierarchy from first to last, each below the results of those before it."""

    def __init__(
        self, problem: Hierarchy, x: Vec, tolerance: float, known: Mat | None, settled: bool, turned: Mat | None = None
    ) -> None:
        """x: the answer.  known: ``(levels, n)`` stage points, NaN if the reference solver is to find them, or with
        ``settled`` if those of priced levels are believed to be x.  turned: ``(rows, n)``, the error of every row."""
        self._problem, self._x, self._tolerance, self._settled = problem, x, tolerance, settled
        self._known = np.full((len(problem.levels), problem.n), np.nan) if known is None else known
        self._at = Coordinates.of(problem.motion, problem.n)
        self._above, self._last = Above.none(problem.n), x
        self._start = np.zeros(x.size)  # of searches: a way from an answer far away would leave its rounding
        self._zero = ROUNDING * max((longest_row(rows.dense(problem.n)) for rows in problem.levels), default=0.0)
        self._turned = np.zeros((sum(rows.m for rows in problem.levels), x.size)) if turned is None else turned

    def __iter__(self) -> Iterator[Stage]:
        problem = self._problem
        for k, rows in enumerate(problem.levels):
            price = 0.0 if problem.prices is None else float(problem.prices[k])
            stage = self._priced(k, rows, price) if price > 0.0 else self._unpriced(k, rows)
            if price > 0.0 or self._above.anchors:
                self._start = stage.x
            elif self._missing(k):
                self._start = self._solve(rows, 0.0)
            self._last = stage.x
            A = rows.dense(problem.n)
            near = self._tolerance * (row_lengths(A) + terms(A, stage.x))  # allowed distance of a row from S
            self._above = self._above.after(problem, k, stage.x, self._at, near)
            yield stage

    def _missing(self, k: int) -> bool:
        """Return true if the point of a priced level after level k is to be found."""
        priced = self._problem.priced[k + 1 :]
        return not self._settled and any(
            price and np.isnan(point[0]) for price, point in zip(priced, self._known[k + 1 :], strict=True)
        )

    def below(self) -> Judge:
        """The judge of the completion, after the last stage."""
        return _judge(self._completed(), Coordinates.of(None, self._x.size), self._x, self._tolerance)

    def outside(self, x: Vec) -> Vec:
        """Distance of x from the rows of each level, ``(levels,)``, relative to their terms."""
        below = self._completed()
        ends = np.cumsum([rows.m for rows in self._problem.levels])
        found = np.zeros(ends.size)
        named = below.places >= 0
        np.maximum.at(found, np.searchsorted(ends, below.places[named], side="right"), _outside(below.hard, x)[named])
        return found

    def _completed(self) -> Above:
        priced = self._problem.priced
        return self._above.completed(self._last, bool(priced) and priced[-1], self._at)

    def _priced(self, k: int, rows: Rows, price: float) -> Stage:
        point = self._known[k]
        if np.isnan(point[0]):
            if self._settled:
                return self._unjudged(k, self._x)
            stage = self.judged(k, rows, self._x, price) if _asks(rows, point.size) else self._unjudged(k, self._x)
            if stage.gap <= self._tolerance + stage.rounding:
                return stage
            point = self._solve(rows, price)
        return self.judged(k, rows, point, price) if _asks(rows, point.size) else self._unjudged(k, point)

    def _unpriced(self, k: int, rows: Rows) -> Stage:
        if not self._above.anchors or not _asks(rows, self._x.size):
            return self._unjudged(k, self._x)
        points = [self._x] if np.isnan(self._known[k, 0]) else [self._known[k], self._x]
        for point in points:
            stage = self.judged(k, rows, point, 0.0)
            if stage.gap <= self._tolerance + stage.rounding:
                return stage
        return self.judged(k, rows, self._solve(rows, 0.0), 0.0)

    def _solve(self, rows: Rows, price: float) -> Vec:
        return solve_level(rows, self._above, self._start, price, self._at)

    def _unjudged(self, k: int, x: Vec) -> Stage:
        unmet = self._problem.priced[k] and not is_met(self._problem.levels[k], x)
        exact = not unmet and not self._above.anchors  # the conditions at the answer count its directions
        free = x.size if exact else _judge(self._above, self._at, x, self._tolerance).Z.shape[1]
        return Stage(x, 0.0, np.zeros(sum(rows.m for rows in self._problem.levels[: k + 1])), free, unmet)

    def judged(self, k: int, rows: Rows, x: Vec, price: float) -> Stage:
        """The conditions at x, and how far it is outside of S."""
        at, w, within = self._at, rows.slack(x), self._tolerance
        judge = _judge(self._above, at, x, within)
        A, lengths, sizes = at.rows(rows.dense(x.size)), row_lengths(rows.dense(x.size)), rows.dense(x.size)
        near = within * (lengths + terms(sizes, x))
        met = price > 0.0 and is_met(rows, x)
        counted = np.concatenate([lengths, *(row_lengths(anchor.A) for anchor in self._above.anchors)])
        if not met and is_graded(counted, self._zero):
            return self._graded(judge, k, rows, x, price)
        gradient = price * at.motion(x)
        scale = float(np.linalg.norm(gradient)) + price  # errors below one unit of motion are absolute
        allowed = [np.zeros((0, x.size))]  # change of the gradient if a row is violated within the tolerance
        forces = np.zeros(sum(rows.m for rows in self._problem.levels[: k + 1]))
        counts = price if price > 0.0 else 1.0
        for anchor in self._above.anchors:
            B, force = at.rows(anchor.A), counts * anchor.rows.slack(x) / anchor.give
            turned = counts * at.rows((anchor.turning.T @ (anchor.turning @ (x - anchor.x)))[None])[0]
            gradient = gradient + B.T @ force + turned
            scale += longest_row(B) * float(np.abs(force).max(initial=0.0)) + float(np.linalg.norm(turned))
            slop = within * (row_lengths(anchor.A) + terms(anchor.A, x))
            allowed.append(B * (counts * slop / anchor.give)[:, None])
            forces[anchor.places] = force
            slows = anchor.turning[np.any(anchor.turning, axis=1)]
            slop = within * (row_lengths(slows) + terms(slows, x))
            allowed.append(at.rows(slows) * (counts * slop)[:, None])
        u, signed, value = w, np.zeros((0, x.size)), rows.A @ x
        at_upper, at_lower = value >= rows.upper - near, value <= rows.lower + near  # or beyond
        if met:
            signed = np.concatenate([A[at_upper], -A[at_lower]])
            scale += longest_row(A)
        elif price > 0.0:
            norm = float(np.linalg.norm(w))
            u = w / norm
            touched = at_upper | at_lower
            allowed.append(A[touched] * (near[touched] / norm)[:, None])
            scale += longest_row(A)
        else:
            scale += longest_row(A) * float(np.abs(w).max(initial=0.0) + (lengths + terms(sizes, x)).max(initial=0.0))
        if not met:
            gradient = gradient + A.T @ u
        if scale == 0.0:
            return replace(self._unjudged(k, x), gap=float(_outside(self._above.hard, x).max(initial=0.0)))
        parts = (gradient / scale, signed / scale, np.concatenate(allowed) / scale)
        gap, shares = _judged(judge, *parts, SHORTEST)
        if met and gap > within + judge.rounding:
            gap, shares = _judged(judge, *parts, SHORTER)
        forces[self._above.places] = scale * shares
        forces[forces.size - rows.m :] = u
        gap = max(gap, float(_outside(self._above.hard, x).max(initial=0.0)))
        return Stage(x, gap, forces, judge.Z.shape[1], price > 0.0 and not met, judge.rounding)

    def _graded(self, judge: Judge, k: int, rows: Rows, x: Vec, price: float) -> Stage:
        """Gap if rows differ in length: gap of min 1/2 ||w||^2 + m c (E + R), m = ||w|| at x, with rows of the level,
        of the motion and of the anchors."""
        at, w, n = self._at, rows.slack(x), x.size
        m = float(np.linalg.norm(w)) if price > 0.0 else 1.0
        counts = m * price if price > 0.0 else 1.0
        own = row_lengths(rows.dense(n)) > self._zero
        parts = [Rows(rows.dense(n) * own[:, None], np.where(own, rows.lower, 0.0), np.where(own, rows.upper, 0.0))]
        seen, errors, unsure = [at.rows(parts[0].dense(n))], [at.error(parts[0].dense(n))], [np.zeros(rows.m)]
        first = sum(level.m for level in self._problem.levels[:k])
        turned = [row_lengths(at.rows(self._turned[first : first + rows.m]))]
        if price > 0.0:
            y = np.diag(at.inverse) if at.inverse.ndim == 1 else at.inverse[: at.moving]
            parts.append(_fixed_at(np.sqrt(counts) * y, at.still))
            seen.append(np.sqrt(counts) * np.eye(at.moving, n))
            for exact in (errors, unsure, turned):
                exact.append(np.zeros(at.moving))
        for anchor in self._above.anchors:
            weight, turning = np.sqrt(counts / anchor.give), np.sqrt(counts) * anchor.turning
            A = weight * anchor.A
            parts.append(Rows(A, weight * anchor.rows.lower, weight * anchor.rows.upper))
            parts.append(_fixed_at(turning, anchor.x))
            seen += [at.rows(A), at.motion_rows(turning)]
            errors += [at.error(A), np.zeros(len(turning))]
            unsure += [np.zeros(len(A)), anchor.uncertain]
            turned += [weight * row_lengths(at.rows(self._turned[anchor.places])), np.zeros(len(turning))]
        whole, T = stack_rows(parts, n), np.concatenate(seen)
        shift = whole.A @ at.still
        moved = Rows(T, whole.lower - shift, whole.upper - shift)
        slack, y = whole.slack(x), at.of_point(x)
        known = Errors(np.concatenate(errors), np.concatenate(unsure) * np.abs(slack), np.concatenate(turned))
        last = k + 1 == len(self._problem.levels)  # the completion has all that its stage ends with
        counted = None if price > 0.0 or last else rows.m  # others without a price hand down their rows' values alone
        gap, shares = judge.judge_graded(T, moved, slack, row_lengths(T), y, known, counted)
        forces = np.zeros(sum(rows.m for rows in self._problem.levels[: k + 1]))
        for anchor in self._above.anchors:
            forces[anchor.places] = counts / m * anchor.rows.slack(x) / anchor.give
        forces[self._above.places] = shares / m
        forces[forces.size - rows.m :] = w / m
        gap = max(gap, float(_outside(self._above.hard, x).max(initial=0.0)))
        return Stage(x, gap, forces, judge.Z.shape[1], price > 0.0, judge.rounding)


def stage_multipliers(problem: Hierarchy, stages: Mat, level: int, tolerance: float = 1e-6) -> tuple[Vec, float]:
    """Multipliers of the rows above an unmet priced level in its own stage ``(m_0 + ... + m_{k-1},)``, and its gap.

    The multipliers of anchored rows are their forces.  stages: ``(levels, n)``, as ``certificate`` takes them.
    """
    walk = Walk(problem, stages[level], tolerance, stages, settled=True)
    for k, stage in enumerate(walk):
        if k == level:
            return stage.multipliers[: stage.multipliers.size - problem.levels[level].m], stage.gap
    raise IndexError(level)


def _fixed_at(A: Mat, x: Vec) -> Rows:
    """A at its value of a point."""
    return Rows(A, A @ x, A @ x)


def _judge(above: Above, at: Coordinates, x: Vec, tolerance: float) -> Judge:
    """The judge at a point of the set that the levels above leave."""
    judge = Judge(x.size, tolerance, LOCK_TOLERANCE)
    raw = above.hard.dense(x.size)
    C, shift, y = at.rows(raw), raw @ at.still, at.of_point(x)
    lengths = row_lengths(C)
    zero = ROUNDING * float(lengths.max(initial=0.0))
    far = float(np.linalg.norm(y))
    lower, upper = above.hard.lower - shift, above.hard.upper - shift
    judge.descend(C, C @ y, lower, upper, lengths, terms(C, y), zero, far, above.moved)
    return judge


def _judged(judge: Judge, gradient: Vec, signed: Mat, allowed: Mat, shortest: float) -> tuple[float, Vec]:
    """The gap of the gradient adjusted so, or of ||u|| beyond one, and the multipliers of the rows above."""
    adjusted, size = _adjusted(judge, gradient, signed, allowed, shortest)
    gap, shares = judge.judge(adjusted, 1.0)
    return max(gap, size - 1.0), shares


def _adjusted(judge: Judge, gradient: Vec, signed: Mat, allowed: Mat, shortest: float) -> tuple[Vec, float]:
    """Gradient with the shortest u >= 0 of the signed rows and, if that is not enough, with the allowance, -1 to 1 of
    each row; and ||u||."""
    active = np.flatnonzero((judge.side != 0.0) & ~judge.fixed)
    cone = (judge.side[active, None] * (judge.unit[active] @ judge.Z)).T
    fixed = np.concatenate([cone, (signed @ judge.Z).T], axis=1)
    left, weights = -(gradient @ judge.Z), np.repeat([0.0, shortest], [active.size, len(signed)])
    found = nonnegative_least_squares(*_weighted(fixed, weights, left))
    rest, change = left - fixed @ found, np.zeros(len(allowed))
    if len(allowed) and float(np.sqrt(rest @ rest)) > judge.tolerance:
        from scipy.optimize import lsq_linear  # heavy, and seldom needed

        most = np.maximum(row_lengths(projected := allowed @ judge.Z), 1.0)  # no column is longer than the gradient
        columns = np.concatenate([fixed, (projected / most[:, None]).T], axis=1)
        weights = np.concatenate([weights, WITHIN / most])
        upper = np.concatenate([np.full(found.size, np.inf), most])
        lower = np.concatenate([np.zeros(found.size), -most])
        bounded = lsq_linear(*_weighted(columns, weights, left), (lower, upper), method="bvls", tol=ENDED).x
        if np.linalg.norm(left - columns @ bounded) < np.linalg.norm(rest):  # else it ended early
            found, change = bounded[: found.size], bounded[found.size :] / most
    u = found[active.size :]
    return gradient + signed.T @ u + allowed.T @ change, float(np.linalg.norm(u))


def _weighted(columns: Mat, weights: Vec, target: Vec) -> tuple[Mat, Vec]:
    """Columns and target of least squares in which a unit of each unknown weighs something itself."""
    return np.concatenate([columns, np.diag(weights)]), np.concatenate([target, np.zeros(weights.size)])


def _outside(rows: Rows, x: Vec) -> Vec:
    """Distance of x from each row beyond rounding, relative to its length and terms; zero for rows that are
    rounding."""
    A = rows.dense(x.size)
    lengths = row_lengths(A)
    real = lengths > ROUNDING * lengths.max(initial=0.0)
    off = np.maximum(np.abs(rows.slack(x)) - NULL_SPACE_ROUNDING * float(np.linalg.norm(x)) * lengths, 0.0)
    return np.divide(off, lengths + terms(A, x), out=np.zeros(rows.m), where=real)


def _asks(rows: Rows, n: int) -> bool:
    """Mask of rows with a direction and a bound: a level of others has no stage."""
    return bool(np.any(rows.dense(n)[np.isfinite(rows.lower) | np.isfinite(rows.upper)]))
