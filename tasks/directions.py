"""Directions and distances of frames: an axis along a direction or towards a point, frames some way apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec, cross
from hqp.declare import plans
from hqp.declare.element import Task, Unit
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError

from .fields import check_frame, set_vector
from .relative import UPRIGHT, skew

AHEAD = 1.0
"""Distance of the point at which a gaze is held [m]."""
NEAR = 1e-6
"""Least distance of a point that is looked at, and of two frames, to which there is a direction [m]."""


@dataclass(frozen=True, kw_only=True)
class _Axis(Task):
    """An axis of a frame: a unit vector a in the frame, u = R a in the world, B = (b, c) across it in the frame."""

    units: ClassVar[tuple[Unit, ...]] = ("rad",)

    frame: str
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)
        set_vector(self, "axis")
        if not any(self.axis):
            raise self.invalid("axis", self.axis, "a nonzero vector")

    def rows(self, robot: Robot) -> int:
        """2; raises FrameNotFound."""
        robot.frame(self.frame)
        return 2

    def basis(self) -> tuple[Vec, Vec, Vec]:
        """Unit vectors in the frame: the axis, and two across it, right-handed."""
        axis = np.array(self.axis) / math.hypot(*self.axis)
        first = skew(axis)[int(np.argmin(np.abs(axis)))]
        first = first / math.hypot(*first)
        return axis, first, skew(axis) @ first

    def direction(self, state: State) -> Vec:
        """The axis in the world, a unit vector ``(3,)``."""
        return state.rotation(self.frame) @ self.basis()[0]

    def across(self, state: State) -> Mat:
        """Two directions across the axis, fixed in the frame, in the world ``(2, 3)``."""
        return np.array(self.basis()[1:]) @ state.rotation(self.frame).T

    def pointing(self, robot: Robot, point: bool) -> plans.Pointing:
        """The native operation."""
        axis, first, other = (tuple(x.tolist()) for x in self.basis())
        return plans.Pointing(plans.frame(robot, self.frame), axis, first, other, point)

    def turn(self, state: State, wanted: Vec) -> Vec:
        """The turn ``(2,)`` [rad] that took the axis away from a unit vector, as angle times direction.

        At the antipode it is a half turn about one of the directions across.
        """
        u, B = self.direction(state), self.across(state)
        sine = B @ cross(wanted, u)
        size, cosine = float(math.hypot(*sine)), float(wanted @ u)
        if size < 1e-9:
            return np.zeros(2) if cosine > 0.0 else np.array([math.pi, 0.0])
        return np.asarray(sine * (math.atan2(size, cosine) / size))


def _unit(name: str, value: ArrayLike) -> Vec:
    vector = numbers(name, "direction", value, (3,))
    size = math.hypot(*vector.tolist())
    if math.isfinite(size) and size < NEAR:
        raise DeclarationError(name, "zero vector", value=value, allowed="a nonzero vector")
    return np.asarray(vector / size if math.isfinite(size) else vector)


@dataclass(frozen=True, kw_only=True)
class AlignAxis(_Axis):
    """An axis of a frame along a direction, free to turn about itself: two rows J = B^T R^T J_omega,

    e ``(2,)`` [rad] the rotation vector from the reference to the axis, in B, the directions across the axis.

    axis ``(3,)`` in the frame.  The reference is a direction ``(3,)`` in the world, which is normalised.
    Raises DeclarationError for fields and for a direction of no length, FrameNotFound on binding.
    """

    def value(self, state: State) -> Vec:
        """The axis in the world, a unit vector ``(3,)``."""
        return self.direction(state)

    def towards(self, state: State, direction: Vec) -> tuple[Vec, float]:
        """The direction to have ``(3,)``, and no distance."""
        return direction, math.inf

    def error(self, state: State, reference: Vec) -> Vec:
        """The turn from the reference ``(2,)`` [rad]."""
        return self.turn(state, reference)

    def jacobian(self, state: State) -> Mat:
        """J ``(2, nv)``."""
        return self.across(state) @ state.jacobian(self.frame)[3:]

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(2,)`` [rad/s^2]."""
        return self.across(state) @ state.drift(self.frame)[3:]

    def at(self, value: Any = None, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """A direction ``(3,)``, and feedforwards ``(2,)`` [rad/s, rad/s^2]; raises DeclarationError."""
        reference = self._at((2,), None, velocity, acceleration)
        return (
            reference
            if value is None
            else Reference(self.name, _unit(self.name, value), reference.velocity, reference.acceleration)
        )

    def plan(self, robot: Robot) -> plans.Pointing:
        """The native operation."""
        return self.pointing(robot, point=False)


@dataclass(frozen=True, kw_only=True)
class LookAt(_Axis):
    """An axis of a frame towards a point t: with d = |t - p| and w = (t - p) / d, two rows

    J = B^T R^T (J_omega + w x J_p / d), e ``(2,)`` [rad] the rotation vector from w to the axis.

    axis ``(3,)`` in the frame.  The reference is a point ``(3,)`` in the world [m]; the one 1 m ahead is held.
    Raises DeclarationError for fields, FrameNotFound on binding.
    """

    steered: ClassVar[bool] = True

    def value(self, state: State) -> Vec:
        """The point 1 m ahead on the axis ``(3,)`` [m]."""
        return np.asarray(state.position(self.frame) + AHEAD * self.direction(state))

    def towards(self, state: State, point: Vec | None) -> tuple[Vec, float]:
        """The direction of the point ``(3,)`` and its distance [m]."""
        way = (self.value(state) if point is None else point) - state.position(self.frame)
        d = max(float(math.hypot(*way.tolist())), NEAR)
        return way / d, d

    def error(self, state: State, reference: Vec) -> Vec:
        """The turn from the direction of the point ``(2,)`` [rad]."""
        return self.turn(state, self.towards(state, reference)[0])

    def jacobian(self, state: State, point: Vec | None = None) -> Mat:
        """J ``(2, nv)``, of the point meant."""
        (w, d), J = self.towards(state, point), state.jacobian(self.frame)
        return self.across(state) @ (J[3:] + skew(w) @ J[:3] / d)

    def drift(self, state: State, point: Vec | None = None) -> Vec:
        """dJ/dt v ``(2,)`` [rad/s^2]."""
        (w, d), rate, drift = self.towards(state, point), state.velocity(self.frame), state.drift(self.frame)
        v, omega, B = rate[:3], rate[3:], self.across(state)
        closing = -float(w @ v)  # rate of d
        w_rate = -(v - float(w @ v) * w) / d
        sight = cross(w, v) / d
        sight_rate = (cross(w_rate, v) + cross(w, drift[:3])) / d - sight * closing / d
        turning = cross(omega, B)  # rates of the directions across
        return np.asarray(B @ (drift[3:] + sight_rate) + turning @ (omega + sight))

    def at(self, value: Any = None, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """A point ``(3,)`` [m], and feedforwards ``(2,)`` [rad/s, rad/s^2]; raises DeclarationError."""
        reference = self._at((2,), None, velocity, acceleration)
        point = None if value is None else numbers(self.name, "point", value, (3,))
        return Reference(self.name, point, reference.velocity, reference.acceleration)

    def plan(self, robot: Robot) -> plans.Pointing:
        """The native operation."""
        return self.pointing(robot, point=True)


@dataclass(frozen=True, kw_only=True)
class Distance(Task):
    """The distance of two frames' origins: d = |p - p_other|, J = n . (J_p - J_other), n from the other to the frame,

    drift n. (a - a_other) + |v_across|^2 / d.  If they meet, n is the world's x.

    frame, other: names of frames, not the same.  Reference ``(1,)`` [m].
    Raises DeclarationError for fields, FrameNotFound on binding.
    """

    units: ClassVar[tuple[Unit, ...]] = ("m",)

    frame: str
    other: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)
        check_frame(self, "other", self.other)
        if self.frame == self.other:
            raise self.invalid("other", self.other, f"a frame other than {self.frame!r}")

    def default_name(self) -> str:
        """Both frames."""
        return f"{self.frame}_{self.other}_distance"

    def rows(self, robot: Robot) -> int:
        """1; raises FrameNotFound."""
        robot.frame(self.frame)
        robot.frame(self.other)
        return 1

    def _way(self, state: State) -> tuple[float, Vec]:
        way = state.position(self.frame) - state.position(self.other)
        d = float(math.hypot(*way.tolist()))
        return d, way / d if d > NEAR else np.array([1.0, 0.0, 0.0])

    def value(self, state: State) -> Vec:
        """d ``(1,)`` [m]."""
        return np.array([self._way(state)[0]])

    def jacobian(self, state: State) -> Mat:
        """J ``(1, nv)``."""
        own = state.jacobian(self.frame)[:3].copy()
        return (self._way(state)[1] @ (own - state.jacobian(self.other)[:3]))[None]

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(1,)`` [m/s^2]."""
        d, n = self._way(state)
        v = state.velocity(self.frame)[:3] - state.velocity(self.other)[:3]
        across = v - float(n @ v) * n
        a = state.drift(self.frame)[:3] - state.drift(self.other)[:3]
        return np.array([float(n @ a) + float(across @ across) / max(d, NEAR)])

    def at(self, value: Any = None, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """Distance [m], its rate and its acceleration, a number each; raises DeclarationError."""
        return self._at((1,), *(None if x is None else np.atleast_1d(x) for x in (value, velocity, acceleration)))

    def plan(self, robot: Robot) -> plans.Apart:
        """The native operation."""
        other = plans.relative_frame(robot, self.other, False, UPRIGHT)
        return plans.Apart(*plans.apart(plans.frame(robot, self.frame), other))
