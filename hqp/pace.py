"""How fast single coordinates (a posture) may move while a priced level above them is not met.

A level of single coordinates after the last price asks for a_i . x = b_i on its equality rows; where the motion
E = 1/2 ||F x - f||^2 is no diagonal (torques, of which every coordinate's acceleration has all) every level after the
last price is one of single coordinates.  Row i alone asks for the speed |y_i|, the least motion that meets it, and the
level for v = ||y||:

    y_i = (b_i - a_i . x_still) / ||a_i P||,    F P orthonormal.

While a priced level is not met it is given

    b_i' = a_i . x_still + sign(y_i) min(|y_i|, theta) ||a_i P||,    ||y'|| = min(v, s),    s = p + h (v - p),
    h = least of max(0, 1 - ||w_k|| / (FADE c_k p^2)) over the levels not met,

with p the pace of the hierarchy and h the share of the speed above it that is left, which falls to 0 as a level comes
to be unmet: fast coordinates are slowed alike, slow ones (a gripper) not at all, and y = 0 for those that no row of a
priced level or of one before it has (the other arm of a robot on a fixed base): they keep b_i.
The floor of every guard (hqp.pricing) is phi = max(floor, min(1, v^2 / p^2)).

The rows of an unmet level turn as fast as the joints move.  In its nearly lost directions the corners of the band that
it hands down, and the half-space of its guard, then move further in one tick than they are wide, and the answer would
jump from corner to corner as fast as the posture asks.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Mask, Vec
from hqp.problem import Hierarchy, Rows, Selection

if TYPE_CHECKING:
    from hqp.pricing import Coordinates

FADE = 16.0
"""Nothing above the pace is left where a level misses by FADE c_k p^2 (as in hqp/cpp/priced/stage_levels.hpp).

A target that comes to be out of reach takes some tens of ticks to it; at 2, torques jumped by half their limit."""


def coordinates_below(problem: Hierarchy) -> tuple[int, ...]:
    """The levels of single coordinates after the last price; none where no pace bounds them."""
    if not any(problem.priced) or problem.pace == math.inf:
        return ()
    last = max(k for k, priced in enumerate(problem.priced) if priced)
    return tuple(k for k in range(last + 1, len(problem.levels)) if is_paced(problem, k))


def is_paced(problem: Hierarchy, level: int) -> bool:
    """Whether a level after the last price is one of single coordinates."""
    mixed = problem.motion is not None and problem.motion.F.ndim == 2
    return mixed or isinstance(problem.levels[level].A, Selection)


def guard_of(problem: Hierarchy, at: Coordinates) -> float | None:
    """The floor phi of the guards, None where there are none."""
    if not problem.guard:
        return None
    speed = max((float(np.linalg.norm(asked(problem, k, at))) for k in coordinates_below(problem)), default=0.0)
    return max(problem.guard_floor, min(1.0, (speed / problem.pace) ** 2))


def excess_below(problem: Hierarchy, level: int, x: Vec) -> float:
    """The bound on h by one priced level that is not met in its stage, which ended at x."""
    w, pace = problem.levels[level].slack(x), problem.pace
    price = 0.0 if problem.prices is None else float(problem.prices[level])
    lost = FADE * price * pace**2
    return max(0.0, 1.0 - float(np.sqrt(w @ w)) / lost) if lost > 0.0 else 0.0


def slowed(problem: Hierarchy, level: int, at: Coordinates, excess: float) -> Rows:
    """The rows of a level of single coordinates with their targets b' for h; inequality rows as they are."""
    rows, y = problem.levels[level], np.abs(asked(problem, level, at))
    above = float(np.linalg.norm(y)) - problem.pace
    if excess == 1.0 or above <= 0.0:
        return rows
    bound = common_bound(y, problem.pace + excess * above)
    rest = rows.A @ at.still
    part = np.divide(bound, y, where=y > bound, out=np.ones_like(y))
    given = rest + part * (np.where(y > bound, rows.lower, rest) - rest)
    return Rows(rows.A, np.where(y > bound, given, rows.lower), np.where(y > bound, given, rows.upper))


def common_bound(size: Vec, speed: float) -> float:
    """theta with ||min(size, theta)|| = speed, where ||size|| > speed: found in a few passes, for it only grows.

    Where ||size|| is above speed by rounding alone theta may be above all of them.
    """
    bound, count = 0.0, 0
    while (cut := size > bound).sum() != count and cut.any():
        count = int(cut.sum())
        bound = math.sqrt(max(speed**2 - float(np.square(size[~cut]).sum()), 0.0) / count)
    return bound


def asked(problem: Hierarchy, level: int, at: Coordinates) -> Vec:
    """y of a level of single coordinates ``(m,)``, zero on inequality rows and on those that turn nothing."""
    rows, found = problem.levels[level], turned(problem)
    A = rows.dense(problem.n)
    reach = np.linalg.norm(at.rows(A), axis=1)
    counts = rows.equality & (A[:, found] != 0.0).any(axis=1) & (reach > 0.0)
    off = np.where(counts, rows.lower, 0.0) - np.where(counts, rows.A @ at.still, 0.0)
    return off / np.where(counts, reach, 1.0)


def turned(problem: Hierarchy) -> Mask:
    """The coordinates ``(n,)`` that a row of a priced level has, or one of a level before it, but for boxes."""
    last = max(k for k, priced in enumerate(problem.priced) if priced)
    found = np.zeros(problem.n, dtype=bool)
    for rows, priced in zip(problem.levels[: last + 1], problem.priced, strict=False):
        if isinstance(rows.A, Selection):
            if priced:
                found[rows.A.index] = True
        else:
            asks = np.isfinite(rows.lower) | np.isfinite(rows.upper)
            found |= rows.A[asks].any(axis=0)
    return found
