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
    """q with each follower at the place that its leaders give; a joint that others determine leads none."""
    at = angles(q)
    for follower, (terms, offset) in solved(couplings).items():
        angle = offset + sum(c * float(at[joints.find(leader)[0]]) for leader, c in terms.items())
        q = joints.turned(q, joints.find(follower)[0], angle)
    return q


def leaders(couplings: Sequence[Terms], terms: Mapping[str, float]) -> dict[str, float]:
    """A linear function of joints, by coefficients, as one of joints that follow no others."""
    found, followers = dict(terms), solved(couplings)
    for follower in [joint for joint in terms if joint in followers]:
        _add(found, found.pop(follower), followers[follower][0])
    return {joint: c for joint, c in found.items() if c}


def solved(couplings: Sequence[Terms]) -> dict[str, Terms]:
    """Each follower as a linear function of joints that follow no others, by Gaussian elimination.

    The follower of a coupling is its first joint that follows no other yet. One that the couplings before it imply or
    contradict has no follower.
    """
    found: dict[str, Terms] = {}
    for given, offset in couplings:
        terms = dict(given)
        for joint in [joint for joint in given if joint in found]:
            factor = terms.pop(joint)
            _add(terms, factor, found[joint][0])
            offset -= factor * found[joint][1]
        size = max(map(abs, given.values()), default=0.0)
        follower = next((joint for joint, c in terms.items() if abs(c) > _SLACK * size), None)
        if follower is None:
            continue
        own = terms.pop(follower)
        rest = {joint: -c / own for joint, c in terms.items() if c}, offset / own
        for joint, (others, shift) in found.items():
            if follower in others:
                factor = others.pop(follower)
                _add(others, factor, rest[0])
                found[joint] = others, shift + factor * rest[1]
        found[follower] = rest
    return found


def _add(terms: dict[str, float], factor: float, others: Mapping[str, float]) -> None:
    for joint, c in others.items():
        terms[joint] = terms.get(joint, 0.0) + factor * c


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
