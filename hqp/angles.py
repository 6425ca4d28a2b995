"""Differences of angles: whole turns do not count."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from hqp.arrays import Vec


def wrapped(angle: float) -> float:
    """Return the equal angle within [-pi, pi], so the shortest turn for a difference of two [rad]; NaN unless
    finite."""
    return math.remainder(angle, math.tau) if math.isfinite(angle) else math.nan


def all_wrapped(angles: Vec) -> Vec:
    """``wrapped`` of each ``(k,)`` [rad]."""
    return np.array([wrapped(angle) for angle in angles.tolist()])


def nearest_turns(off: float, sizes: Vec) -> Vec:
    """Whole turns k ``(n,)`` with the least abs(off + 2 pi sizes k), the fewest of equal ones.

    sizes: coefficient of each joint, not zero.  The joint that counts most turns as often as it
    takes, the others at most ``MOST_TURNS`` times to either side, fewer if there are many joints.
    """
    found = np.zeros(sizes.size)
    if not sizes.size or not math.isfinite(off):
        return found
    first = int(np.argmax(np.abs(sizes)))
    others = np.delete(math.tau * sizes, first)
    period, most = math.tau * float(sizes[first]), _most_turns(others.size)
    least, fewest = math.inf, math.inf
    for turns in product(range(-most, most + 1), repeat=others.size):
        here = off + float(others @ turns) if turns else off
        own = -round(here / period) + 0.0
        rest, count = abs(here + period * own), abs(own) + sum(map(abs, turns))
        margin = _SAME * abs(period)
        if rest < least - margin or (rest <= least + margin and count < fewest):
            least, fewest, found = rest, count, np.insert(np.array(turns, dtype=np.float64), first, own)
    return found


MOST_TURNS = 10
_CHOICES = 200_000  # combinations of turns to look at, a millisecond in native code
_SAME = 1e-9  # of a turn: rounding


def _most_turns(joints: int) -> int:
    most = MOST_TURNS
    while most and (2 * most + 1) ** joints > _CHOICES:
        most -= 1
    return most
