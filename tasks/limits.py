"""Limits of joints and motors: one consistent box for the next step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar
from weakref import WeakKeyDictionary

import numpy as np

from hqp.arrays import Index, Vec
from hqp.element import Block, Constraint, Plan, Quantity, Writer
from hqp.reference import Reference
from hqp.robot import Robot, State

from .fields import check_number, joint_columns, motor_positions, set_names

ACCELERATION = 50.0
"""Default of the acceleration window [rad/s^2, m/s^2]."""

BRAKING = 5.0
"""Default of the deceleration that the braking curve counts on [rad/s^2, m/s^2]."""

RISE = 0.02
"""The default window lets no joint reach its top speed sooner than this [s]."""


@dataclass(frozen=True, kw_only=True)
class JointLimits(Constraint):
    """Position, speed and acceleration limits as one box on the velocity u of the next step, q+ = q + dt u.

    With d the way left to a position limit, v_max the speed limit and b the braking deceleration, towards each limit

        u <= min(v_max, f(d)),    u^2 / (2 b) + dt u <= d  at u = f(d) = b (sqrt(dt^2 + 2 d / b) - dt),

    so that after the step the joint can still stop in time at b, step by step: the braking curve.  From outside,
    d < 0, it comes back at least at min(return_velocity, v_max, f(-d)), bounded and at rest on the limit.  With a,
    the acceleration window, the box is then clipped into [v - a dt, v + a dt]; where the two do not meet it is the
    end of the window nearest to it, so that the box is never empty.  v is the velocity of the state: at velocity
    level the one commanded last, as ``tick.advance()`` returns it.  Where x is an acceleration the bounds are those
    of u = v + dt x.

    joints: joints or groups, all single-axis joints by default.  margin [rad or m] is kept to both position limits.
    acceleration [rad/s^2 or m/s^2]: a.  The default of 50 is lowered, joint by joint, to what the robot's data
    allow: effort limit / inertia about the joint at home, and v_max / 20 ms; another number is taken as it is.
    braking [rad/s^2 or m/s^2]: b, at most a (a joint brakes inside its window).  0 or None switches either off:
    without both f(d) = d / dt.  return_velocity [rad/s or m/s].
    Raises DeclarationError for fields and for a margin that leaves no room, JointNotFound on binding.
    """

    equality: ClassVar[bool] = False

    joints: str | Sequence[str] | None = None
    margin: float = 0.0
    acceleration: float | None = ACCELERATION
    braking: float | None = BRAKING
    return_velocity: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")
        check_number(self, "margin", self.margin, 0.0)
        check_number(self, "return_velocity", self.return_velocity, 0.0, strict=True)
        for name in ("acceleration", "braking"):
            value = getattr(self, name)
            object.__setattr__(self, name, 0.0 if value is None else value)  # files cannot say None
            check_number(self, name, getattr(self, name), 0.0)

    def rows(self, robot: Robot) -> int:
        """Number of joints k; raises JointNotFound."""
        return self.selection(robot).size

    def selection(self, robot: Robot) -> Index:
        """Tangent coordinates of the joints ``(k,)``; raises JointNotFound."""
        return joint_columns(self, robot, self.joints)

    def rates(self, robot: Robot) -> tuple[Vec, Vec]:
        """(a, b): window and braking deceleration of each joint, ``(k,)`` [rad/s^2 or m/s^2], infinite where off."""
        picked = self.selection(robot)
        a = np.full(picked.size, self.acceleration or math.inf)
        if self.acceleration == ACCELERATION:
            a = np.minimum(a, robot.velocity_limit[picked] / RISE)
            a = np.minimum(a, robot.effort_limit[picked] / home_inertia(robot)[picked])
        return a, np.minimum(a, self.braking or math.inf)

    def bind(self, robot: Robot, out: Block) -> Writer:
        """Write J once, and lower and upper each tick."""
        picked = self.selection(robot)
        out.J[:] = np.eye(robot.nv)[picked]
        low, high = robot.lower[picked] + self.margin, robot.upper[picked] - self.margin
        if np.any(low > high):
            raise self.bad("margin", self.margin, f"at most {np.min(high - low) / 2 + self.margin:g} on {robot.name}")
        speed, positions = robot.velocity_limit[picked], robot.positions(picked)
        a, b = self.rates(robot)
        if positions is not None:
            data = {
                "positions": positions,
                "columns": picked.tolist(),
                "low": low.tolist(),
                "high": high.tolist(),
                "speed": speed.tolist(),
                "acceleration": a.tolist(),
                "braking": b.tolist(),
                "return_velocity": self.return_velocity,
                "dt": out.dt,
                "order": out.order,
            }
            out.plan = Plan("box", data)
        dt, order, back = out.dt, out.order, self.return_velocity

        def write(state: State, reference: Reference) -> None:
            q, v = state.angles[picked], state.v[picked]
            upper = np.clip(fastest(high - q, speed, b, back, dt), v - a * dt, v + a * dt)
            lower = np.clip(-fastest(q - low, speed, b, back, dt), v - a * dt, v + a * dt)
            out.lower[:], out.upper[:] = (lower, upper) if order == 1 else ((lower - v) / dt, (upper - v) / dt)

        return write


_INERTIA: WeakKeyDictionary[Robot, Vec] = WeakKeyDictionary()


def home_inertia(robot: Robot) -> Vec:
    """Diagonal of the joint-space inertia at home, ``(nv,)`` [kg m^2, kg], found once a robot."""
    if robot not in _INERTIA:
        twin = robot.copy()
        _INERTIA[robot] = np.maximum(np.diag(twin.state(twin.home).mass_matrix()), np.finfo(float).tiny)
    return _INERTIA[robot]


def fastest(way: Vec, speed: Vec, b: Vec, back: float, dt: float) -> Vec:
    """Largest velocity ``(k,)`` towards a limit that is ``way`` off; from outside the one that leads back."""
    off = np.abs(way)
    with np.errstate(invalid="ignore"):  # no limit is infinitely far
        # b (sqrt(dt^2 + 2 d / b) - dt) without the cancellation; d / dt where b is infinite
        curve = np.where(off < math.inf, 2.0 * off / (np.sqrt(dt * dt + 2.0 * off / b) + dt), math.inf)
    most = np.minimum(curve, speed)
    return np.where(way >= 0.0, most, -np.minimum(most, back))


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
