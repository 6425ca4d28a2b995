"""Wheels on the ground: no slip, no lift."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Constraint, Task
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot, State

from .fields import check_frame, set_number, set_vector, unit
from .relative import Triple, skew

UP: Triple = (0.0, 0.0, 1.0)
ALIGNED = 1e-9  # below this sine an axle is along the normal


@dataclass(frozen=True, kw_only=True)
class _Wheel(Task, Constraint):
    """A wheel of radius r whose centre p is r above the ground along its normal n: delta = -r n to the contact point.

    In a direction u of the ground the contact point's velocity gives the row u^T (J_v - [delta]x J_omega).  Rolling: u
    = n x a / |n x a| with a the axle, the direction the wheel rolls in, so perpendicular to the axle.  Normal: n^T J_v.
    The distance rolled is no function of the configuration: its error is zero; the error of the normal row is n. (p -
    p_0) [m], which keeps the wheel on its plane.  An axle along n leaves no direction to roll in: its rolling rows are
    then zero.
    """

    is_contact: ClassVar[bool] = True
    grounded: ClassVar[bool] = True
    _picked: ClassVar[tuple[int, ...]]

    wheel: str
    radius: float | None = None
    axle: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "wheel", self.wheel)
        if self.radius is not None:
            set_number(self, "radius", 0.0, strict=True)
        if self.axle is not None:
            set_vector(self, "axle")
            if not any(self.axle):
                raise self.invalid("axle", self.axle, "a nonzero vector")

    def default_name(self) -> str:
        """The wheel's frame."""
        return self.wheel

    def geometry(self, robot: Robot) -> tuple[float, Triple]:
        """Radius [m] and unit axle in the wheel's frame, the robot's own where none was given."""
        known = robot.wheels.get(self.wheel)
        radius = known.radius if self.radius is None and known is not None else self.radius
        axle = known.axle if self.axle is None and known is not None else self.axle
        if radius is None or axle is None:
            listed = ", ".join(robot.wheels) or "none"
            raise self.invalid(
                "radius and axle", self.wheel, f"radius=..., axle=... or a wheel of {robot.name}: {listed}"
            )
        x, y, z = (float(c) for c in axle)
        length = math.hypot(x, y, z)
        return float(radius), (x / length, y / length, z / length)

    def rows(self, robot: Robot) -> int:
        """Number of directions; raises FrameNotFound, and DeclarationError for a wheel without radius or axle."""
        robot.frame(self.wheel)
        self.geometry(robot)
        return len(self._picked)

    def value(self, state: State) -> Vec:
        """The wheel's centre ``(3,)`` in the world [m]."""
        return state.position(self.wheel)

    def error(self, state: State, reference: Vec, normal: Vec | None = None) -> Vec:
        """Zero for the directions of the ground, n . (p - p_0) [m] for the normal, ``(m,)``."""
        n = np.array(UP) if normal is None else normal
        error = np.zeros(len(self._picked))
        error[-1] = n @ (self.value(state) - reference)
        return error

    def jacobian(self, state: State, normal: Vec | None = None) -> Mat:
        """u^T (J_v - [delta]x J_omega) for each direction u, ``(m, nv)``."""
        along, delta, _ = self._directions(state, normal)
        J = state.jacobian(self.wheel)
        return along @ (J[:3] - skew(delta) @ J[3:])

    def drift(self, state: State, normal: Vec | None = None) -> Vec:
        """dJ/dt v ``(m,)`` with normals fixed: u . (a + alpha x delta) + du/dt . (v + omega x delta) [m/s^2]."""
        along, delta, rates = self._directions(state, normal)
        velocity, drift = state.velocity(self.wheel), state.drift(self.wheel)
        slip = velocity[:3] + skew(velocity[3:]) @ delta
        return along @ (drift[:3] + skew(drift[3:]) @ delta) + rates @ slip

    def _directions(self, state: State, normal: Vec | None) -> tuple[Mat, Vec, Mat]:
        """Directions ``(m, 3)``, delta ``(3,)`` and the directions' rates ``(m, 3)``."""
        n = np.array(UP) if normal is None else np.asarray(normal, dtype=np.float64)
        radius, axle = self.geometry(state.robot)
        a = state.rotation(self.wheel) @ np.array(axle)
        picked = list(self._picked)
        along = directions(a, n)
        w = skew(n) @ a
        turning = skew(n) @ skew(state.velocity(self.wheel)[3:]) @ a
        rolling = np.zeros(3)
        if along[0].any():
            rolling = (turning - along[0] * (along[0] @ turning)) / math.hypot(*w)
        rates = np.array([rolling, -(skew(n) @ rolling), np.zeros(3)])
        return along[picked], -radius * n, rates[picked]

    def at(
        self,
        value: ArrayLike | None = None,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        normal: ArrayLike | None = None,
        gravity_normal: ArrayLike | None = None,
    ) -> Reference:
        """Ground under the wheel, for one tick.

        normal, gravity_normal: ground normals in world axes ``(3,)``, scaled to unit length, vertical by default; the
        second is for the gravity compensation alone.  value: a place of the wheel's centre on its plane ``(3,)`` [m];
        without one the error is carried on where the normal changes.  velocity, acceleration: the ground's own along
        the rows.  Raises DeclarationError for shapes and zero normals.
        """
        k = len(self._picked)
        return Reference(
            self.name,
            None if value is None else numbers(self.name, "value", value, (3,)),
            None if velocity is None else numbers(self.name, "velocity", velocity, (k,)),
            None if acceleration is None else numbers(self.name, "acceleration", acceleration, (k,)),
            None if normal is None else unit(self.name, "normal", normal),
            None if gravity_normal is None else unit(self.name, "gravity_normal", gravity_normal),
        )

    def force_basis(self) -> Mat:
        """Force ``(3, m)`` along (rolling, lateral, normal) of the forces that act along the rows."""
        return np.eye(3)[:, list(self._picked)]

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The directions."""
        return tuple(("rolling", "lateral", "normal")[k] for k in self._picked)

    def plan(self, robot: Robot) -> plans.Wheel:
        """The native operation."""
        return plans.Wheel(plans.frame(robot, self.wheel), *self.geometry(robot), self._picked, ALIGNED)


def directions(axle: Vec, normal: Vec) -> Mat:
    """Rolling, lateral and normal direction ``(3, 3)``; the first two zero where the axle is along the normal."""
    across = skew(normal) @ axle
    length = math.hypot(*across)
    rolling = across / length if length > ALIGNED else np.zeros(3)
    return np.array([rolling, skew(rolling) @ normal, normal])


@dataclass(frozen=True, kw_only=True)
class OmniWheelContact(_Wheel):
    """An omnidirectional wheel on the ground: rolling and normal rows; across, its rollers are free.

    wheel: frame that turns with the wheel, at its centre.  radius [m], axle ``(3,)`` in that frame: the robot's own
    where it knows its wheels.  Rows: u^T (J_v - [delta]x J_omega) with u perpendicular to axle and ground normal,
    then n^T J_v; the normals come with ``at``.  Raises DeclarationError for fields and for a wheel without radius or
    axle, FrameNotFound on binding (Sentis 2012, eqs. 9 to 11, with J_v and J_omega and the direction set right).
    """

    _picked: ClassVar[tuple[int, ...]] = (0, 2)


@dataclass(frozen=True, kw_only=True)
class WheelContact(_Wheel):
    """An ordinary wheel on the ground: rolling, lateral and normal rows; like OmniWheelContact, but no slip across.

    Fields and errors as for OmniWheelContact; the lateral direction is the axle's in the ground plane.
    """

    _picked: ClassVar[tuple[int, ...]] = (0, 1, 2)
