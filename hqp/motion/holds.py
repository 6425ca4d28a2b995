"""Feet that stand are held where they came to rest."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hqp.arrays import Mat, Vec

ALIKE = 2e-3
"""Height difference below which both ends of a foot count as lowest [m]."""


class Plane(NamedTuple):
    """A motion in the plane: a turn about the vertical through a point ``(2,)``, then a shift ``(2,)`` [m, rad]."""

    about: Vec
    shift: Vec
    angle: float

    @property
    def rotation(self) -> Mat:
        """``(3, 3)``."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def point(self, p: Vec) -> Vec:
        """Destination of a point ``(3,)``."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        (u, w), (dx, dy) = self.about, self.shift
        x, y = p[0] - u, p[1] - w
        return np.array([c * x - s * y + u + dx, s * x + c * y + w + dy, p[2]])


class Hold:
    """The motion that takes a foot's target to where it stands; after a foot leaves, its remaining offset.

    frames: number of frames of its fade.  end: support of the held foot, 1 the toe, -1 the heel, 0 for a foot in the
    air.  spot: its place ``(2,)`` [m].
    """

    def __init__(self, frames: float) -> None:
        self._frames, self._left = frames, 0.0
        self.end, self.spot = 0, np.zeros(2)
        self.plane: Plane | None = None

    def lower(self, toe: float, heel: float) -> int:
        """End to hold, from the heights of a foot's ends [m]: the lower one, or the toe of a flat foot."""
        if abs(toe - heel) < ALIKE:
            return self.end or 1
        return -1 if heel < toe else 1

    def take(self, end: int, spot: Vec, plane: Plane) -> None:
        """An end of the foot has come down."""
        self.end, self.spot, self.plane, self._left = end, spot, plane, 1.0

    def release(self) -> None:
        """The foot is in the air."""
        self.end = 0
        self._left = max(0.0, self._left - 1.0 / self._frames)
        if self._left == 0.0:
            self.plane = None

    @property
    def motion(self) -> Plane | None:
        """Hold of this frame."""
        if self.plane is None:
            return None
        share = self._left * self._left * (3.0 - 2.0 * self._left)
        return Plane(self.plane.about, share * self.plane.shift, share * self.plane.angle)


def turn(one: Mat, two: Mat) -> Vec:
    """Rotation vector that takes one to two, world axes ``(3,)`` [rad]; below half a turn."""
    W = (two @ one.T).tolist()
    x, y, z = 0.5 * (W[2][1] - W[1][2]), 0.5 * (W[0][2] - W[2][0]), 0.5 * (W[1][0] - W[0][1])
    sine, cosine = math.sqrt(x * x + y * y + z * z), 0.5 * (W[0][0] + W[1][1] + W[2][2] - 1.0)
    scale = math.atan2(sine, cosine) / sine if sine > 1e-9 else 1.0
    return np.array([scale * x, scale * y, scale * z])


def turns(axes: Mat) -> Mat:
    """Rotation vectors from each of some axes ``(n, 3, 3)`` to the next, world axes ``(n - 1, 3)`` [rad]."""
    from scipy.spatial.transform import Rotation

    between = axes[1:] @ np.swapaxes(axes[:-1], 1, 2)
    return np.asarray(Rotation.from_matrix(between).as_rotvec())
