"""Targets for the frames of a robot: a person's motion in the robot's size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError

from .body import Body
from .box import Box
from .carrying import carried
from .clip import Motion, unit
from .contacts import LEVEL, NAMES, Contacts, Mask, detect, runs, smooth
from .joints import OPTIONAL, SIDES
from .person import LEVEL as UPRIGHT
from .person import joints_of, leg_of, with_toes

LOW = 0.02
"""Quantile of the heights of slow ankles that gives the floor."""

ASTRIDE = 0.1
"""Sine of the angle between hips and trunk, or size of the mean of two directions, below which neither has a front."""

FARTHEST = 1e4
"""Largest distance of a joint from the origin in the robot's size, that of a base [m]."""

FLAT = 0.15
"""Tilt below which a resting foot is flat [rad]."""

STEEP = 0.2
"""Horizontal share of a foot's direction below which it has the yaw of the trunk."""

Z = np.array([0.0, 0.0, 1.0])

Edges = NDArray[np.int8]


@dataclass(frozen=True)
class Targets:
    """By part: places ``(T, 3)`` [m] of pelvis (half way between the hips), hands, elbows, knees and soles, axes
    ``(T, 3, 3)`` of torso, hips and soles.

    contacts: contacts of the person.  edge: support of a sole, 0 all of it, 1 the toe, -1 the heel ``(T,)``, by side.
    scale: robot's metres to the motion's unit of length.  person ``(T, J, 3)``: its joints in the robot's size [m].
    box: the box between the robot's hands [m], None without.
    """

    fps: float
    places: dict[str, Mat]
    axes: dict[str, Mat]
    contacts: Contacts
    edge: dict[str, Edges]
    scale: float
    person: Mat
    box: Box | None = None

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.person)

    def thinned(self, each: int) -> Targets:
        """Every ``each``-th frame."""
        here = slice(None, None, each)
        contacts = Contacts(
            {name: mask[here] for name, mask in self.contacts.resting.items()},
            {name: height[here] for name, height in self.contacts.ground.items()},
        )
        places, axes = ({k: x[here] for k, x in part.items()} for part in (self.places, self.axes))
        edge = {side: x[here] for side, x in self.edge.items()}
        box = None if self.box is None else self.box.frames(here)
        return Targets(self.fps / each, places, axes, contacts, edge, self.scale, self.person[here], box)


def targets_of(motion: Motion, parts: dict[str, str], body: Body, contacts: Mask | None = None) -> Targets:
    """Targets from a motion whose joints have parts; contacts ``(T, k)`` in place of those that are detected.

    The whole motion is in the robot's size by the length of the legs; arms and trunk by their own from the shoulders
    and hips on, but for a hand that rests on something.
    """
    joints = with_toes(joints_of(motion, parts))
    leg = leg_of(joints)
    scale = body.leg / leg
    ground = _floor(joints, motion.fps, leg)
    lift = np.array([0.0, 0.0, float(np.mean([-body.levers[side][2] for side in SIDES]))])
    moved = {part: scale * (place - ground) + lift for part, place in joints.items()}
    far = max(float(np.abs(place).max()) for place in moved.values())
    if far > FARTHEST:
        allowed = f"{FARTHEST:g} m in the robot's size: move the motion to its origin"
        raise DeclarationError("motion", "distance from the origin", value=far, unit="m", allowed=allowed)
    low = {part: place - lift for part, place in moved.items()}  # the ankles at 0 on the floor
    toes = {f"{side}_toe": low[f"{side}_toe"] - _toe_height(low, side, body.leg) * Z for side in SIDES}
    found = detect({**toes, **{n: moved[n] for n in NAMES if "foot" not in n}}, motion.fps, body.leg)
    if contacts is not None:
        found = Contacts({name: contacts[:, i] for i, name in enumerate(NAMES)}, found.ground)
    places: dict[str, Mat] = {}
    edge: dict[str, Edges] = {}
    trunk = _trunk(moved)
    axes: dict[str, Mat] = {"torso": trunk @ body.axes["torso"], "hips": _hips(moved, trunk) @ body.axes["pelvis"]}
    places["pelvis"] = 0.5 * (moved["left_hip"] + moved["right_hip"])
    for side in SIDES:
        if (unit(moved[f"{side}_knee"] - moved[f"{side}_ankle"])[:, 2] > UPRIGHT).any():
            places[f"{side}_sole"], turn, edge[side] = _sole(moved, found, side, body, motion.fps)
        else:
            turn = _lying(moved, side, trunk, recorded=f"{side}_toe" in parts)
            places[f"{side}_sole"] = moved[f"{side}_ankle"] + turn @ body.levers[side]
            edge[side] = np.where(turn[:, 2, 0] < 0.0, 1, -1).astype(np.int8)
        axes[f"{side}_sole"] = turn @ body.axes[f"{side}_sole"]
        places[f"{side}_knee"] = _knee(moved, places["pelvis"], side, body)
        places.update(
            _arm(moved, places["pelvis"], axes["torso"] @ body.axes["torso"].T, found, side, body, motion.fps)
        )
    box = None
    if motion.box is not None:
        hands = {name: places[name] for name in (f"{side}_hand" for side in SIDES)}
        floor = float(motion.positions[..., 2].min())
        box, placed = carried(motion.box, joints, hands, floor, scale, motion.fps, leg)
        places.update(placed)
    return Targets(motion.fps, places, axes, found, edge, scale, scale * (motion.positions - ground) + lift, box)


def _floor(joints: dict[str, Mat], fps: float, leg: float) -> Vec:
    """Place of the floor below the start ``(3,)``: under the ankles, or under all joints if others are always lower."""
    own = {part: place for part, place in joints.items() if part not in OPTIONAL}
    lowest = np.min([place[:, 2] for place in own.values()], axis=0)
    ankles = [own[f"{side}_ankle"] for side in SIDES]
    stands = any((ankle[:, 2] <= lowest).any() for ankle in ankles)
    heights = []
    for place in ankles if stands else own.values():
        speed = np.linalg.norm(np.gradient(place, axis=0), axis=1) * fps
        slow = speed <= max(0.3 * leg, float(np.quantile(speed, 0.2)))
        heights.append(place[slow, 2])
    return np.array([0.0, 0.0, float(np.quantile(np.concatenate(heights), LOW))])


def _toe_height(low: dict[str, Mat], side: str, leg: float) -> float:
    """Height of a toe while its ankle is low, above the floor, or above the ankle's lowest if it stays off it [m]."""
    ankle, toe = low[f"{side}_ankle"][:, 2], low[f"{side}_toe"][:, 2]
    height, lowest = np.quantile(toe[ankle <= np.quantile(ankle, 0.3)], 0.1), np.quantile(ankle, LOW)
    return float(height - lowest if lowest > LEVEL * leg else height)


def _trunk(joints: dict[str, Mat]) -> Mat:
    """Axes of the chest, x forward, z from hips to shoulders ``(T, 3, 3)``.

    Hips and shoulders give its left together, the hips alone if they contradict each other.
    """
    shoulders = 0.5 * (joints["left_shoulder"] + joints["right_shoulder"])
    up = unit(shoulders - 0.5 * (joints["left_hip"] + joints["right_hip"]))
    hips = unit(joints["left_hip"] - joints["right_hip"])
    left = hips + unit(joints["left_shoulder"] - joints["right_shoulder"])
    left = np.where(np.linalg.norm(left, axis=1, keepdims=True) < ASTRIDE, hips, left)
    forward, known = _across(left, up)
    return _held(np.stack((forward, np.cross(up, forward), up), axis=2), known)


def _hips(joints: dict[str, Mat], trunk: Mat) -> Mat:
    """Axes of the pelvis, y along the hips, as far up as the trunk ``(T, 3, 3)``."""
    left = unit(joints["left_hip"] - joints["right_hip"])
    forward, known = _across(left, trunk[:, :, 2])
    return _held(np.stack((forward, left, np.cross(forward, left)), axis=2), known)


def _across(left: Mat, up: Mat) -> tuple[Mat, Mask]:
    """Directions ahead ``(T, 3)``, and the frames in which left and up are not in one line."""
    ahead = np.cross(left, up)
    return unit(ahead), np.asarray(np.linalg.norm(ahead, axis=1) > ASTRIDE * np.linalg.norm(left, axis=1))


def _held(axes: Mat, known: Mask) -> Mat:
    """Axes ``(T, 3, 3)`` with those of the nearest known frame for all others; raises DeclarationError without one."""
    frames = np.flatnonzero(known)
    if not frames.size:
        raise DeclarationError(
            "motion", "hips and shoulders are in one line", allowed="a trunk above or beside the hips"
        )
    nearest = np.searchsorted(0.5 * (frames[1:] + frames[:-1]), np.arange(len(axes)))
    return np.asarray(axes[frames[nearest]])


def _sole(joints: dict[str, Mat], found: Contacts, side: str, body: Body, fps: float) -> tuple[Mat, Mat, Edges]:
    """Place of a sole, how it is turned from home, and which edge of it is down."""
    ankle, toe = joints[f"{side}_ankle"], joints[f"{side}_toe"]
    mask, ground = found.resting[f"{side}_foot"], found.ground[f"{side}_foot"]
    way = toe - ankle
    tilt = -np.arctan2(way[:, 2], np.linalg.norm(way[:, :2], axis=1))
    over = _over(unit(way), unit(joints[f"{side}_knee"] - ankle), mask)
    tilt = np.where(over, np.pi - tilt, tilt)
    tilt -= np.median(tilt[mask]) if mask.any() else np.median(tilt)
    yaw = _heading(np.where(over[:, None], -way, way), _trunk(joints))
    weight = smooth(mask, fps)
    tilt = (1.0 - weight) * tilt + weight * np.sign(tilt) * np.maximum(np.abs(tilt) - FLAT, 0.0)
    place = ankle + np.einsum("tij,j->ti", turned(yaw, tilt), body.levers[side])
    shift, turn = np.zeros_like(place), np.zeros(len(yaw))
    for first, last in runs(mask):
        here = slice(first, last)
        flat = np.abs(tilt[here]) < 1e-6
        rest = np.flatnonzero(flat) if flat.any() else np.arange(last - first)
        mean = float(np.median(yaw[here][rest]))
        turn[here] = mean - yaw[here]
        upright = turned(np.full(last - first, mean), np.zeros(last - first))
        spot = np.median((ankle[here] + np.einsum("tij,j->ti", upright, body.levers[side]))[rest], axis=0)
        spot[2] = max(spot[2], 0.0) if ground[first] > 0.0 else 0.0
        edge = np.where(tilt[here, None] > 0.0, body.toes[side], body.heels[side])
        pivot = spot + np.einsum("tij,tj->ti", upright, edge)
        shift[here] = (
            pivot - np.einsum("tij,tj->ti", turned(np.full(last - first, mean), tilt[here]), edge) - place[here]
        )
    if mask.any():
        times, known = np.arange(len(mask)), np.flatnonzero(mask)
        shift = np.column_stack([np.interp(times, known, shift[known, k]) for k in range(3)])
        turn = np.interp(times, known, turn[known])
    return place + shift, turned(yaw + turn, tilt), np.sign(tilt).astype(np.int8)


def _over(way: Mat, shank: Mat, rests: Mask) -> Mask:
    """Frames in which a foot in the air is turned beyond the vertical, its toe down: it points back, the sole up.

    A foot that stays about the vertical meanwhile has no heading that turns round.
    """
    beyond, found = shank[:, 2] < np.sum(way * shank, axis=1) * way[:, 2], np.zeros(len(way), dtype=bool)
    down = (np.hypot(way[:, 0], way[:, 1]) < STEEP) & (way[:, 2] < 0.0)
    for first, last in runs(beyond & ~rests):
        through = down[max(first - 1, 0)] and down[min(last, len(way) - 1)]
        found[first:last] = through and not down[first:last].all()
    return found


def _lying(joints: dict[str, Mat], side: str, trunk: Mat, *, recorded: bool) -> Mat:
    """Rotation from home of the sole of a foot that never stands ``(T, 3, 3)``: square to the shank at the median.

    recorded: false for a foot without recorded toes, which turns from the trunk as the shank does.
    """
    ankle = joints[f"{side}_ankle"]
    up = unit(joints[f"{side}_knee"] - ankle)
    way = unit(joints[f"{side}_toe"] - ankle)
    if not recorded:
        ahead, above = trunk[:, :, 0], trunk[:, :, 2]
        share = np.sum(ahead * up, axis=1) / np.maximum(1.0 + np.sum(above * up, axis=1), 1e-9)
        way = unit(ahead - share[:, None] * (above + up))
    left = unit(np.cross(up, way))
    rise = np.median(np.arcsin(np.clip(np.sum(way * up, axis=1), -1.0, 1.0)), keepdims=True)
    return np.asarray(np.stack((way, left, np.cross(way, left)), axis=2) @ turned(np.zeros(1), rise))


def _heading(way: Mat, trunk: Mat) -> Vec:
    """Yaw of a foot; a foot that points down or up has the yaw of the trunk."""
    flat = np.linalg.norm(way[:, :2], axis=1) / np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    forward = np.stack((trunk[:, 1, 1], -trunk[:, 0, 1]), axis=1)
    weight = np.clip((flat - STEEP) / 0.3, 0.0, 1.0)[:, None]
    mixed = weight * unit(way[:, :2]) + (1.0 - weight) * unit(forward)
    return np.unwrap(np.arctan2(mixed[:, 1], mixed[:, 0]))


def _knee(joints: dict[str, Mat], hips: Mat, side: str, body: Body) -> Mat:
    """A knee, thighs in their own size below hips as wide as the robot's."""
    half = (joints[f"{side}_hip"] - hips) * (
        body.width("hip") / max(_median(joints["left_hip"] - joints["right_hip"]), 1e-9)
    )
    thigh = joints[f"{side}_knee"] - joints[f"{side}_hip"]
    return hips + half + thigh * (body.length("hip", "knee") / _median(thigh))


def _arm(
    joints: dict[str, Mat], hips: Mat, turn: Mat, found: Contacts, side: str, body: Body, fps: float
) -> dict[str, Mat]:
    """An elbow and a hand: from the robot's shoulder on in the robot's lengths, a hand that rests where it rests.

    A hand is as high above the floor as its shapes are thick.
    """
    home = turn @ (body.places[f"{side}_shoulder"] - body.between("hip"))
    upper = joints[f"{side}_elbow"] - joints[f"{side}_shoulder"]
    fore = joints[f"{side}_hand"] - joints[f"{side}_elbow"]
    elbow = hips + home + upper * (body.length("shoulder", "elbow") / _median(upper))
    hand = elbow + fore * (body.length("elbow", "hand") / _median(fore))
    weight = smooth(found.resting[f"{side}_hand"], fps)[:, None]
    hand = (1.0 - weight) * hand + weight * joints[f"{side}_hand"]
    hand[:, 2] = np.maximum(hand[:, 2], body.thickness[side])
    return {f"{side}_elbow": elbow, f"{side}_hand": hand}


def _median(vectors: Mat) -> float:
    return float(np.median(np.linalg.norm(vectors, axis=1)))


def turned(yaw: Vec, tilt: Vec) -> Mat:
    """Rz(yaw) Ry(tilt) ``(T, 3, 3)``: a positive tilt lifts the heel."""
    c, s, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(tilt), np.sin(tilt)
    zero = np.zeros_like(c)
    rows = [[c * cp, -s, c * sp], [s * cp, c, s * sp], [-sp, zero, cp]]
    return np.moveaxis(np.array(rows), 2, 0)
