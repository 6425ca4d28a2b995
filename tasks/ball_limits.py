"""Limits of ball joints: bound on the angle of a joint from its zero, about any axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Inequality
from hqp.declare.robot import Robot, State

from .fields import set_names, set_number
from .limits import ACCELERATION, APPROACH, BRAKING, JointLimits, fastest, gradual, horizon

STRAIGHT = 1e-3
"""A joint that is turned by less [rad] has no direction to turn back in, and a long way to go: its row is free."""


@dataclass(frozen=True, kw_only=True)
class BallLimits(Inequality):
    """Balls turned by at most their limit: with r the rotation vector, theta = |r| and u = r / theta, one row each,

        theta <= theta_max,   J v = u . omega = d theta / dt,   dJ/dt v = |omega - u (u . omega)|^2 cot(theta / 2) / 2,

    approached on the braking curve of ``JointLimits`` and left at its return velocity, which is reached at most at its
    acceleration.  A session adds it to a stack that has ``JointLimits`` of such joints and no BallLimits.

    joints: balls or groups with balls, all that have a limit by default.  margin [rad].  acceleration, braking
    [rad/s^2], 0 or None for none.  approach [1/s], as of JointLimits.  return_velocity [rad/s].  Raises
    DeclarationError for fields and where no joint is a limited ball.
    """

    joints: str | Sequence[str] | None = None
    margin: float = 0.0
    acceleration: float | None = ACCELERATION
    braking: float | None = BRAKING
    approach: float | None = APPROACH
    return_velocity: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")
        for name in ("acceleration", "braking", "approach"):
            object.__setattr__(self, name, getattr(self, name) or 0.0)
        for name in ("margin", "acceleration", "braking", "approach"):
            set_number(self, name, 0.0)
        set_number(self, "return_velocity", 0.0, strict=True)

    def balls(self, robot: Robot) -> list[tuple[str, int, float]]:
        """Name, first tangent coordinate and limit [rad] of each; raises DeclarationError if there is none."""
        wanted = None if self.joints is None else set(robot.joints(self.joints).tolist())
        found = [
            (name, first, most - self.margin)
            for name, (first, most) in robot.spherical.items()
            if math.isfinite(most) and (wanted is None or first in wanted)
        ]
        if not found or min(most for *_, most in found) <= 0.0:
            raise self.invalid("joints", self.joints, "ball joints with a limit, wider than the margin")
        return found

    def rows(self, robot: Robot) -> int:
        """Number of balls; raises DeclarationError, JointNotFound."""
        return len(self.balls(robot))

    def _turned(self, state: State) -> Iterator[tuple[int, float, Vec, float]]:
        """First coordinate, angle [rad], unit vector ``(3,)`` (zero where it has none) and limit of each ball."""
        angles = state.angles
        for _, first, most in self.balls(state.robot):
            r = angles[first : first + 3]
            theta = math.sqrt(float(r @ r))
            yield first, theta, r / theta if theta > STRAIGHT else np.zeros(3), most

    def jacobian(self, state: State) -> Mat:
        """u in the columns of each ball, ``(k, nv)``."""
        J = np.zeros((self.rows(state.robot), state.robot.nv))
        for row, (first, _, u, _) in zip(J, self._turned(state), strict=True):
            row[first : first + 3] = u
        return J

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(k,)`` [rad/s^2]."""
        drift = np.zeros(self.rows(state.robot))
        for i, (first, theta, u, _) in enumerate(self._turned(state)):
            if u.any():
                across = state.v[first : first + 3] - u * float(u @ state.v[first : first + 3])
                drift[i] = 0.5 * float(across @ across) / math.tan(0.5 * theta)
        return drift

    def bounds(self, state: State) -> tuple[float, Vec]:
        """(-inf, theta_max - theta ``(k,)`` [rad])."""
        ways = [most - theta if u.any() else math.inf for _, theta, u, most in self._turned(state)]
        return -math.inf, np.array(ways)

    def step_bounds(self, state: State, dt: float, order: int) -> tuple[Vec, Vec]:
        """Bounds of the rate of each angle, or of the acceleration that J x gives, ``(k,)`` each."""
        robot, (_, ways) = state.robot, self.bounds(state)
        speed = np.array([robot.velocity_limit[f : f + 3].min() for _, f, _ in self.balls(robot)])
        a, b = self._rates(robot)
        J, v = self.jacobian(state), state.v if state.commanded is None else state.commanded
        T, rate = horizon(b, self.approach, dt), J @ v
        upper = fastest(ways, speed, b, self.return_velocity, T)
        if order == 2 and self.approach:
            upper = gradual(ways, upper, rate, speed, b, T, self.approach, dt)
        upper = np.maximum(upper, rate - a * dt)
        upper[np.isinf(ways)] = math.inf
        if order == 2:
            upper = (upper - J @ state.v) / dt - self.drift(state)
        return np.full(ways.size, -math.inf), upper

    def _rates(self, robot: Robot) -> tuple[Vec, Vec]:
        """Acceleration and braking of each ball ``(k,)`` [rad/s^2]: the least of its axes in JointLimits."""
        names = tuple(name for name, *_ in self.balls(robot))
        axes = JointLimits(joints=names, acceleration=self.acceleration, braking=self.braking)
        a, b = (rate.reshape(-1, 3).min(axis=1) for rate in axes.rates(robot))
        return a, b

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The joints."""
        return tuple(name for name, *_ in self.balls(robot))
