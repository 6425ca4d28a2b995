"""When feet, hands and knees of a person rest on something."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec

from .joints import SIDES

ON, OFF = 0.15, 0.3
"""Speed below which a rest begins and above which it ends, for a leg of 1 m [m/s]."""

WINDOW = 0.04
"""Time over which a speed is measured [s]; with a shorter one, the noise of markers ends rests."""

SHORT = 0.06
"""Duration below which rests and gaps are ignored [s]."""

NEAR = 0.12
"""Height below which a hand or a knee rests on the ground, for a leg of 1 m [m]: joints lie inside the body."""

BESIDE = 0.6
"""Radius around a foothold within which the ground has its height, for a leg of 1 m [m]."""

LEVEL = 0.05
"""Difference below which two heights are one ground, for a leg of 1 m [m]."""

RAMP = 0.25
"""Duration of the blend from the arm's pose to a hand's contact or hold [s]."""

Mask = NDArray[np.bool_]
LIMBS = ("foot", "hand", "knee")
NAMES = tuple(f"{side}_{limb}" for limb in LIMBS for side in SIDES)
"""The contacts, in the order in which files have them."""


@dataclass(frozen=True)
class Contacts:
    """Contacts over time: resting ``(T,)`` by name, and ground, the height under each foot while it rests ``(T,)``."""

    resting: dict[str, Mask]
    ground: dict[str, Vec]

    def array(self) -> Mask:
        """``(T, k)``, in the order of ``NAMES``."""
        return np.column_stack([self.resting[name] for name in NAMES])


def detect(places: Mapping[str, Mat], fps: float, leg: float) -> Contacts:
    """Contacts from heights and speeds of toes, ankles, hands and knees, ``(T, 3)`` each, the floor at height 0.

    A foot rests while its toe is slow (``ON``, ``OFF``), on the floor or, above it, if the other foot is at times
    higher or in the air meanwhile and it is below its knee: a leg that is lifted and held still carries nothing.  It
    rests, too, on a ground on which a foot so stands at another time.  Hands and knees rest while they are slow and
    near such a ground.  leg [m]: all lengths and speeds go with it.
    """
    slow = {limb: rests(places[limb], fps, leg) for limb in places}
    feet = {side: slow[f"{side}_toe"] for side in SIDES}
    resting: dict[str, Mask] = {}
    ground: dict[str, Vec] = {}
    heights = {side: places[f"{side}_toe"][:, 2] for side in SIDES}
    for side, other in zip(SIDES, reversed(SIDES), strict=True):
        mask, level = np.zeros(len(feet[side]), dtype=bool), np.zeros(len(feet[side]))
        for first, last in runs(feet[side]):
            height = float(np.median(heights[side][first:last]))
            lowest = heights[side][first:last] < heights[other][first:last] + LEVEL * leg
            lowest &= heights[side][first:last] < places[f"{side}_knee"][first:last, 2]
            floor = height < LEVEL * leg
            if floor or np.any(lowest):
                mask[first:last] = True
                level[first:last] = 0.0 if floor else height
        resting[f"{side}_foot"], ground[f"{side}_foot"] = mask, level
    grounds = _grounds(places, resting, ground)
    for side in SIDES:
        toe, name = places[f"{side}_toe"], f"{side}_foot"
        for first, last in runs(feet[side] & ~resting[name]):
            spot = np.median(toe[first:last], axis=0)
            if _above(spot[None], grounds, leg)[0] < LEVEL * leg:
                resting[name][first:last], ground[name][first:last] = True, spot[2]
    for limb in ("hand", "knee"):
        for side in SIDES:
            name = f"{side}_{limb}"
            resting[name] = slow[name] & (_above(places[name], grounds, leg) < NEAR * leg)
            resting[name] = _without_short(resting[name], fps)
    return Contacts(resting, ground)


def runs(mask: Mask) -> list[tuple[int, int]]:
    """First and end of every stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def rests(place: Mat, fps: float, leg: float) -> Mask:
    """Mask of frames with a slow point, with hysteresis."""
    half = max(1, round(0.5 * WINDOW * fps))
    padded = np.pad(place, ((half, half), (0, 0)), mode="edge")
    speed = np.linalg.norm(padded[2 * half :] - padded[: -2 * half], axis=1) * fps / (2 * half)
    if len(place) > half:
        speed[:half], speed[-half:] = speed[half], speed[-half - 1]
    else:  # the motion is shorter than the window
        speed[:] = np.linalg.norm(place[-1] - place[0]) * fps / (len(place) - 1)
    mask = np.zeros(len(place), dtype=bool)
    for first, last in runs(speed < OFF * leg):
        begun = np.flatnonzero(speed[first:last] < ON * leg)
        if begun.size:
            mask[first + begun[0] : first + begun[-1] + 1] = True
    return _without_short(mask, fps)


def _without_short(mask: Mask, fps: float) -> Mask:
    least, mask = max(2, round(SHORT * fps)), mask.copy()
    for first, last in runs(~mask):
        if last - first < least and first > 0 and last < len(mask):
            mask[first:last] = True
    for first, last in runs(mask):
        if last - first < least:
            mask[first:last] = False
    return mask


def _grounds(places: Mapping[str, Mat], resting: Mapping[str, Mask], ground: Mapping[str, Vec]) -> Mat:
    """Places where feet stood above the floor ``(n, 3)``."""
    found = [np.zeros((0, 3))]
    for side in SIDES:
        name = f"{side}_foot"
        for first, last in runs(resting[name]):
            if ground[name][first] > 0.0:
                x, y, _ = np.median(places[f"{side}_toe"][first:last], axis=0)
                found.append(np.array([[x, y, ground[name][first]]]))
    return np.vstack(found)


def _above(place: Mat, grounds: Mat, leg: float) -> Vec:
    """Height above the nearest of floor and grounds around, ``(T,)`` [m]."""
    height = np.abs(place[:, 2])
    for x, y, z in grounds:
        beside = np.hypot(place[:, 0] - x, place[:, 1] - y) < BESIDE * leg
        height = np.where(beside, np.minimum(height, np.abs(place[:, 2] - z)), height)
    return height


def smooth(mask: Mask, fps: float, ramp: float = RAMP) -> Vec:
    """1 where the mask is, and down to 0 within ``ramp`` [s] around it, without a corner ``(T,)``."""
    if not mask.any():
        return np.zeros(len(mask))
    known = np.flatnonzero(mask)
    after = np.searchsorted(known, np.arange(len(mask)))
    left = np.arange(len(mask)) - known[np.maximum(after - 1, 0)]
    right = known[np.minimum(after, known.size - 1)] - np.arange(len(mask))
    away = np.minimum(np.where(left < 0, len(mask), left), np.where(right < 0, len(mask), right))
    x = np.clip(1.0 - away / (ramp * fps), 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
