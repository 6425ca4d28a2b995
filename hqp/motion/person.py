"""The person of a motion: the axis that is up, lying, upside down and mirrored poses, toes that were not recorded."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hqp.arrays import Mat
from hqp.errors import DeclarationError

from .clip import TURNS, Motion, unit
from .contacts import Mask
from .joints import OPTIONAL, SIDES

STANDS = 0.5
"""Height of the hips above the ankles beyond which a person stands, for a leg of 1 m [m]."""

LEVEL = 0.5
"""Cosine between the trunk and the vertical below which a person lies."""

FLOOR = (-0.05, 0.15)
"""Range of the lowest joint's height on the floor of a file, for a leg of 1 m [m]: joints lie inside the body."""

STILL = 0.05
"""Speed below which the lowest joint rests, for a leg of 1 m [m/s]."""

BACKWARDS = 0.03
"""Backward offset of toes and knees beyond which a person is mirrored, for a leg of 1 m [m]."""

LIMBS = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "hand"))

SHORTEST, FARTHEST = 1e-3, 1e9
"""Length of a limb as a share of the longest one below which its joints coincide; bound of lengths in any unit."""

FOOT = 0.17
"""Length of a foot without recorded toes, for a leg of 1 m [m]."""

Joints = Mapping[str, Mat]


def joints_of(motion: Motion, parts: Mapping[str, str]) -> dict[str, Mat]:
    """Places of a person's parts ``(T, 3)``, in the motion's unit.

    Raises DeclarationError if both hips are at one place in a frame, or both ends of a limb most of the time.
    """
    found = {part: motion.joint(name) for part, name in parts.items()}
    pairs = [("left_hip", "right_hip"), *((f"{side}_{one}", f"{side}_{two}") for one, two in LIMBS for side in SIDES)]
    with np.errstate(over="ignore"):
        lengths = [np.linalg.norm(found[one] - found[two], axis=1) for one, two in pairs]
    sizes = [float(lengths[0].min()), *(float(np.median(length)) for length in lengths[1:])]
    size, longest, (one, two) = min(zip(sizes, [max(sizes)] * len(sizes), pairs, strict=True))
    if not longest < FARTHEST:
        raise DeclarationError("motion", "limbs", value=longest, allowed=f"shorter than {FARTHEST:g}")
    if not size > max(SHORTEST * longest, 1.0 / FARTHEST):
        raise DeclarationError("motion", f"{parts[one]} and {parts[two]} are at one place", allowed="two joints")
    return found


def leg_of(joints: Joints) -> float:
    """Length of a stretched leg, hip to ankle: the mean of both, the median over time."""
    ways = ((one, two, side) for one, two in (("hip", "knee"), ("knee", "ankle")) for side in SIDES)
    lengths = [np.linalg.norm(joints[f"{side}_{one}"] - joints[f"{side}_{two}"], axis=1) for one, two, side in ways]
    return float(np.median(0.5 * np.sum(lengths, axis=0)))


def up_axis(motion: Motion, joints: Joints, usual: str) -> str:
    """The axis of a file that is up: the usual one if the person stands along it at times, or lies: its lowest joint is
    at the file's zero and rests; else the one along which the person stands.

    One who walks beside the file's zero rests a foot there, too: whoever lies rests the hips.
    """
    leg = max(leg_of(joints), 1e-9)
    above = {up: float(np.quantile(_turned(_above_ankles(joints), up)[:, 2], 0.9)) / leg for up in TURNS}
    best = max(above, key=above.__getitem__)
    if above[usual] > STANDS or above[best] <= STANDS:
        return usual
    (height, speed), (other, slowest) = (_lowest(motion, up) for up in (usual, best))
    still = max(2.0 * slowest, STILL * leg)
    hips = float(np.median(np.linalg.norm(np.gradient(_middle(joints, "hip"), axis=0), axis=1))) * motion.fps
    walks = FLOOR[0] < other / leg < FLOOR[1] and hips > still
    return usual if FLOOR[0] < height / leg < FLOOR[1] and speed < still and not walks else best


def remarks(joints: Joints) -> tuple[str, ...]:
    """Mirrored, upside-down and lying poses of a person, z up, in a sentence each."""
    leg = max(leg_of(joints), 1e-9)
    trunk = unit(_middle(joints, "shoulder") - _middle(joints, "hip"))
    hips, shoulders = (joints[f"left_{limb}"] - joints[f"right_{limb}"] for limb in ("hip", "shoulder"))
    found = []
    if float(np.median(np.sum(unit(hips) * unit(shoulders), axis=1))) < -LEVEL:
        found.append("the left shoulder is on the side of the right hip: arms or legs have left and right exchanged")
    elif _forward(joints, unit(np.cross(hips + shoulders, trunk))) < -BACKWARDS * leg:
        found.append("the person is mirrored: toes and knees point backwards unless left and right are exchanged")
    height = _above_ankles(joints)[:, 2] / leg
    over = (trunk[:, 2] < -LEVEL) & (height < 0.0)
    flat = (np.abs(trunk[:, 2]) < LEVEL) & (np.abs(height) < STANDS)
    found += _share(over, "the person is upside down") + _share(flat, "the person lies")
    return tuple(found)


def with_toes(joints: Joints) -> dict[str, Mat]:
    """The joints, with level feet that point ahead of the hips if toes were not recorded."""
    if all(part in joints for part in OPTIONAL):
        return dict(joints)
    left = joints["left_hip"] - joints["right_hip"]
    level = np.hypot(left[:, 0], left[:, 1])
    known = np.flatnonzero(level > LEVEL * np.linalg.norm(left, axis=1))
    if not known.size:
        known = np.arange(len(left))
    yaw = np.unwrap(np.arctan2(-left[known, 0], left[known, 1]))
    yaw = np.interp(np.arange(len(left)), known, yaw)
    foot = FOOT * leg_of(joints) * np.column_stack((np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)))
    return {**joints, **{f"{side}_toe": joints[f"{side}_ankle"] + foot for side in SIDES}}


def _forward(joints: Joints, ahead: Mat) -> float:
    """Direction of toes and knees: the median over time."""
    found = np.zeros(len(ahead))
    for side in SIDES:
        hip, knee, ankle = (joints[f"{side}_{limb}"] for limb in ("hip", "knee", "ankle"))
        way = unit(ankle - hip)
        bend = knee - hip
        bend = bend - np.sum(bend * way, axis=1, keepdims=True) * way
        toe = joints[f"{side}_toe"] - ankle if f"{side}_toe" in joints else np.zeros_like(ankle)
        found += 0.5 * np.sum((bend + toe) * ahead, axis=1)
    return float(np.median(found))


def _middle(joints: Joints, limb: str) -> Mat:
    return np.asarray(0.5 * (joints[f"left_{limb}"] + joints[f"right_{limb}"]))


def _above_ankles(joints: Joints) -> Mat:
    return np.asarray(_middle(joints, "hip") - _middle(joints, "ankle"))


def _turned(places: Mat, up: str) -> Mat:
    axes, signs = TURNS[up]
    return np.asarray(places[..., axes] * signs)


def _lowest(motion: Motion, up: str) -> tuple[float, float]:
    """Height and speed of the joint that is lowest if an axis is up, the medians over time."""
    places = _turned(motion.positions, up)
    each, lowest = np.arange(len(places)), places[..., 2].argmin(axis=1)
    speed = np.linalg.norm(np.gradient(places, axis=0), axis=2) * motion.fps
    return float(np.median(places[each, lowest, 2])), float(np.median(speed[each, lowest]))


def _share(mask: Mask, text: str) -> list[str]:
    """A sentence with the frames in which it holds."""
    frames = np.flatnonzero(mask)
    if not frames.size:
        return []
    return [f"{text} in {frames.size} of {len(mask)} frames, from frame {frames[0]} to {frames[-1]}"]
