"""Targets in the scene: a handle at each, and a line from its frame."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from hqp.arrays import Vec

from .channel import Channel
from .description import Target
from .meshes import quaternion, rotation
from .places import KINDS, XYZ

SIZE = 0.24
"""Length of a handle's arrows [m]."""

_ORANGE = (217, 122, 0)


class Handle:
    """One target; if it can be dragged, its place goes into the channel in the task's own coordinates.

    there: its place in the world [m], None while unknown.  touched: when it was dragged last [s].
    """

    def __init__(self, server: Any, channel: Channel, index: int, target: Target, robot: Any, drag: bool) -> None:
        self.target, self.index = target, index
        self._channel, self.place = channel, KINDS[target.kind](target, robot)
        self._dragged = self._moved = self._shown = False
        self.there: Vec | None = None
        self.touched = 0.0
        scene, name = server.scene, f"/targets/{target.name}"
        if drag:
            self._control = scene.add_transform_controls(
                name,
                scale=SIZE,
                line_width=4.0,
                active_axes=tuple(axis in target.axes for axis in XYZ),
                disable_sliders=True,
                disable_rotations=not self.place.turns,
                disable_axes=not self.place.moves,
                depth_test=False,
                visible=False,
            )
            self._control.on_update(self._drag)
        else:
            self._control = scene.add_frame(name, axes_length=0.12, axes_radius=0.004, visible=False)
        self._ball = scene.add_icosphere(f"{name}/ball", radius=0.022, color=_ORANGE, cast_shadow=False)
        self._line = scene.add_line_segments(
            f"/errors/{target.name}", np.zeros((1, 2, 3)), _ORANGE, thickness=5.0, thickness_units="screen"
        )

    def _drag(self, event: Any) -> None:
        # in a thread of viser's: the robot's state is another one's, so ``update`` reads where the handle is
        if event.client is not None:
            self._dragged = self._moved = True
            self.touched = time.monotonic()

    def release(self) -> None:
        """Give the target back to the loop."""
        self._dragged = self._moved = False
        self._channel.set_wanted(self.index, None)

    def remove(self) -> None:
        """Take the target out of the scene."""
        for part in (self._ball, self._line, self._control):
            part.remove()

    def update(self, state: Any) -> tuple[float, str] | None:
        """Draw target and line for a state; the distance [m, rad] and the same in words."""
        if self._moved:
            self._moved = False
            position, R = np.asarray(self._control.position), rotation(self._control.wxyz)
            self._channel.set_wanted(self.index, self.place.value(state, position, R))
        value = self._channel.current(self.index, self.target.size)
        if value is None or not np.isfinite(value).all():
            return None
        there, R = self.place.there(state, value)
        self.there = there
        if not self._dragged:
            self._control.position, self._control.wxyz = there, quaternion(R)
        if not self._shown:
            self._control.visible = self._shown = True
        self._line.points = np.array([[self.place.here(state)[0], there]])
        return self.place.distance(state, value)
