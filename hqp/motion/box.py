"""A box that a person's hands carry, in the motion's world and in the robot's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError

from .contacts import Mask, rests

NEAR = 0.12
"""Distance of a hand's joint from the surface within which the hand may hold the box, for a leg of 1 m [m]."""


FIELDS = ("positions", "quaternions", "size")


@dataclass(frozen=True)
class Box:
    """Poses and edges of a box: positions ``(T, 3)`` of its centre, quaternions ``(T, 4)`` xyzw, size ``(3,)``.

    Lengths have the motion's unit.  Raises DeclarationError for shapes that do not fit, numbers that are not finite,
    quaternions of length zero and edges that are not positive.
    """

    positions: Any
    quaternions: Any
    size: Any

    def __post_init__(self) -> None:
        shapes = {"positions": (3,), "quaternions": (4,), "size": ()}
        for name, tail in shapes.items():
            try:
                numbers = np.array(getattr(self, name), dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise DeclarationError("box", f"{name} are not numeric", allowed="an array of numbers") from error
            fits = numbers.shape == (3,) if name == "size" else numbers.ndim == 2 and numbers.shape[1:] == tail
            if not (fits and np.isfinite(numbers).all()):
                allowed = "finite positions (T, 3), quaternions (T, 4), size (3,)"
                raise DeclarationError("box", name, value=numbers.shape, allowed=allowed)
            object.__setattr__(self, name, numbers)
        if len(self.positions) != len(self.quaternions):
            counts = len(self.positions), len(self.quaternions)
            raise DeclarationError("box", "positions and quaternions", value=counts, allowed="one each in every frame")
        if not (np.linalg.norm(self.quaternions, axis=1) > 1e-6).all():
            raise DeclarationError("box", "a quaternion of length zero", allowed="unit quaternions xyzw")
        if not (self.size > 0.0).all():
            raise DeclarationError("box", "size", value=self.size.tolist(), allowed="three positive edges")

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.positions)

    @property
    def rotations(self) -> Mat:
        """Axes of the box ``(T, 3, 3)``."""
        return np.asarray(Rotation.from_quat(self.quaternions).as_matrix())

    def frames(self, chosen: slice) -> Box:
        """The box in some frames."""
        return replace(self, positions=self.positions[chosen], quaternions=self.quaternions[chosen])

    def at_times(self, before: Vec, after: Vec) -> Box:
        """The box at other times [s], by cubic splines."""
        from scipy.interpolate import CubicSpline

        turns = RotationSpline(before, Rotation.from_quat(self.quaternions))(after)
        return replace(self, positions=CubicSpline(before, self.positions)(after), quaternions=turns.as_quat())

    def turned(self, R: Mat) -> Box:
        """The box in a world that is turned by R ``(3, 3)``."""
        turns = Rotation.from_matrix(R) * Rotation.from_quat(self.quaternions)
        return replace(self, positions=self.positions @ R.T, quaternions=turns.as_quat())

    def within(self, points: Mat) -> Mat:
        """Points ``(T, 3)`` in the axes of the box, from its centre."""
        return np.asarray(np.einsum("tji,tj->ti", self.rotations, points - self.positions))

    def lowest(self) -> Vec:
        """Heights of the lowest corners ``(T,)``."""
        return np.asarray(self.positions[:, 2] - np.abs(self.rotations[:, 2]) @ (0.5 * self.size))

    def held(self, hand: Mat, fps: float, leg: float) -> Mask:
        """Mask of the frames in which a hand ``(T, 3)`` is near the box and rests in its axes; leg: its length."""
        own = self.within(hand)
        outside = np.linalg.norm(np.maximum(np.abs(own) - 0.5 * self.size, 0.0), axis=1)
        return np.asarray(rests(own, fps, leg) & (outside < NEAR * leg))
