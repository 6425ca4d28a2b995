"""Bounds kept with declared rates: the way left to each, its velocity, and the acceleration with which it is kept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare.element import Inequality
from hqp.declare.robot import State

from .fields import set_number

FAST = 4.0
"""The second pole over the first where x is an acceleration."""


@dataclass(frozen=True, kw_only=True)
class _Barrier(Inequality):
    """Bounds kept with declared rates.  With h the way left to a bound, negative outside, its velocity towards it is

        u <= phi(h),    phi(h) = rate h inside,    phi(h) = -recovery tanh(rate |h| / recovery) outside;

    for accelerations, a = J x + dJ/dt v towards the bound follows that with a second pole of 4 rate,

        a <= 4 rate (phi(h) - u) - phi'(h) u.

    If the bounds move, at the reference's velocity and acceleration, u and a are relative to them.  A return sets in
    gradually: outside, the demand is at most a <= -acceleration - 5 rate max(u, 0), at velocity level on the change of
    u in a tick from the last command.

    A base class: subclasses define ``jacobian``, ``drift`` and ``bounds``.  rate [1/s]: at most 1/dt, 1/(4 dt) where x
    is an acceleration.  recovery: fastest way back [m/s or rad/s].  acceleration: with which it sets in [m/s^2 or
    rad/s^2], rate * recovery by default.
    """

    rate: float = 5.0
    recovery: float = 0.5
    acceleration: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "rate", 0.0, strict=True)
        set_number(self, "recovery", 0.0, strict=True)
        if self.acceleration is not None:
            set_number(self, "acceleration", 0.0, strict=True, infinite=True)

    @property
    def outset(self) -> float:
        """The acceleration with which a return sets in."""
        return self.rate * self.recovery if self.acceleration is None else self.acceleration

    def step_bounds(
        self, state: State, dt: float, order: int, *steer: Any, velocity: Any = None, acceleration: Any = None
    ) -> tuple[Vec, Vec]:
        """(lower, upper) ``(m,)`` of J x, infinite where there is no bound.

        velocity, acceleration: motion of the reference, zero by default.
        """
        lower, upper = (np.atleast_1d(np.asarray(way, dtype=np.float64)) for way in self.bounds(state, *steer))
        u, a = self.carried(state, velocity, acceleration, *steer)
        v = state.v if order == 2 or state.commanded is None else state.commanded
        speed = self.jacobian(state, *steer) @ v - u
        if order == 1:
            return u - self.next(-lower, -speed, dt), u + self.next(upper, speed, dt)
        a = a - self.drift(state, *steer)
        return a - self.hardest(-lower, -speed), a + self.hardest(upper, speed)

    def carried(self, state: State, velocity: Any, acceleration: Any, *steer: Any) -> tuple[Any, Any]:
        """Velocity and acceleration ``(m,)`` of the bounds, those of the reference."""
        return (0.0 if velocity is None else velocity), (0.0 if acceleration is None else acceleration)

    def next(self, way: Vec, speed: Vec, dt: float) -> Vec:
        """The largest velocity ``(m,)`` towards a bound in the next tick, at a speed in this one."""
        least = speed - dt * self.outset - min(1.0, dt * (1.0 + FAST) * self.rate) * np.maximum(speed, 0.0)
        wanted = self.fastest(way)
        return np.where(way < 0.0, np.maximum(wanted, least), wanted)

    def fastest(self, way: Vec) -> Vec:
        """phi ``(m,)``: the largest velocity towards a bound."""
        back = -self.recovery * np.tanh(self.rate * np.abs(np.minimum(way, 0.0)) / self.recovery)
        return np.where(way >= 0.0, self.rate * way, back)

    def hardest(self, way: Vec, speed: Vec) -> Vec:
        """The largest acceleration ``(m,)`` towards a bound that is approached at a speed."""
        wanted = self.fastest(way)
        slope = np.where(way >= 0.0, self.rate, self.rate * (1.0 - (wanted / self.recovery) ** 2))
        with np.errstate(invalid="ignore"):
            most = np.where(np.isinf(way), way, FAST * self.rate * (wanted - speed) - slope * speed)
        least = -self.outset - (1.0 + FAST) * self.rate * np.maximum(speed, 0.0)
        return np.where(way < 0.0, np.maximum(most, least), most)
