"""How fast single coordinates (a posture) may move while a priced level above them is not met.

A level after the last price that selects single coordinates asks for x = t on its equality rows, at the speed
v = ||F (t - x_still)||.  While a priced level is not met it is given

    t' = x_still + y' / F,  y' = sign(y) min(|y|, theta),    y = F (t - x_still),  ||y'|| = min(v, s),
    s = least of p max(1, c_k p^2 / ||w_k||) over the levels not met,

with p the pace of the hierarchy: fast coordinates are slowed alike, slow ones (a gripper) not at all, and y = 0 for
those that no row of a priced level or of one before it has (the other arm of a robot on a fixed base): they keep t.
The floor of every guard (hqp.pricing) is phi = max(floor, min(1, v^2 / p^2)).

The rows of an unmet level turn as fast as the joints move.  In its nearly lost directions the corners of the band that
it hands down, and the half-space of its guard, then move further in one tick than they are wide, and the answer would
jump from corner to corner as fast as the posture asks.
"""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Mask, Vec
from hqp.problem import Hierarchy, Rows, Selection


def coordinates_below(problem: Hierarchy) -> tuple[int, ...]:
    """The levels of single coordinates after the last price; none where no pace bounds them."""
    if not problem.priced or problem.pace == math.inf or (problem.motion is not None and problem.motion.F.ndim == 2):
        return ()
    last = max(k for k, priced in enumerate(problem.priced) if priced)
    return tuple(k for k in range(last + 1, len(problem.levels)) if isinstance(problem.levels[k].A, Selection))


def guard_of(problem: Hierarchy, still: Vec) -> float | None:
    """The floor phi of the guards, None where there are none.  still: ``(n,)``, the point of least motion."""
    if not problem.guard:
        return None
    speed = max((asked(problem, k, still)[1] for k in coordinates_below(problem)), default=0.0)
    return max(problem.guard_floor, min(1.0, (speed / problem.pace) ** 2))


def speed_below(problem: Hierarchy, level: int, x: Vec) -> float:
    """s below one priced level that is not met in its stage, which ended at x."""
    w, pace = problem.levels[level].slack(x), problem.pace
    price = 0.0 if problem.prices is None else float(problem.prices[level])
    return pace if pace == math.inf else pace * max(1.0, price * pace**2 / float(np.sqrt(w @ w)))


def slowed(problem: Hierarchy, level: int, still: Vec, speed: float) -> Rows:
    """The rows of a level of single coordinates with their targets t' for the speed s; inequality rows as they are."""
    rows = problem.levels[level]
    y, size = asked(problem, level, still)
    if size <= speed:
        return rows
    assert isinstance(rows.A, Selection)
    index, scale, bound = rows.A.index, rows.A.scale, common_bound(np.abs(y), speed)
    cut, away = np.abs(y) > bound, np.sign(y) * bound
    given = scale * (still[index] + (away if problem.motion is None else away / problem.motion.F[index]))
    return Rows(rows.A, np.where(cut, given, rows.lower), np.where(cut, given, rows.upper))


def common_bound(size: Vec, speed: float) -> float:
    """theta with ||min(size, theta)|| = speed, where ||size|| > speed: found in a few passes, for it only grows."""
    bound, count = 0.0, 0
    while (cut := size > bound).sum() != count:
        count = int(cut.sum())
        bound = math.sqrt(max(speed**2 - float(np.square(size[~cut]).sum()), 0.0) / count)
    return bound


def asked(problem: Hierarchy, level: int, still: Vec) -> tuple[Vec, float]:
    """y of a level of single coordinates, zero on inequality rows ``(m,)``, and its speed v."""
    rows, motion = problem.levels[level], problem.motion
    assert isinstance(rows.A, Selection)
    index, scale = rows.A.index, rows.A.scale
    turning = rows.equality & turned(problem)[index]
    y = np.where(turning, rows.lower / scale - still[index], 0.0) * (1.0 if motion is None else motion.F[index])
    return y, float(np.sqrt(y @ y))


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
