"""Couplings of a robot's file: positions of followers, and the part of a leader's range that a follower allows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from hqp.arrays import Vec

from .joints import Joints

Terms: TypeAlias = tuple[dict[str, float], float]
"""Coefficients by joint, the follower first, and offset: sum c_j q_j = offset."""

_SLACK = 1e-9  # rounding, relative to a range


def followed(couplings: Sequence[Terms], q: Vec, joints: Joints, angles: Callable[[Vec], Vec]) -> Vec:
    """q with each follower at the place that its leaders give; followers may lead others."""
    for _ in couplings:  # the longest possible chain
        for terms, offset in couplings:
            at = angles(q)
            (follower, factor), *leaders = terms.items()
            angle = (offset - sum(c * float(at[joints.find(leader)[0]]) for leader, c in leaders)) / factor
            q = joints.turned(q, joints.find(follower)[0], angle)
    return q


def leaders(couplings: Sequence[Terms], terms: Mapping[str, float]) -> dict[str, float]:
    """A linear function of joints, by coefficients, as one of joints that follow no others."""
    found = dict(terms)
    for _ in couplings:
        for following, _offset in couplings:
            (follower, own), *others = following.items()
            share = found.pop(follower, 0.0)
            for leader, c in others:
                found[leader] = found.get(leader, 0.0) - share * c / own
    return {joint: c for joint, c in found.items() if c}


def lost_ranges(couplings: Sequence[Terms], joints: Joints, lower: Vec, upper: Vec) -> list[str]:
    """A note for each leader whose limits take a follower beyond the follower's own limits."""
    notes = []
    for terms, offset in couplings:
        if len(terms) != 2:
            continue
        (follower, own), (leader, factor) = terms.items()
        i, j = joints.find(follower)[0], joints.find(leader)[0]
        ratio, shift = -factor / own, offset / own
        ends = sorted(ratio * float(end) + shift for end in (lower[j], upper[j]))
        allowed = float(lower[i]), float(upper[i])
        slack = _SLACK * max((abs(x) for x in (*ends, *allowed) if math.isfinite(x)), default=0.0)
        if ends[0] >= allowed[0] - slack and ends[1] <= allowed[1] + slack:
            continue
        back = sorted((end - shift) / ratio for end in allowed)
        left = max(back[0], float(lower[j])), min(back[1], float(upper[j]))
        part = f"{leader} keeps {_range(*left)}" if left[0] <= left[1] else f"no position of {leader} fits"
        notes.append(
            f"joint {follower!r} = {ratio:g} * {leader!r} + {shift:g}: the limits of {leader} "
            f"{_range(lower[j], upper[j])} take it to {_range(*ends)}, its own are {_range(*allowed)}: {part}"
        )
    return notes


def _range(low: float, high: float) -> str:
    return f"[{low:g}, {high:g}]"
