"""An axis of a frame kept inside a cone about a direction, or about the line to a point."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from hqp.arrays import Mat, Vec, cross
from hqp.declare import plans
from hqp.declare.element import plan_of
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot, State

from .barrier import _Barrier
from .directions import AlignAxis, LookAt
from .fields import set_number

STRAIGHT_BACK = 1e-3
"""Sine of the angle below which an axis that points away has no direction to come back in."""


@dataclass(frozen=True, kw_only=True)
class Cone(_Barrier):
    """An axis u of a frame no further than an angle from where its task wants it, w: theta(u, w) <= angle, one row.

    The way left is (cos theta - cos angle) / sin(angle) inside and angle - theta outside [rad], the same to first order
    at the bound, and smooth where u and w agree.  task: an AlignAxis, w its direction, or a LookAt, w the direction of
    its point, a gaze cone; the reference is the task's, by default its hold value, ``(3, 3)`` with its velocity and
    acceleration in the world.  angle [rad]: above 0, at most pi / 2.  rate [1/s], recovery [rad/s], acceleration
    [rad/s^2]: see ``Within``.  Raises DeclarationError for fields, FrameNotFound on binding.
    """

    steered: ClassVar[bool] = True

    task: AlignAxis | LookAt = field(kw_only=False)
    angle: float

    def __post_init__(self) -> None:
        if not isinstance(self.task, (AlignAxis, LookAt)):
            raise self.invalid("task", self.task, "an AlignAxis or a LookAt")
        super().__post_init__()
        set_number(self, "angle", 0.0, strict=True)
        if self.angle > 0.5 * math.pi:
            raise self.invalid("angle", self.angle, "at most pi / 2")

    def default_name(self) -> str:
        """The task's name and ``_cone``."""
        return f"{self.task.name}_cone"

    def rows(self, robot: Robot) -> int:
        """1; raises FrameNotFound."""
        self.task.rows(robot)
        return 1

    def hold(self, state: State) -> Reference:
        """Hold value of the task, at rest."""
        return self.at(self.task.hold(state).value)

    def at(self, value: Any, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """A point [m], or a direction of length 1, with velocity and acceleration ``(3,)``; raises DeclarationError."""
        held = np.zeros((3, 3))
        held[0] = self.task.at(value).value
        for i, (what, x) in enumerate({"velocity": velocity, "acceleration": acceleration}.items(), 1):
            if x is not None:
                held[i] = numbers(self.name, what, x, (3,))
        return Reference(self.name, held)

    def _parts(self, state: State, reference: Any) -> tuple[float, float, Vec, float, Vec]:
        """cos and sin of theta, w, the distance of the point (infinite for a direction), and u x w."""
        w, d = self.task.towards(state, self._held(state, reference)[0])
        u = self.task.direction(state)
        turn = cross(u, w)
        return float(u @ w), math.hypot(*turn), w, d, turn

    def _held(self, state: State, reference: Any) -> Mat:
        held: Any = self.hold(state).value if reference is None else reference
        return np.asarray(held)

    def carried(self, state: State, velocity: Any, acceleration: Any, *steer: Any) -> tuple[Any, Any]:
        """Velocity ``(1,)`` of the bound where w turns by itself; its acceleration is in the drift."""
        held = self._held(state, *(steer or (None,)))
        if not held[1:].any():
            return 0.0, 0.0
        cosine, sine, w, d, _ = self._parts(state, held)
        turning = _across(held[1], w) / (1.0 if math.isinf(d) else d)
        return np.array([-(self.task.direction(state) @ turning) / self._scale(cosine, sine)]), 0.0

    def _scale(self, cosine: float, sine: float) -> float:
        """Divisor of u x w: sin(angle) inside, sin(theta) outside."""
        inside = cosine >= math.cos(self.angle)
        return math.sin(self.angle) if inside else max(sine, STRAIGHT_BACK)

    def bounds(self, state: State, reference: Any = None) -> tuple[Vec, float]:
        """(minus the way left, inf)."""
        cosine, sine, *_ = self._parts(state, reference)
        if cosine >= math.cos(self.angle):
            way = (cosine - math.cos(self.angle)) / math.sin(self.angle)
        else:
            way = self.angle - math.atan2(sine, cosine)
        return np.array([-way]), math.inf

    def jacobian(self, state: State, reference: Any = None) -> Mat:
        """Rate of the way left ``(1, nv)``: d(u . w)/dt over the scale, with omega and the sight line's turn."""
        cosine, sine, w, d, turn = self._parts(state, reference)
        u, J = self.task.direction(state), state.jacobian(self.task.frame)
        across = u - cosine * w  # w turns by -(v - w w.v) / d
        return ((turn @ J[3:] - across @ J[:3] / d) / self._scale(cosine, sine))[None]

    def drift(self, state: State, reference: Any = None) -> Vec:
        """dJ/dt v ``(1,)``, including the motion of w."""
        cosine, sine, w, d, _ = self._parts(state, reference)
        u, rate, drift = self.task.direction(state), state.velocity(self.task.frame), state.drift(self.task.frame)
        omega = rate[3:]
        u1 = cross(omega, u)
        u2 = cross(drift[3:], u) + cross(omega, u1)
        _, velocity, acceleration = self._held(state, reference)
        if math.isinf(d):
            w1 = _across(velocity, w)
            w2 = _across(acceleration, w) - float(w1 @ w1) * w
        else:
            v, a = rate[:3] - velocity, drift[:3] - acceleration
            closing = float(w @ v)
            w1 = -_across(v, w) / d
            w2 = -(a - float(w1 @ v + w @ a) * w - closing * w1) / d + w1 * closing / d
        first, second = float(u1 @ w + u @ w1), float(u2 @ w + 2.0 * (u1 @ w1) + u @ w2)
        scale = self._scale(cosine, sine)
        if cosine >= math.cos(self.angle):
            return np.array([second / scale])
        return np.array([(second + cosine * (first / scale) ** 2) / scale])

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The angle."""
        return ("angle",)

    def plan(self, robot: Robot) -> plans.Cone | None:
        """The native operation; none for a task with functions of its own."""
        own = plan_of(self.task, robot)
        if not isinstance(own, plans.Pointing):
            return None
        parts = (own.frame, own.axis, own.first, own.other, own.point)
        return plans.Cone(*parts, self.angle, self.rate, self.recovery, self.outset)


def _across(x: Vec, w: Vec) -> Vec:
    """The part of a vector across a direction."""
    return np.asarray(x - float(w @ x) * w)
