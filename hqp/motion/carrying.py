"""A box in the robot's hands: its place beside the robot, and those of the hands on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from hqp.arrays import Mat, Vec

from .box import Box
from .contacts import Mask, runs, smooth

LEG = 0.9
"""Length of a leg [m]; the motion's unit is the power of ten nearest to it."""


def carried(
    box: Box, joints: Mapping[str, Mat], hands: Mapping[str, Mat], floor: float, scale: float, fps: float, leg: float
) -> tuple[Box, dict[str, Mat]]:
    """The box beside the robot [m], and places of the hands that hold it ``(T, 3)``, by name.

    The box keeps its own size.  Its lowest corner is at the person's height in the robot's size; across the ground it
    is where the robot's hands would have it.  A hand holds the box at its surface, at the same shares of its edges.

    joints: hands of the person, and hands: of the robot without the box, by name.  floor: height of the person's lowest
    joint.  scale: the robot's metres to the motion's unit.  leg: length of the person's leg.
    """
    size = box.size / 10.0 ** round(math.log10(leg / LEG))
    tall = np.abs(box.rotations[:, 2]) @ (0.5 * size)
    low, centre = box.lowest(), scale * box.positions
    centre[:, 2] = scale * (low - min(floor, low.min())) + tall
    held = {name: box.held(joints[name], fps, leg) for name in hands}
    levers = {
        name: np.einsum("tij,tj->ti", box.rotations, _grasps(box, joints[name], mask, size))
        for name, mask in held.items()
        if mask.any()
    }
    if levers:
        weights = np.array([held[name] * (1.0 - smooth(~held[name], fps)) for name in levers])  # 0 as a hold begins
        away = np.array([hands[name] - levers[name] - centre for name in levers])
        known = np.flatnonzero(weights.any(axis=0))
        mean = np.einsum("kt,kti->ti", weights[:, known], away[:, known]) / weights[:, known].sum(axis=0)[:, None]
        times = np.arange(len(box))
        for axis in (0, 1):
            centre[:, axis] += np.interp(times, known, mean[:, axis])
    placed = {}
    for name, lever in levers.items():
        weight = smooth(held[name], fps)[:, None]
        placed[name] = (1.0 - weight) * hands[name] + weight * (centre + lever)
    return Box(centre, box.quaternions, size), placed


def _grasps(box: Box, hand: Mat, mask: Mask, size: Vec) -> Mat:
    """Places of a hand in the axes of the box with another size, of the nearest hold in time ``(T, 3)``."""
    own, found = box.within(hand), np.zeros_like(hand)
    holds = runs(mask)
    places = [np.clip(np.median(own[first:last], axis=0) / box.size, -0.5, 0.5) * size for first, last in holds]
    ends = [(one[1] + two[0]) // 2 for one, two in pairwise(holds)]
    for place, first, last in zip(places, [0, *ends], [*ends, len(hand)], strict=True):
        found[first:last] = place
    return found
