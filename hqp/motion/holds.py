"""Feet that stand are held where they came to rest."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hqp.arrays import Mat, Vec


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
        """Where a point ``(3,)`` goes."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        (u, w), (dx, dy) = self.about, self.shift
        x, y = p[0] - u, p[1] - w
        return np.array([c * x - s * y + u + dx, s * x + c * y + w + dy, p[2]])


class Hold:
    """The motion that takes a foot's target to where it stands; of one that has left, what is left of it.

    frames: in so many it fades.
    """

    def __init__(self, frames: float) -> None:
        self._frames, self._left = frames, 0.0
        self._heel: bool | None = None
        self._plane = Plane(np.zeros(2), np.zeros(2), 0.0)

    def keep(self, edge: int) -> Plane | None:
        """That of a foot that stands as it did before; None where it has come down, or onto its other end."""
        return self._plane if self._heel is (edge < 0) else None

    def take(self, edge: int, plane: Plane) -> Plane:
        """The foot has come down."""
        self._heel, self._plane, self._left = edge < 0, plane, 1.0
        return plane

    def release(self) -> Plane | None:
        """The foot is in the air."""
        self._heel = None
        self._left = max(0.0, self._left - 1.0 / self._frames)
        if self._left == 0.0:
            return None
        share = self._left * self._left * (3.0 - 2.0 * self._left)
        return Plane(self._plane.about, share * self._plane.shift, share * self._plane.angle)


def turn(one: Mat, two: Mat) -> Vec:
    """Rotation vector that takes one to two, world axes ``(3,)`` [rad]; below half a turn."""
    W = (two @ one.T).tolist()
    x, y, z = 0.5 * (W[2][1] - W[1][2]), 0.5 * (W[0][2] - W[2][0]), 0.5 * (W[1][0] - W[0][1])
    sine, cosine = math.sqrt(x * x + y * y + z * z), 0.5 * (W[0][0] + W[1][1] + W[2][2] - 1.0)
    scale = math.atan2(sine, cosine) / sine if sine > 1e-9 else 1.0
    return np.array([scale * x, scale * y, scale * z])
