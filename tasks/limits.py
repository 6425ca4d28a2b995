"""Limits of joints and motors: one consistent box for the next step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hqp.arrays import Index, Vec
from hqp.element import Block, Constraint, Quantity, Writer
from hqp.reference import Reference
from hqp.robot import Robot, State

from .fields import check_number, joint_columns, set_names


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
        box = _Box(low, high, robot.velocity_limit[picked], self, out.dt)
        lower, upper, second, rate = out.lower, out.upper, out.order == 2, 1.0 / out.dt
        windowed = self.acceleration is not None
        angles, v = np.zeros(picked.size), np.zeros(picked.size)

        def write(state: State, reference: Reference) -> None:
            state.angles.take(picked, out=angles, mode="clip")
            if windowed or second:
                state.v.take(picked, out=v, mode="clip")
            box.fill(angles, v, lower, upper)
            if second:
                np.subtract(lower, v, out=lower)
                np.multiply(lower, rate, out=lower)
                np.subtract(upper, v, out=upper)
                np.multiply(upper, rate, out=upper)

        return write


class _Box:
    """The box on u, both sides of all joints in one array: towards the upper limits first, then the lower ones."""

    def __init__(self, low: Vec, high: Vec, speed: Vec, limits: JointLimits, dt: float) -> None:
        self._k, self._dt, self._rate = low.size, dt, 1.0 / dt
        self._limit = np.concatenate((high, -low))
        self._speed = np.concatenate((speed, speed))
        self._back = np.maximum(-self._speed, -limits.return_velocity)
        self._a = limits.acceleration
        self._way, self._beyond = np.zeros(2 * low.size), np.zeros(2 * low.size)
        self._upper_way, self._lower_way = self._way[: low.size], self._way[low.size :]
        self._upper_limit, self._lower_limit = self._limit[: low.size], self._limit[low.size :]
        self._reach = np.zeros(low.size)

    def fill(self, q: Vec, v: Vec, lower: Vec, upper: Vec) -> None:
        """Write the bounds on u of joints at q moving at v."""
        way, a = self._way, self._a
        np.subtract(self._upper_limit, q, out=self._upper_way)
        np.add(self._lower_limit, q, out=self._lower_way)
        if a is None:
            np.multiply(way, self._rate, out=way)
            np.maximum(way, self._back, out=way)
        else:
            beyond = self._beyond
            np.minimum(way, 0.0, out=beyond)
            np.subtract(way, beyond, out=way)
            np.multiply(way, 2.0 / a, out=way)
            np.add(way, self._dt**2, out=way)
            np.sqrt(way, out=way)
            np.subtract(way, self._dt, out=way)
            np.multiply(way, a, out=way)
            np.multiply(beyond, self._rate, out=beyond)
            np.maximum(beyond, self._back, out=beyond)
            np.add(way, beyond, out=way)
        np.minimum(way, self._speed, out=way)
        np.negative(self._lower_way, out=lower)
        if a is None:
            np.copyto(upper, self._upper_way)
            return
        reach = self._reach
        np.subtract(v, a * self._dt, out=reach)
        np.maximum(lower, reach, out=lower)
        np.maximum(self._upper_way, reach, out=upper)
        np.add(v, a * self._dt, out=reach)
        np.minimum(lower, reach, out=lower)
        np.minimum(upper, reach, out=upper)


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
        motors = robot.actuated.tolist()
        if self.joints is None:
            return np.arange(len(motors), dtype=np.intp)
        columns = joint_columns(self, robot, self.joints).tolist()
        if not set(columns) <= set(motors):
            raise self.bad("joints", self.joints, f"joints with a motor: {', '.join(robot.joint_names)}")
        return np.array([motors.index(column) for column in columns], dtype=np.intp)

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
