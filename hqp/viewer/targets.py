"""Targets in the scene: a handle at each, a line from what should be there, and the distance in words."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec

from .channel import Channel
from .description import Target
from .meshes import quaternion, rotation

_AXES = "xyz"


class Handle:
    """One target that can be dragged; what is dragged goes into the channel in the task's own coordinates."""

    def __init__(self, server: Any, channel: Channel, index: int, target: Target, robot: Any) -> None:
        self.target, self.index = target, index
        self._channel, self._robot = channel, robot
        self.dragged = False
        free = [axis in target.axes for axis in _AXES]
        self._control = server.scene.add_transform_controls(
            f"/targets/{target.name}",
            scale=0.24,
            line_width=4.0,
            active_axes=tuple(free),
            disable_sliders=True,
            disable_rotations=target.kind not in ("pose", "rotation"),
            disable_axes=target.kind == "rotation",
            depth_test=False,
            visible=False,
        )
        self._ball = server.scene.add_icosphere(
            f"/targets/{target.name}/ball", radius=0.022, color=(217, 122, 0), cast_shadow=False
        )
        self._line = server.scene.add_line_segments(
            f"/errors/{target.name}", np.zeros((1, 2, 3)), (217, 122, 0), thickness=5.0, thickness_units="screen"
        )
        self._shown = False
        self._control.on_update(self._drag)

    def _drag(self, event: Any) -> None:
        if event.client is None:
            return
        self.dragged = True
        value = self._value(np.asarray(self._control.position), rotation(self._control.wxyz))
        self._channel.set_wanted(self.index, value)

    def release(self) -> None:
        """Give the target back to the loop."""
        self.dragged = False
        self._channel.set_wanted(self.index, None)

    def remove(self) -> None:
        """Take the target out of the scene."""
        for part in (self._ball, self._line, self._control):
            part.remove()

    def update(self, state: Any) -> tuple[float, str] | None:
        """Draw target and line for a state; the distance [m, rad] and the same in words."""
        value = self._channel.current(self.index, self.target.size)
        if value is None:
            return None
        here, here_R = self._frame(state)
        there, there_R = self._world(value, here, here_R)
        if not self.dragged:
            self._control.position, self._control.wxyz = there, quaternion(there_R)
        if not self._shown:
            self._control.visible = self._shown = True
        self._line.points = np.array([[here, there]])
        distance = float(np.linalg.norm(there - here))
        if self.target.kind in ("point", "com"):
            return distance, _length(distance)
        turn = float(np.linalg.norm(self._robot.log3(here_R @ there_R.T)))
        angle = f"{math.degrees(turn):.0f}°"
        if self.target.kind == "rotation":
            return turn, angle
        return max(distance, 0.1 * turn), _length(distance) if distance > 0.1 * turn else angle

    def _frame(self, state: Any) -> tuple[Vec, Mat]:
        """Where what the task controls is."""
        target = self.target
        if target.kind == "com":
            return state.com(), np.eye(3)
        R = state.rotation(target.frame)
        return state.position(target.frame) + R @ np.array(target.offset), R

    def _observer(self) -> tuple[Vec, Mat]:
        target = self.target
        if target.relative_to is None:
            return np.zeros(3), np.eye(3)
        state = self._robot.current
        R = state.rotation(target.relative_to)
        if target.heading:
            yaw = math.atan2(R[1, 0], R[0, 0])
            R = np.array([[math.cos(yaw), -math.sin(yaw), 0.0], [math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        return state.position(target.relative_to), R

    def _world(self, value: Vec, here: Vec, here_R: Mat) -> tuple[Vec, Mat]:
        """A value of the task as a place in the world; coordinates that it leaves free are those of the frame."""
        origin, view = self._observer()
        kind = self.target.kind
        if kind == "rotation":
            return here, value.reshape(3, 3)
        if kind == "pose":
            pose = value.reshape(4, 4)
            return origin + view @ pose[:3, 3], view @ pose[:3, :3]
        local = view.T @ (here - origin)
        for number, axis in zip(value, self.target.axes, strict=True):
            local[_AXES.index(axis)] = number
        return origin + view @ local, np.eye(3)

    def _value(self, position: Vec, R: Mat) -> Vec:
        """A place in the world as a value of the task."""
        origin, view = self._observer()
        kind = self.target.kind
        if kind == "rotation":
            return R.ravel()
        local = view.T @ (position - origin)
        if kind == "pose":
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = view.T @ R, local
            return pose.ravel()
        return np.array([local[_AXES.index(axis)] for axis in self.target.axes])


def _length(metres: float) -> str:
    if metres >= 1.0:
        return f"{metres:.2f} m"
    if metres >= 0.01:
        return f"{100.0 * metres:.1f} cm"
    return f"{1000.0 * metres:.1f} mm"
