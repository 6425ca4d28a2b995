"""A robot as a person: places of a map's frames at home, and lengths of its limbs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, ModelError
from hqp.tasks.distances import of_axes
from hqp.tasks.support_polygon import hull

from .beside import Leg
from .joints import SIDES
from .skeleton_map import SkeletonMap

SHORTEST = 0.02
"""Length of a limb below which two of its frames coincide [m]."""


@dataclass(frozen=True)
class Body:
    """A robot at home, turned to face x, its soles level.

    places, axes: position ``(3,)`` [m] and rotation ``(3, 3)`` of each part.  middle: half way between the hips in the
    axes of the pelvis ``(3,)``.  ankles: height of each ankle above its sole [m].  lever: from each ankle to its sole
    ``(3,)``.  toes, heels: front and back of each sole, in axes x forward, y left, z up at the sole's point ``(3,)``.
    corners: corners of the rectangle around each sole, in the same axes ``(4, 3)``.  soles: corners of the sole itself,
    counter-clockwise ``(m, 3)``.  legs: soles, ankles and shanks of both legs, seen from above.
    thickness: least height of each hand whose capsules are above the floor [m].
    """

    places: dict[str, Vec]
    axes: dict[str, Mat]
    middle: Vec
    levers: dict[str, Vec]
    toes: dict[str, Vec]
    heels: dict[str, Vec]
    corners: dict[str, Mat]
    soles: dict[str, Mat]
    legs: dict[str, Leg]
    thickness: dict[str, float]

    @staticmethod
    def of(robot: Robot, found: SkeletonMap) -> Body:
        """Measure a robot under its map; raises DeclarationError where two frames of a limb are at one place."""
        ahead = _facing(robot, [found.frames[f"{side}_sole"] for side in SIDES])
        state = robot.state(robot.home)
        axes = {part: ahead.T @ state.rotation(frame) for part, frame in found.frames.items()}
        places = {
            part: ahead.T @ state.position(frame) + axes[part] @ np.array(found.offset(part))
            for part, frame in found.frames.items()
        }
        for side in SIDES:
            for one, two in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "hand")):
                if np.linalg.norm(places[f"{side}_{one}"] - places[f"{side}_{two}"]) < SHORTEST:
                    raise DeclarationError(
                        "map", f"{side}_{one} and {side}_{two} are at one place", allowed="frames at two joints"
                    )
        hips = 0.5 * (places["left_hip"] + places["right_hip"])
        levers, toes, heels, corners, soles, legs = {}, {}, {}, {}, {}, {}
        for side in SIDES:
            sole = f"{side}_sole"
            level, outline = _outline(robot, found.frames[sole], np.array(found.offset(sole)), ahead)
            axes[sole] = level @ axes[sole]
            levers[side] = level @ (places[sole] - places[f"{side}_ankle"])
            low, high = outline.min(axis=0), outline.max(axis=0)
            soles[side] = np.column_stack((outline, np.zeros(len(outline))))
            toes[side], heels[side] = np.array([high[0], 0.0, 0.0]), np.array([low[0], 0.0, 0.0])
            shank, top = _shank(robot, found.frames[f"{side}_knee"]), _top(robot, found, side, axes[sole])
            legs[side] = Leg(outline, -levers[side], shank, max(top, -float(levers[side][2])))
            corners[side] = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
        middle = axes["pelvis"].T @ (hips - places["pelvis"])
        hands = {side: ahead @ places[f"{side}_hand"] for side in SIDES}
        thickness = {side: _thickness(robot, found.frames[f"{side}_hand"], hands[side]) for side in SIDES}
        return Body(places, axes, middle, levers, toes, heels, corners, soles, legs, thickness)

    def length(self, one: str, two: str) -> float:
        """Length of a limb, the mean of both sides [m]."""
        ways = [self.places[f"{side}_{one}"] - self.places[f"{side}_{two}"] for side in SIDES]
        return float(np.mean([np.linalg.norm(way) for way in ways]))

    @property
    def leg(self) -> float:
        """From hip to ankle, stretched [m]."""
        return self.length("hip", "knee") + self.length("knee", "ankle")

    def between(self, limb: str) -> Vec:
        """Half way between a limb of both sides at home ``(3,)`` [m]."""
        return np.asarray(0.5 * (self.places[f"left_{limb}"] + self.places[f"right_{limb}"]))

    def width(self, limb: str) -> float:
        """Between a limb of both sides [m]."""
        return float(np.linalg.norm(self.places[f"left_{limb}"] - self.places[f"right_{limb}"]))


def _thickness(robot: Robot, frame: str, place: Vec) -> float:
    """Distance of a point from the surface of its link's capsules, in which it is; 0 outside and without shapes [m]."""
    robot.state(robot.home).kinematics()
    body = robot.body(robot.frame(frame))
    position, rotation = robot.bodies[body][5]
    try:
        own = [capsule for capsule in robot.capsules if capsule.body == body]
    except ModelError:
        return 0.0
    at = (rotation.T @ (place - position))[None]
    axes = ((np.array(c.a)[None], np.array(c.b)[None]) for c in own)
    depths = (c.radius - float(of_axes(at, at, *axis)[0]) for c, axis in zip(own, axes, strict=True))
    return max((0.0, *depths))


def _shank(robot: Robot, frame: str) -> Mat:
    """Corners of a circle as thick as the thickest capsule of a link ``(n, 2)``, its middle without shapes [m]."""
    body, turn = robot.body(robot.frame(frame)), np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    try:
        radius = max((capsule.radius for capsule in robot.capsules if capsule.body == body), default=0.0)
    except ModelError:
        radius = 0.0
    return radius * np.column_stack((np.cos(turn), np.sin(turn)))


def _top(robot: Robot, found: SkeletonMap, side: str, axes: Mat) -> float:
    """Height of the shapes of a foot's link above its sole, whose frame has axes ``(3, 3)``, 0 without shapes [m]."""
    from hqp.robots.soles import swept

    frame, offset = found.frames[f"{side}_sole"], np.array(found.offset(f"{side}_sole"))
    state = robot.state(robot.home)
    state.kinematics()
    place, turn = robot.bodies[robot.body(robot.frame(frame))][5]
    own, at = state.rotation(frame), state.position(frame)
    up = axes[2] @ own.T  # up in the world, with the sole level
    heights = (((place + corners @ turn.T - at) @ up).max() + radius for corners, radius in swept(robot, frame))
    return max((0.0, *(float(height - axes[2] @ offset) for height in heights)))


def _facing(robot: Robot, soles: list[str]) -> Mat:
    """Columns ahead, left and up at home, by the frames of both soles ``(3, 3)``; x is ahead if feet are in line."""
    from hqp.robots.soles import standing_axes

    try:
        return standing_axes(robot, *(robot.body(robot.frame(frame)) for frame in soles))
    except ModelError:
        return np.eye(3)


def _outline(robot: Robot, frame: str, offset: Vec, ahead: Mat) -> tuple[Mat, Mat]:
    """Rotation ``(3, 3)`` that makes a sole level from its pose at home, and its corners from above then, seen from its
    point ``(m, 2)`` [m], ahead and left; two points 10 cm apart without shapes.
    """
    from hqp.robots.soles import level_sole

    try:
        turn, points = level_sole(robot, frame)
    except ModelError:
        turn, points = np.eye(3), np.zeros((0, 3))
    if len(points) < 2:
        return np.eye(3), np.array([[-0.05, 0.0], [0.05, 0.0]])
    state = robot.state(robot.home)
    seen = ((points - state.position(frame) - turn @ state.rotation(frame) @ offset) @ ahead)[:, :2]
    return ahead.T @ turn @ ahead, np.asarray(seen[hull(seen)])
