"""Place of a task's reference in the scene, its distance from the robot, and the reference at a dragged place."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec

from .description import Target

XYZ = "xyz"
ARM = 0.4
"""Distance of a direction's handle from its frame [m]."""

TURN = 0.1
"""Length that a turn of 1 rad counts as, where one number stands for both [m]."""


class Point:
    """A point of a frame or a centre of mass, in some of the axes of the world or of another frame."""

    moves, turns = True, False
    """The handle can be moved; it can be turned."""

    def __init__(self, target: Target, robot: Any) -> None:
        self.target, self.robot = target, robot

    def here(self, state: Any) -> tuple[Vec, Mat]:
        """Present place of the controlled frame or point."""
        target = self.target
        if target.kind == "com":
            return state.com(self.robot.subtree(target.subtree) if target.subtree else 0), np.eye(3)
        R = state.rotation(target.frame)
        return state.position(target.frame) + R @ np.array(target.offset), R

    def there(self, state: Any, value: Vec) -> tuple[Vec, Mat]:
        """Place of the reference; coordinates that the task leaves free are the robot's."""
        origin, axes = self._observer(state)
        local = axes.T @ (self.here(state)[0] - origin)
        for number, axis in zip(value, self.target.axes, strict=True):
            local[XYZ.index(axis)] = number
        return origin + axes @ local, np.eye(3)

    def value(self, state: Any, position: Vec, R: Mat) -> Vec:
        """The reference of a handle that is put there."""
        origin, axes = self._observer(state)
        local = axes.T @ (position - origin)
        return np.array([local[XYZ.index(axis)] for axis in self.target.axes])

    def distance(self, state: Any, value: Vec) -> tuple[float, str]:
        """Distance of the robot from its reference [m], and the same in words."""
        d = float(np.linalg.norm(self.there(state, value)[0] - self.here(state)[0]))
        return d, length(d)

    def _observer(self, state: Any) -> tuple[Vec, Mat]:
        target = self.target
        if target.relative_to is None:
            return np.zeros(3), np.eye(3)
        R = state.rotation(target.relative_to)
        if target.heading:
            yaw = math.atan2(R[1, 0], R[0, 0])
            R = np.array([[math.cos(yaw), -math.sin(yaw), 0.0], [math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        return state.position(target.relative_to), R


class Rotation(Point):
    """The orientation of a frame: its handle stands where the frame is."""

    moves, turns = False, True

    def there(self, state: Any, value: Vec) -> tuple[Vec, Mat]:
        return self.here(state)[0], self._observer(state)[1] @ value.reshape(3, 3)

    def value(self, state: Any, position: Vec, R: Mat) -> Vec:
        return np.ravel(self._observer(state)[1].T @ R)

    def distance(self, state: Any, value: Vec) -> tuple[float, str]:
        turn = float(np.linalg.norm(self.robot.log3(self.here(state)[1] @ self.there(state, value)[1].T)))
        return turn, angle(turn)


class Angles(Rotation):
    """Some of roll, pitch and yaw of a frame; free ones are the robot's."""

    def there(self, state: Any, value: Vec) -> tuple[Vec, Mat]:
        from hqp.tasks.rotations import roll_pitch_yaw

        p, R = self.here(state)
        axes = self._observer(state)[1]
        angles = np.array(roll_pitch_yaw((axes.T @ R).tolist()))
        angles[list(self.target.angles)] = value
        return p, axes @ _turned(*angles)

    def value(self, state: Any, position: Vec, R: Mat) -> Vec:
        from hqp.tasks.rotations import roll_pitch_yaw

        angles = roll_pitch_yaw((self._observer(state)[1].T @ R).tolist())
        return np.array([angles[i] for i in self.target.angles])


class Pose(Point):
    """Position and orientation of a frame."""

    turns = True

    def there(self, state: Any, value: Vec) -> tuple[Vec, Mat]:
        origin, axes = self._observer(state)
        pose = value.reshape(4, 4)
        return origin + axes @ pose[:3, 3], axes @ pose[:3, :3]

    def value(self, state: Any, position: Vec, R: Mat) -> Vec:
        origin, axes = self._observer(state)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = axes.T @ R, axes.T @ (position - origin)
        return pose.ravel()

    def distance(self, state: Any, value: Vec) -> tuple[float, str]:
        (here, R), (there, aim) = self.here(state), self.there(state, value)
        d, turn = float(np.linalg.norm(there - here)), float(np.linalg.norm(self.robot.log3(R @ aim.T)))
        return max(d, TURN * turn), length(d) if d > TURN * turn else angle(turn)


class Gaze(Point):
    """A point that an axis of a frame is to point at."""

    def distance(self, state: Any, value: Vec) -> tuple[float, str]:
        here, R = self.here(state)
        turn = _between(R @ np.array(self.target.axis), value - here)
        return turn, angle(turn)


class Direction(Gaze):
    """A direction that an axis of a frame is to have: its handle stands some way along it."""

    def there(self, state: Any, value: Vec) -> tuple[Vec, Mat]:
        return self.here(state)[0] + ARM * value / max(float(np.linalg.norm(value)), 1e-9), np.eye(3)

    def value(self, state: Any, position: Vec, R: Mat) -> Vec:
        way = position - self.here(state)[0]
        size = float(np.linalg.norm(way))
        return np.asarray(way / size if size > 1e-6 else R[:, 0])

    def distance(self, state: Any, value: Vec) -> tuple[float, str]:
        turn = _between(self.here(state)[1] @ np.array(self.target.axis), value)
        return turn, angle(turn)


KINDS = {
    "point": Point, "com": Point, "pose": Pose, "rotation": Rotation, "angles": Angles, "gaze": Gaze,
    "direction": Direction,
}  # fmt: skip


def _between(a: Vec, b: Vec) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def _turned(roll: float, pitch: float, yaw: float) -> Mat:
    """Rz(yaw) Ry(pitch) Rx(roll)."""
    (a, b, c), (d, e, f) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    return np.array(
        [
            [c * b, c * e * d - f * a, c * e * a + f * d],
            [f * b, f * e * d + c * a, f * e * a - c * d],
            [-e, b * d, b * a],
        ]
    )


def length(metres: float) -> str:
    """Format a length for people."""
    if metres >= 1.0:
        return f"{metres:.2f} m"
    return f"{100.0 * metres:.1f} cm" if metres >= 0.01 else f"{1000.0 * metres:.1f} mm"


def angle(radians: float) -> str:
    """Format an angle for people."""
    degrees = math.degrees(radians)
    return f"{degrees:.0f}°" if degrees >= 9.95 else f"{degrees:.1f}°"
