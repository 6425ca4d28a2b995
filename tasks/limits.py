"""Limits of joints and motors: one consistent box for the next step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hqp.arrays import Index, Vec
from hqp.element import Block, Constraint, Plan, Quantity, Writer
from hqp.reference import Reference
from hqp.robot import Robot, State

from .fields import check_number, joint_columns, motor_positions, set_names


@dataclass(frozen=True, kw_only=True)
class JointLimits(Constraint):
    """Position, velocity and acceleration limits as one box on the velocity u of the next step, q+ = q + dt u.

    With d the way left to a position limit, v_max the speed limit and a the acceleration limit, towards each limit

        u <= v_max,    u <= d / dt  or, with a,  u^2 / (2 a) + dt u <= d:   u <= a (sqrt(dt^2 + 2 d / a) - dt),

    the second so that the joint can always stop in time; d < 0 asks for u <= max(d / dt, -return_velocity): from
    outside a joint comes back at bounded speed.  With a, the box is clipped into [v - a dt, v + a dt]; where the
    two do not meet, it is the end of that window nearest to it, so that the box is never empty.  Where x is an
    acceleration the bounds are those of u = v + dt x.

    joints: joints or groups, all single-axis joints by default.  margin [rad or m] is kept to both position limits.
    acceleration [rad/s^2 or m/s^2]: None for no limit.  return_velocity [rad/s or m/s].
    Raises DeclarationError for fields and for a margin that leaves no room, JointNotFound on binding.
    """

    equality: ClassVar[bool] = False

    joints: str | Sequence[str] | None = None
    margin: float = 0.0
    acceleration: float | None = None
    return_velocity: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")
        check_number(self, "margin", self.margin, 0.0)
        check_number(self, "return_velocity", self.return_velocity, 0.0, strict=True)
        if self.acceleration is not None:
            check_number(self, "acceleration", self.acceleration, 0.0, strict=True)

    def rows(self, robot: Robot) -> int:
        """Number of joints k; raises JointNotFound."""
        return self.selection(robot).size

    def selection(self, robot: Robot) -> Index:
        """Tangent coordinates of the joints ``(k,)``; raises JointNotFound."""
        return joint_columns(self, robot, self.joints)

    def bind(self, robot: Robot, out: Block) -> Writer:
        """Write J once, and lower and upper each tick."""
        picked = self.selection(robot)
        out.J[:] = np.eye(robot.nv)[picked]
        low, high = robot.lower[picked] + self.margin, robot.upper[picked] - self.margin
        if np.any(low > high):
            raise self.bad("margin", self.margin, f"at most {np.min(high - low) / 2 + self.margin:g} on {robot.name}")
        speed, positions = robot.velocity_limit[picked], robot.positions(picked)
        if positions is not None:
            data = {
                "positions": positions,
                "columns": picked.tolist(),
                "low": low.tolist(),
                "high": high.tolist(),
                "speed": speed.tolist(),
                "acceleration": math.inf if self.acceleration is None else self.acceleration,
                "return_velocity": self.return_velocity,
                "dt": out.dt,
                "order": out.order,
            }
            out.plan = Plan("box", data)
        return _Box(picked, low, high, speed, self, out)


class _Box:
    """The writer: bounds on the way towards the upper limits, then on that towards the lower ones, ``(2 k,)``.

    Constants are whole arrays: NumPy takes longer to convert a number than to work through so few joints.
    """

    def __init__(self, picked: Index, low: Vec, high: Vec, speed: Vec, limits: JointLimits, out: Block) -> None:
        k, dt = picked.size, out.dt
        self._picked = np.concatenate((picked, picked))
        self._sign = np.repeat((1.0, -1.0), k)
        self._limit, self._speed = np.concatenate((high, -low)), np.concatenate((speed, speed))
        self._back = np.maximum(-self._speed, -limits.return_velocity)
        self._rate = np.full(2 * k, 1.0 / dt)
        self._way, self._v, self._bound = np.zeros(2 * k), np.zeros(2 * k), np.zeros(2 * k)
        self._windowed, self._second = limits.acceleration is not None, out.order == 2
        a = limits.acceleration or 0.0
        self._step, self._square, self._double = (np.full(2 * k, c) for c in (a * dt, (a * dt) ** 2, 2.0 * a))
        self._towards_upper, self._towards_lower = self._bound[:k], self._bound[k:]
        self._lower, self._upper = out.lower, out.upper

    def __call__(self, state: State, reference: Reference) -> None:
        """Write lower and upper for joints at q moving at v."""
        way, v, bound = self._way, self._v, self._bound
        state.angles.take(self._picked, out=way, mode="clip")
        np.multiply(way, self._sign, out=way)
        np.subtract(self._limit, way, out=way)
        np.multiply(way, self._rate, out=bound)
        np.maximum(bound, self._back, out=bound)
        np.minimum(bound, self._speed, out=bound)
        if self._windowed or self._second:
            state.v.take(self._picked, out=v, mode="clip")
            np.multiply(v, self._sign, out=v)
        if self._windowed:
            # a (sqrt(dt^2 + 2 d / a) - dt), nowhere above d / dt, and zero outside
            np.multiply(way, self._double, out=way)
            np.add(way, self._square, out=way)
            np.maximum(way, self._square, out=way)
            np.sqrt(way, out=way)
            np.subtract(way, self._step, out=way)
            np.minimum(bound, way, out=bound)
            np.subtract(v, self._step, out=way)
            np.maximum(bound, way, out=bound)
            np.add(v, self._step, out=way)
            np.minimum(bound, way, out=bound)
        if self._second:
            np.subtract(bound, v, out=bound)
            np.multiply(bound, self._rate, out=bound)
        self._upper[:] = self._towards_upper
        np.negative(self._towards_lower, out=self._lower)


@dataclass(frozen=True, kw_only=True)
class TorqueLimits(Constraint):
    """Motor limits: -scale tau_max <= tau <= scale tau_max, rows that each pick one of the actuated efforts.

    joints: actuated joints or groups of them, all by default.  scale: fraction of the robot's limits that may be
    used.  Raises DeclarationError for fields and for a joint without a motor, JointNotFound on binding.
    """

    quantity: ClassVar[Quantity] = "effort"
    equality: ClassVar[bool] = False

    joints: str | Sequence[str] | None = None
    scale: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")
        check_number(self, "scale", self.scale, 0.0, strict=True)

    def rows(self, robot: Robot) -> int:
        """Number of motors k; raises JointNotFound."""
        return self.selection(robot).size

    def selection(self, robot: Robot) -> Index:
        """Positions of the motors among ``robot.actuated``, ``(k,)``; raises JointNotFound, DeclarationError."""
        return motor_positions(self, robot, self.joints)

    def bind(self, robot: Robot, out: Block) -> Writer:
        """Write J, lower and upper once, on x = tau."""
        picked = self.selection(robot)
        out.J[:] = np.eye(robot.actuated.size)[picked]
        limit = self.scale * robot.effort_limit[robot.actuated][picked]
        lower, upper = out.lower, out.upper

        def write(state: State, reference: Reference) -> None:
            np.negative(limit, out=lower)
            np.copyto(upper, limit)

        return write
