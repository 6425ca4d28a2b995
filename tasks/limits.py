"""Limits of joints: one consistent box for the next step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Element, Inequality
from hqp.declare.robot import Robot, State

from .fields import joint_columns, set_names, set_number

ACCELERATION = 50.0
"""Default of the acceleration window [rad/s^2, m/s^2]."""

BRAKING = 5.0
"""Default of the deceleration that the braking curve counts on [rad/s^2, m/s^2]."""

APPROACH = 20.0
"""Default of the rate at which accelerations near the braking curve [1/s]."""

RISE = 0.02
"""The default window lets no joint reach its top speed sooner than this [s]."""

SMOOTH = 3.0
"""Longest braking curve of a jerk limit, in sqrt(v_max / j), half the time in which the jerk stops the top speed."""


@dataclass(frozen=True, kw_only=True)
class JointLimits(Inequality):
    """Position, speed and acceleration limits as one box on the velocity u of the next step, q+ = q + dt u.

    With d the way left to a position limit, v_max the speed limit and b the braking deceleration, towards each limit

        u <= min(v_max, f(d)),    f(d) = b (sqrt(T^2 + 2 d / b) - T),    T = max(dt, 1 / k),

    solution of f^2 / (2 b) + T f = d: after the step the joint can still stop in time at b, step by step, the braking
    curve.  Its last part is d' = -k d: noise of d changes u by k times as much, no more.  From outside, d < 0, it comes
    back at least at min(return_velocity, v_max, f(-d)), bounded and at rest on the limit.  With a, the acceleration
    window, the box is then clipped into [v - a dt, v + a dt]; if the two are disjoint it is the end of the window
    nearest to it, so that the box is never empty; a note names a joint that will pass its position limit by that, and
    by how much.  v is the velocity of the state; at velocity level it is the command that the session sent last, for a
    measured one lags behind.  For accelerations the bounds are those of u = v + dt x, and top speed, braking curve and
    return are approached at the rate k, so that they set in gradually:

        x <= k (v_max - v),    x <= k (f(d) - v) + (1 - k dt) s,    s = -b v / (f(d) + b T), the slope of the curve.

    Above the curve a joint is back on it in a tick, so that noise of v at a limit changes x by 1 / dt times as much;
    off it by no more than ``noise`` it comes back at the same rates: 2 k times as much.

    At torque level contacts and couplings remove a part of v by themselves, regardless of the motors: J v minus the
    velocity of their references, J v - r, by their laws' damping kd.  No joint has to brake that, and none of a leg
    that carries weight could: with k the approach

        x <= bound(v - w) - a,    w = Jbar min(1, kd / k) (J v - r),    a = Jbar kd min(1, kd / k) (J v - r),

    Jbar = A^-1 J^T (J A^-1 J^T)^+, as an inelastic impact takes it; nothing of it for kd = 0.

    With jerk, j, the command follows the solver's answer at velocity level and its acceleration changes by at most
    j dt a tick, for all motors in proportion (hqp/cpp/session/jerk_limiter.hpp).  Then a bounds the command, not the
    answer; T is at least 3 sqrt(v_max / j), and b at most a / 2 and v_max / T.  Position and speed limits and the
    inequalities of ``subject_to`` win over jerk, with a note.  Equalities follow with a lag, so that feet may drift.
    A stop and a command without a usable answer brake without this limit.

    The limit of a ball joint is a cone, one more row: a session adds ``BallLimits`` to a stack with JointLimits.

    joints: joints or groups, all by default.  margin [rad or m] is kept to both position limits.  speed [rad/s or m/s]:
    v_max, at most that of the robot, which 0 or None leave as it is.  acceleration [rad/s^2
    or m/s^2]: a.  The default of 50 is lowered for each joint to the value that the robot's data allow: effort limit /
    inertia about the joint at home, and v_max / 20 ms; another number is taken as it is.  braking [rad/s^2 or m/s^2]:
    b, at most a (a joint brakes inside its window).  0 or None switches either off: without both f(d) = d / dt.
    approach [1/s]: k, 0 or None for at once, T = dt.  return_velocity, noise [rad/s or m/s].  jerk [rad/s^3 or
    m/s^3]: j, 0 or None for none.  Raises DeclarationError for fields, for a margin that leaves no room, and for a jerk
    above velocity level or of a joint with neither speed limit nor a; JointNotFound on binding.
    """

    joints: str | Sequence[str] | None = None
    margin: float = 0.0
    speed: float | None = None
    acceleration: float | None = ACCELERATION
    braking: float | None = BRAKING
    approach: float | None = APPROACH
    return_velocity: float = 0.5
    noise: float = 0.0
    jerk: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")
        set_number(self, "margin", 0.0)
        set_number(self, "noise", 0.0)
        set_number(self, "return_velocity", 0.0, strict=True)
        for name in ("speed", "acceleration", "braking", "approach", "jerk"):
            value = getattr(self, name)
            object.__setattr__(self, name, 0.0 if value is None else value)  # files cannot express None
            set_number(self, name, 0.0)

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
            with np.errstate(over="ignore"):  # a joint that carries next to nothing
                a = np.minimum(a, robot.effort_limit[picked] / home_inertia(robot)[picked])
        return a, np.minimum(a, self.braking or math.inf)

    def speeds(self, robot: Robot) -> Vec:
        """v_max: speed limit of each joint, ``(k,)`` [rad/s or m/s]."""
        return np.minimum(robot.velocity_limit[self.selection(robot)], self.speed or math.inf)

    def answer_rates(self, robot: Robot) -> tuple[Vec, Vec, float]:
        """(a, b, k) of the solver's answer: with a jerk limit a is infinite, b and k are lower."""
        (a, b), approach = self.rates(robot), self.approach or 0.0
        if not self.jerk:
            return a, b, approach
        picked = self.selection(robot)
        speed = self.speeds(robot)
        speed = np.where(np.isfinite(speed), speed, a * a / self.jerk)
        if not np.all(np.isfinite(speed)):
            name = robot.joint_name(int(picked[np.argmax(~np.isfinite(speed))]))
            allowed = f"a finite number, for {name} of {robot.name} has no speed limit and jerk needs one of the two"
            raise self.invalid("acceleration", self.acceleration, allowed)
        longest = SMOOTH * math.sqrt(float(speed.max(initial=0.0)) / self.jerk)
        if longest > 0.0:
            approach = min(approach or math.inf, 1.0 / longest)
            b = np.minimum(np.minimum(b, a / 2.0), speed / longest)
        return np.full(a.size, math.inf), b, approach

    def position_limits(self, robot: Robot) -> tuple[Vec, Vec]:
        """Position limits within the margin, ``(k,)``; raises DeclarationError where it leaves no room."""
        picked = self.selection(robot)
        low, high = robot.lower[picked] + self.margin, robot.upper[picked] - self.margin
        if np.any(low > high):
            raise self.invalid(
                "margin", self.margin, f"at most {np.min(high - low) / 2 + self.margin:g} on {robot.name}"
            )
        return low, high

    def jacobian(self, state: State) -> Mat:
        """A row of the identity for each joint, ``(k, nv)``."""
        return np.eye(state.robot.nv)[self.selection(state.robot)]

    def bounds(self, state: State) -> tuple[Vec, Vec]:
        """Ways left to the position limits, ``(k,)`` each [rad or m]."""
        (low, high), q = self.position_limits(state.robot), state.angles[self.selection(state.robot)]
        return low - q, high - q

    def step_bounds(self, state: State, dt: float, order: int) -> tuple[Vec, Vec]:
        """The box: bounds of the joints' velocity or acceleration, ``(k,)`` each."""
        return self.bounds_around(state, state.v if state.commanded is None else state.commanded, dt, order)

    def bounds_around(self, state: State, v: Vec, dt: float, order: int) -> tuple[Vec, Vec]:
        """The box at a velocity v ``(nv,)``: bounds ``(k,)`` each."""
        picked, back = self.selection(state.robot), self.return_velocity
        speed, v = self.speeds(state.robot), v[picked]
        (down, up), (a, b, approach) = self.bounds(state), self.answer_rates(state.robot)
        T = horizon(b, approach, dt)
        highest, lowest = fastest(up, speed, b, back, T), -fastest(-down, speed, b, back, T)
        upper, lower = highest, lowest
        if order == 2 and approach:
            upper = gradual(up, highest, v, speed, b, T, approach, dt, self.noise)
            lower = -gradual(-down, -lowest, -v, speed, b, T, approach, dt, self.noise)
            upper = np.maximum(upper, np.minimum(highest, lower))  # a gradual bound gives way where the two would cross
            lower = np.minimum(lower, np.maximum(lowest, upper))
        upper, lower = np.clip(upper, v - a * dt, v + a * dt), np.clip(lower, v - a * dt, v + a * dt)
        return (lower, upper) if order == 1 else ((lower - v) / dt, (upper - v) / dt)

    def bound_kinds(self, state: State, v: Vec, dt: float) -> tuple[tuple[str, str], ...]:
        """For each joint (lower, upper): ``acceleration`` at an end of the window, ``speed``, ``""`` for position."""
        picked = self.selection(state.robot)
        v, speed = v[picked], self.speeds(state.robot)
        (down, up), (a, b, approach) = self.bounds(state), self.answer_rates(state.robot)
        T = horizon(b, approach, dt)
        sides = []
        for way, rate in ((-down, -v), (up, v)):
            most = fastest(way, speed, b, self.return_velocity, T)
            kind = np.where(most >= speed, "speed", "")
            sides.append(np.where(np.abs(most - rate) >= a * dt, "acceleration", kind).tolist())
        return tuple(zip(*sides, strict=True))

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The joints."""
        return tuple(robot.joint_name(int(c)) for c in self.selection(robot))

    def companions(self, robot: Robot) -> tuple[Element, ...]:
        """The cones of the balls among the joints."""
        from .ball_limits import BallLimits

        own = set(self.selection(robot).tolist())
        balls = tuple(n for n, (first, most) in robot.spherical.items() if first in own and math.isfinite(most))
        if not balls:
            return ()
        rates = {"acceleration": self.acceleration, "braking": self.braking, "return_velocity": self.return_velocity}
        return (BallLimits(joints=balls, margin=self.margin, approach=self.approach, **rates),)  # type: ignore[arg-type]

    def plan(self, robot: Robot) -> plans.JointBox | None:
        """The native operation, none for joints of several axes with position limits; raises DeclarationError for too
        wide a margin."""
        picked, (lower, upper) = self.selection(robot), self.position_limits(robot)
        joints = plans.Joints.of(robot, picked, needed=np.isfinite(lower) | np.isfinite(upper))
        if joints is None:
            return None
        *rates, approach = self.answer_rates(robot)
        bounds = (lower, upper, self.speeds(robot), *rates)
        low, high, speed, a, b = (tuple(x.tolist()) for x in bounds)
        return plans.JointBox(joints, low, high, speed, a, b, approach or math.inf, self.return_velocity, self.noise)


_INERTIA: WeakKeyDictionary[Robot, Vec] = WeakKeyDictionary()


def home_inertia(robot: Robot) -> Vec:
    """Diagonal of the joint-space inertia at home, ``(nv,)`` [kg m^2, kg], found once a robot."""
    if robot not in _INERTIA:
        twin = robot.copy()
        _INERTIA[robot] = np.maximum(np.diag(twin.state(twin.home).mass_matrix()), np.finfo(float).tiny)
    return _INERTIA[robot]


def horizon(b: Vec, approach: float | None, dt: float) -> Vec:
    """T of the braking curve, ``(k,)`` [s]."""
    return np.where(np.isfinite(b), max(dt, 1.0 / approach), dt) if approach else np.full(b.size, dt)


def braking_curve(way: Vec, b: Vec, T: Vec) -> Vec:
    """f(|d|), ``(k,)``: b (sqrt(T^2 + 2 d / b) - T) without the cancellation; d / T where b is infinite."""
    off = np.abs(way)
    with np.errstate(invalid="ignore"):  # no limit is infinitely far
        return np.where(off < math.inf, 2.0 * off / (np.sqrt(T * T + 2.0 * off / b) + T), math.inf)


def fastest(way: Vec, speed: Vec, b: Vec, back: float, T: Vec) -> Vec:
    """Largest velocity ``(k,)`` towards a limit that is ``way`` off; from outside the one that leads back."""
    most = np.minimum(braking_curve(way, b, T), speed)
    return np.where(way >= 0.0, most, -np.minimum(most, back))


def gradual(
    way: Vec, most: Vec, v: Vec, speed: Vec, b: Vec, T: Vec, approach: float, dt: float, noise: float = 0.0
) -> Vec:
    """Largest velocity ``(k,)`` of the next step from v that nears top speed, curve or return gradually."""
    f, share = np.where(most > 0.0, braking_curve(way, b, T), most), min(1.0, approach * dt)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(v > 0.0, -v / (np.maximum(f, 0.0) / b + T), 0.0)
        near = v + dt * slope + share * (f - v - dt * slope)
    inside = np.minimum(np.minimum(most + noise, near), v + share * (speed - v))
    outside = np.maximum(most - noise, np.minimum(near, share * most + noise))
    return np.where(np.isfinite(b), np.where(most > 0.0, inside, outside), most)
