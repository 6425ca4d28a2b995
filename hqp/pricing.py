"""What a priced level is: the coordinates in which motion is a length, and what a solved level hands down.

Level k of a hierarchy with a price c_k > 0 is solved in a stage of its own (docs/calm.md):

    x_k = argmin { ||w_k|| + c_k E(x) :  x in S_{k-1},  lower_k <= A_k x - w_k <= upper_k },     y_k = A_k x_k

and S_k adds the rows of level k as they are where ||w_k|| = 0, and otherwise

    |A_i x - y_i| <= eta ||w_k|| / sqrt(m_k)       on equality rows and violated rows,
    lower_i <= A_i x <= upper_i                    on met inequality rows,
    u'A_k x >= u'y_k - min(eta ||w_k||, made / 2 + phi eta ||w_k||)
        with u = -w_k / ||w_k||, made = u'A_k (x_k - x_still) > 0, phi the floor of the guard,

the last row, the guard, where the level has two rows or more; x_still is the point of least motion.

phi is hqp.pace.guard_of, and single coordinates in levels after the last price are slowed as hqp.pace says.

The price of a level below others that are not met.  Where rest costs nothing (velocities: F a diagonal, f = 0), a
pace p is given, and every coordinate that the rows of level k have is one that rows of unmet levels above it have (a
base below a hand out of reach; not a second hand, which has an arm of its own), its stage has the price

    c_k / max(1 / DEARER, 1 - LACKING max_a ||w_a|| / (c_a p^2))       over the unmet levels a above it.

The push of a price is the same however little is asked: against the band that an unmet level leaves in its nearly lost
directions, which turn as fast as the joints move, even a slow base is drawn from corner to corner (hqp.pace).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqp.arrays import Mask, Mat, Vec
from hqp.pace import coordinates_below, excess_below, guard_of, slowed
from hqp.problem import Hierarchy, Motion, Rows, Selection
from hqp.tolerances import FLAT_TOLERANCE, MET_TOLERANCE, SLACK_TOLERANCE

RESTING = 1e-4
"""Of x's largest entry: what an entry counts for at least in the size of a row's terms."""

DEARER, LACKING = 20.0, 0.0016
"""Below unmet levels the price of a level without a coordinate of its own rises to DEARER times its own, as if tau were
1 s for 0.05 s.  In a nearly lost direction the level moves at a speed that is inverse to its price, so the inverse
falls in proportion to what is missed, at 500 Hz to half where a hand misses by about 0.1 m/s: the base of
a Talos whose hand comes to be out of reach is then braked evenly."""

UNUSED = 1e-12
"""Of a row's largest entry: smaller ones are rounding, the row does not have that coordinate."""


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """x = still + P y with E(x) = 1/2 ||y||^2 + least: y is the motion away from the point of least motion.

    still: ``(n,)``.  P: ``(n, n)``, or ``(n,)`` for a diagonal matrix.  inverse: of P, of the same form.
    """

    still: Vec
    P: Mat | Vec
    inverse: Mat | Vec

    @staticmethod
    def of(motion: Motion | None, n: int) -> Coordinates:
        """The coordinates of a motion, 1/2 ||x||^2 for None."""
        if motion is None:
            return Coordinates(np.zeros(n), np.ones(n), np.ones(n))
        F, f = motion.F, motion.f
        if F.ndim == 1:
            return Coordinates(np.zeros(n) if f is None else f / F, 1.0 / F, F)
        flat = FLAT_TOLERANCE * float(np.sqrt(np.einsum("ij,ij->j", F, F).max(initial=0.0))) or 1.0
        Q, R = np.linalg.qr(np.concatenate([F, flat * np.eye(n)]))
        P = np.asarray(np.linalg.solve(R, np.eye(n)), dtype=np.float64)
        return Coordinates(np.zeros(n) if f is None else P @ (f @ Q[: F.shape[0]]), P, R)

    def rows(self, A: Mat) -> Mat:
        """A P, ``(m, n)``: rows on y."""
        return A * self.P if self.P.ndim == 1 else A @ self.P

    def point(self, y: Vec) -> Vec:
        """x of y, ``(n,)``."""
        return self.still + (self.P * y if self.P.ndim == 1 else self.P @ y)

    def motion(self, x: Vec) -> Vec:
        """y of x, ``(n,)``."""
        offset = x - self.still
        return np.asarray(self.inverse * offset if self.inverse.ndim == 1 else self.inverse @ offset)

    def level(self) -> Rows:
        """y = 0 as rows on x, whose ||w||^2 / 2 is the motion E but for a constant."""
        F = np.diag(self.inverse) if self.inverse.ndim == 1 else self.inverse
        target = F @ self.still
        return Rows(F, target, target)


def is_met(rows: Rows, x: Vec) -> bool:
    """Whether ||w|| at x is no more than rounding leaves of zero, MET_TOLERANCE of the level's terms and bounds."""
    w = rows.slack(x)
    return float(np.sqrt(w @ w)) <= MET_TOLERANCE * _size(rows, x)


def _size(rows: Rows, x: Vec) -> float:
    """What the rounding of a level's slacks is relative to: its largest terms and bounds.

    Entries that rest have the rounding of those that move: none counts for less than RESTING of the largest.
    """
    bounds = np.where(np.isfinite(rows.lower), rows.lower, np.where(np.isfinite(rows.upper), rows.upper, 0.0))
    size = np.abs(x)
    size += RESTING * size.max(initial=0.0)
    return float(np.max(np.abs(rows.dense(x.size)) @ size + np.abs(bounds), initial=0.0))


def handed_down(rows: Rows, x: Vec, still: Vec, share: float, guard: float | None) -> Rows:
    """The rows that a priced level whose stage ended at x leaves to the levels below; one more row for the guard.

    still: ``(n,)``, the point of least motion.  share: eta.  guard: its floor phi, None for no guard.
    A row that is not needed is (-inf, inf).
    """
    A = rows.dense(x.size)
    lower, upper = rows.lower.copy(), rows.upper.copy()
    last, below = np.zeros(x.size), -np.inf
    if not is_met(rows, x):
        w, y = rows.slack(x), A @ x
        norm = float(np.sqrt(w @ w))
        width = share * norm / np.sqrt(rows.m)
        fixed = ((lower == upper) | (np.abs(w) > SLACK_TOLERANCE * _size(rows, x))) & (
            (lower > -np.inf) | (upper < np.inf)
        )
        lower[fixed], upper[fixed] = y[fixed] - width, y[fixed] + width
        u = -w / norm
        made = float(u @ (y - A @ still))
        if guard is not None and rows.m > 1 and made > 0.0:
            last, below = u @ A, float(u @ y) - min(share * norm, 0.5 * made + guard * share * norm)
    return Rows(np.concatenate([A, last[None]]), np.append(lower, below), np.append(upper, np.inf))


def stage_price(problem: Hierarchy, stages: Mat, level: int) -> float:
    """The price c of a level in its stage, after levels above at their ``stages`` (NaN: met), ``(levels, n)``."""
    if problem.prices is None or not problem.prices[level] > 0.0:
        return 0.0
    price = float(problem.prices[level])
    motion = problem.motion
    if problem.pace == np.inf or (motion is not None and (motion.F.ndim == 2 or motion.f is not None)):
        return price
    unmet = np.zeros(problem.n, dtype=bool)
    lack = 0.0
    for k in range(level):
        rows = problem.levels[k]
        if problem.priced[k] and not np.isnan(stages[k, 0]) and not is_met(rows, stages[k]):
            unmet |= _used(rows, problem.n)
            lack = max(lack, float(np.linalg.norm(rows.slack(stages[k]))) / float(problem.prices[k]))
    own = _used(problem.levels[level], problem.n) & ~unmet
    return price if own.any() else price / max(1.0 / DEARER, 1.0 - LACKING * lack / problem.pace**2)


def _used(rows: Rows, n: int) -> Mask:
    """The coordinates that the rows of a level have, ``(n,)``."""
    asks = np.isfinite(rows.lower) | np.isfinite(rows.upper)
    found = np.zeros(n, dtype=bool)
    if isinstance(rows.A, Selection):
        found[rows.A.index[asks]] = True
    else:
        size = np.abs(rows.A[asks])
        found[:] = (size > UNUSED * size.max(axis=1, initial=0.0)[:, None]).any(axis=0)
    return found


def room(rows: Rows, n: int) -> Rows:
    """The rows of a priced level, in arrays of their own, with the place of the guard's row."""
    A = np.concatenate([rows.dense(n), np.zeros((1, n))])
    return Rows(A, np.append(rows.lower, -np.inf), np.append(rows.upper, np.inf))


def after_stages(problem: Hierarchy, stages: Mat, coordinates: Coordinates | None = None) -> Hierarchy:
    """The exact hierarchy that is left once every priced level k is at ``stages[k]``: its answer is the problem's.

    stages: ``(levels, n)``; a level whose row is NaN keeps its rows, being met for its price.
    """
    at = coordinates or Coordinates.of(problem.motion, problem.n)
    levels, guard, excess = list(problem.levels), guard_of(problem, at), 1.0
    for k, priced in enumerate(problem.priced):
        if priced and not np.isnan(stages[k, 0]):
            levels[k] = handed_down(problem.levels[k], stages[k], at.still, problem.share(k), guard)
            if not is_met(problem.levels[k], stages[k]):
                excess = min(excess, excess_below(problem, k, stages[k]))
    for k in coordinates_below(problem):
        levels[k] = slowed(problem, k, at, excess)
    return replace(problem.exact(), levels=tuple(levels), stacked=None)


def feasible_set(problem: Hierarchy, stages: Mat, level: int, x: Vec, at: Coordinates) -> Rows:
    """S_{k-1} of a level as hard rows: what each level above hands down, an exact one at its optimum x.

    stages: ``(levels, n)`` with the points of priced levels above.  x: ``(n,)``, a point of S_{k-1}.
    """
    parts, guard = list[Rows](), guard_of(problem, at)
    for k in range(level):
        rows = problem.levels[k]
        if problem.prices is not None and problem.prices[k] > 0.0:
            parts.append(handed_down(rows, stages[k], at.still, problem.share(k), guard))
        else:
            parts.append(at_optimum(rows, x))
    return stack_rows(parts, problem.n)


def at_optimum(rows: Rows, x: Vec) -> Rows:
    """An exact level's optimal set: its slack is unique, so equality rows and violated rows keep their value."""
    y = rows.A @ x
    w = rows.slack(x)
    fixed = (rows.lower == rows.upper) | (np.abs(w) > MET_TOLERANCE * (1.0 + np.abs(y)))
    return Rows(rows.A, np.where(fixed, y, rows.lower), np.where(fixed, y, rows.upper))


def stack_rows(parts: Sequence[Rows], n: int) -> Rows:
    """Rows of several levels as one, dense."""
    A = [rows.dense(n) for rows in parts]
    return Rows(
        np.concatenate([*A, np.zeros((0, n))]),
        np.concatenate([*(rows.lower for rows in parts), np.zeros(0)]),
        np.concatenate([*(rows.upper for rows in parts), np.zeros(0)]),
    )
