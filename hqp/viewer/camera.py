"""Cameras of visitors: robot and targets in the part of the picture that is free, never from below the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec

OVERLAY = 325.0
"""Height of the headline and the cards [pixels]."""

MARGIN = 0.9
"""Part of the free picture that is used."""

NEAREST = 0.3
"""Least depth of a point in the picture [m]."""

LOWEST = 0.05
"""Height of the camera above the floor [m]."""

FORWARD = np.array([-1.45, 0.88, -0.12])
"""First view direction of a visitor."""

PERIOD = 0.5
"""Between two looks at whether all targets are in the picture [s]."""

ARRIVING = 4
"""Looks at a new visitor's camera, which comes to where viser has it first on its own."""

FAR = 10.0
"""A target that is further away than so many sizes of the robot is left out."""


@dataclass(frozen=True)
class Window:
    """Free part of a picture: slopes x / z and y / z from the view direction to its edges."""

    side: float
    top: float
    bottom: float

    @classmethod
    def of(cls, fov: float, width: float, height: float, overlay: float = OVERLAY) -> Window:
        """Window of a picture with that vertical field of view [rad] and size [pixels], below an overlay of that
        height."""
        half = math.tan(0.5 * fov)
        top = max(1.0 - 2.0 * overlay / height, -0.5)
        return cls(half * width / height, half * top, half)

    def fit(self, points: Mat, forward: Vec) -> tuple[Vec, Vec]:
        """Camera and its target, as near as all points ``(k, 3)`` are within ``MARGIN``, looking forward."""
        axes = _axes(forward)
        x, y, z = axes @ points.T
        middle, half = 0.5 * (self.top - self.bottom), 0.5 * MARGIN * (self.top + self.bottom)
        cx, depth_x = _between(x, z, MARGIN * self.side, MARGIN * self.side)
        cy, depth_y = _between(y, z, middle + half, half - middle)
        depth = min(depth_x, depth_y, float(np.min(z)) - NEAREST)
        camera = np.array([cx(depth), cy(depth), depth]) @ axes
        return camera, camera + (float(np.mean(z)) - depth) * axes[2]

    def holds(self, points: Mat, camera: Vec, forward: Vec) -> bool:
        """Return true if all points ``(k, 3)`` are in the picture."""
        x, y, z = _axes(forward) @ (points - camera).T
        inside = (abs(x) <= self.side * z) & (y <= self.top * z) & (y >= -self.bottom * z)
        return bool(np.all(inside & (z > 0.0)))


def _axes(forward: Vec) -> Mat:
    """Right, up and forward of a camera that stands upright, as rows."""
    f = forward / float(np.linalg.norm(forward))
    right = np.cross(f, [0.0, 0.0, 1.0])
    size = float(np.linalg.norm(right))
    right = right / size if size > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.array([right, np.cross(right, f), f])


def _between(a: Vec, z: Vec, high: float, low: float) -> tuple[Any, float]:
    """The camera's place at a depth, and the nearest depth d from which all a are within slopes -low and high.

    c is within max(a - high z) + high d and min(a + low z) - low d, which meet at the nearest depth.
    """
    least, most = float(np.max(a - high * z)), float(np.min(a + low * z))
    return lambda d: 0.5 * (least + high * d + most - low * d), (most - least) / (high + low)


class Cameras:
    """All visitors' cameras.  overlay: height of the overlay on the picture's upper part [pixels]."""

    def __init__(self, server: Any, points: Mat, overlay: float = OVERLAY) -> None:
        self._server, self._overlay = server, overlay
        self._before: dict[Any, tuple[int, Mat]] = {}
        self._expect(points)

        @server.on_client_connect  # type: ignore[untyped-decorator,unused-ignore]
        async def _(client: Any) -> None:
            @client.camera.on_update  # type: ignore[untyped-decorator,unused-ignore]
            async def _(camera: Any) -> None:
                _lift(client)

    def _expect(self, points: Mat) -> None:
        """Let visitors begin where they see all points ``(k, 3)``."""
        camera = self._server.initial_camera
        camera.position, camera.look_at = Window.of(camera.fov, 1100.0, 900.0, self._overlay).fit(points, FORWARD)

    def update(self, robot: Mat, targets: Mat) -> None:
        """Step back where a target that has moved, or a new visitor's, is outside of the picture."""
        centre = robot.mean(axis=0)
        size = float(np.linalg.norm(robot.max(axis=0) - robot.min(axis=0)))
        near = targets[np.linalg.norm(targets - centre, axis=1) < FAR * size]
        everything = np.vstack((robot, near))
        clients = self._server.get_clients()
        if not clients:
            self._expect(everything)
        self._before = {key: value for key, value in self._before.items() if key in clients}
        for key, client in clients.items():
            looks, before = self._before.get(key, (0, near))
            self._before[key] = looks + 1, near
            moved = before.shape != near.shape or bool(np.any(abs(near - before) > 0.01))
            if looks >= ARRIVING and not (moved and len(near)):
                continue
            camera = client.camera
            window = Window.of(camera.fov, camera.image_width, camera.image_height, self._overlay)
            forward = FORWARD if looks < ARRIVING else camera.look_at - camera.position
            points = everything if looks < ARRIVING else near
            if looks == 0 or not window.holds(points, camera.position, forward):
                _move(client, *window.fit(everything, forward))


def _move(client: Any, position: Vec, look_at: Vec) -> None:
    with client.atomic():
        client.camera.position = position
        client.camera.look_at = look_at  # after the position, which takes it along


def _lift(client: Any) -> None:
    """Keep a camera and its centre of rotation above the floor, at their distance."""
    camera = client.camera
    position, look_at = np.array(camera.position), np.array(camera.look_at)
    if position[2] >= LOWEST and look_at[2] >= 0.0:
        return
    distance = float(np.linalg.norm(position - look_at))
    position[2], look_at[2] = max(position[2], LOWEST), max(look_at[2], 0.0)
    way = position[:2] - look_at[:2]
    across = math.sqrt(max(distance**2 - (position[2] - look_at[2]) ** 2, 0.01))
    position[:2] = look_at[:2] + across * way / max(float(np.linalg.norm(way)), 1e-6)
    _move(client, position, look_at)
