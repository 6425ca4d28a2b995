"""Rows of a collision scene: pairs that are near, each in its slot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Vec


class Near(NamedTuple):
    """A row's number, distance and clearance [m], normal, nearest point of its first axis.

    pair: the pair, or an end of one of its capsules, see ``Scene``.  fade: its share, of the row of an end.  beside:
    the share of the rows of a pair's ends, of the pair's own.  deepest: the least distance less clearance of the pairs
    that have a body or a shape in common with it, itself included, at most 0 [m].
    """

    pair: int
    distance: float
    clearance: float
    normal: Vec
    point: Vec
    fade: float = 1.0
    beside: float = 0.0
    deepest: float = 0.0


def assign(slots: NDArray[np.int32], near: dict[int, float]) -> None:
    """Give slots to rows that are near; near: distance less clearance and braking distance of each [m].

    A row keeps its slot while it is near; others get free slots, then those of rows with a larger margin.
    """
    for k, pair in enumerate(slots.tolist()):
        if pair not in near:
            slots[k] = -1
    held, free = set(slots.tolist()), np.flatnonzero(slots < 0).tolist()[::-1]
    for pair, margin in near.items():
        if pair in held:
            continue
        k = free.pop() if free else max(range(slots.size), key=lambda k: near[int(slots[k])])
        if slots[k] < 0 or near[int(slots[k])] > margin:
            held.discard(int(slots[k]))
            held.add(pair)
            slots[k] = pair
