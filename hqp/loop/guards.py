"""Guards of a session's states and commands: one thread, references, states by size and age, rates of a command.

hqp/cpp/session/outgoing.hpp has the rules.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from threading import get_ident
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias, TypeVar

import numpy as np

from hqp.arrays import Mask, Vec
from hqp.declare.law import P
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot
from hqp.declare.safety import RateLimits, StateBounds
from hqp.declare.stack import Stack
from hqp.errors import ConcurrentUse, DeclarationError, UnknownReference, closest
from hqp.numbers import number
from hqp.programs.formulation import Formulation

if TYPE_CHECKING:
    from hqp.tasks import JointLimits

T = TypeVar("T")

Turn: TypeAlias = "dict[None, int]"
"""Thread in the session.  ``setdefault`` takes the turn, atomically, in a ``try`` whose end returns it.

It holds the thread's number, so that a thread recognises its own turn if an interrupt kept it from being returned.
"""


def require(turn: Turn, session: object) -> None:
    """Raise ConcurrentUse where another thread has the turn, or this one in a call of the session under way."""
    if turn.get(None, me := get_ident()) != me:
        raise ConcurrentUse(
            "another thread uses this session: make one session per thread, each on its own robot.copy()"
        )
    outside = False
    frame: FrameType | None = sys._getframe(2)
    while frame is not None:
        mine = frame.f_locals.get("self") is session
        if mine and outside:
            raise ConcurrentUse("a call of this session is under way: do not call the session from inside it")
        outside, frame = outside or not mine, frame.f_back


def alone(turn: Turn, session: object, what: Callable[[], T]) -> T:
    """Call a function without another thread in the session, and return its result."""
    me = get_ident()
    if turn:
        require(turn, session)
    try:
        if turn.setdefault(None, me) != me:
            require(turn, session)
        return what()
    finally:
        if turn.get(None) == me:
            turn.clear()


def refuse(reference: object, names: Iterable[str]) -> NoReturn:
    """Raise DeclarationError if it is no Reference, UnknownReference if the stack lacks its element."""
    if not isinstance(reference, Reference):
        raise DeclarationError("step", "not a Reference", value=reference, allowed="element.at(...)")
    near = ", ".join(closest(reference.name, names) or list(names)[:3])
    raise UnknownReference(f"the stack has no element {reference.name!r} for this reference; closest: {near}")


GRADUAL = RateLimits(velocity=10.0, acceleration=500.0, torque=500.0)
"""Rate of a command in a transition and towards an unfinished answer: 0.02 rad/s, 1 rad/s^2 or 1 N m per 2 ms."""


def largest_change(kind: str, dt: float) -> float:
    """Largest change of a motor in a tick by ``GRADUAL`` [rad/s, rad/s^2, N m]."""
    rate: float = getattr(GRADUAL, kind)
    return dt * rate


def largest_changes(robot: Robot, stack: Stack, kind: str, dt: float) -> list[float]:
    """Largest change of each motor in a tick by ``GRADUAL`` and, at velocity level, by the windows of JointLimits."""
    from hqp.tasks import JointLimits

    limits = [e for e in stack.subject_to if kind == "velocity" and isinstance(e, JointLimits)]
    most = np.minimum(largest_change(kind, dt), _windows(robot, limits, dt))
    changes: list[float] = most[robot.actuated].tolist()
    return changes


def _windows(robot: Robot, limits: Sequence[JointLimits], dt: float) -> Vec:
    """Largest change of each speed in a tick by the accelerations of JointLimits ``(nv,)``, infinite without one."""
    most = np.full(robot.nv, math.inf)
    for element in limits:
        k = element.selection(robot)
        most[k] = np.minimum(most[k], dt * element.rates(robot)[0])
    return most


LYING = math.cos(math.radians(60.0))
"""Cosine of the tilt from home above which a robot that stands at home is taken to lie."""

FALLEN = math.cos(math.radians(150.0))
"""Cosine of the tilt from home above which a base is taken to be upside down."""

FAR = 1.0
"""A joint that is outside its limits by more cannot be a sensor's error [rad, m]."""


def doubts(robot: Robot, q: Any) -> tuple[str, ...]:
    """Return sentences on an implausible state ``(nq,)``, with the likely cause; none for a plausible one.

    A base is compared with the home configuration, so a robot whose home lies may lie.
    """
    given = np.asarray(q)
    if given.shape != (robot.nq,) or given.dtype.kind not in "fiu" or not np.isfinite(given).all():
        return ()  # the tick reports it
    return (*_base(robot, given), *_joints(robot, given))


def _base(robot: Robot, q: Vec) -> tuple[str, ...]:
    if not robot.floating:
        return ()
    home = _up(robot.home[3:7])
    tilt, swapped = float(_up(q[3:7]) @ home), float(_up(q[[4, 5, 6, 3]]) @ home)
    if tilt > LYING:
        return ()
    what = "upside down" if tilt < FALLEN else "lying"
    angle = math.degrees(math.acos(max(-1.0, tilt)))
    cause = ", but upright with the quaternion read as w x y z: hqp takes x y z w" if swapped > LYING else ""
    return (f"its base is {what}, {angle:.0f} degrees from home{cause}",)


def _up(xyzw: Vec) -> Vec:
    """The z axis ``(3,)`` of a rotation in its own terms of the world; zero for a quaternion of no length."""
    x, y, z, w = xyzw / max(float(np.linalg.norm(xyzw)), 1e-300)
    return np.array((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)))


def _joints(robot: Robot, q: Vec) -> tuple[str, ...]:
    columns = np.asarray(robot.actuated)
    places = robot.positions(columns)
    if places is None or not columns.size:
        return ()
    at, low, high = q[places], robot.lower[columns], robot.upper[columns]
    off = np.maximum(low - at, at - high)
    if not off.max(initial=0.0) > FAR:
        return ()
    k = int(off.argmax())
    turns = np.radians(at)
    cause = "its joints in another order, or not zero where the model's are"
    if np.abs(at).max() > 2.0 * math.pi and np.all((low - FAR <= turns) & (turns <= high + FAR)):
        cause = "degrees, which hqp takes as rad"
    name = robot.joint_name(int(columns[k]))
    return (f"joint {name!r} at {at[k]:.4g} is far outside its limits {low[k]:.4g} to {high[k]:.4g}: {cause}",)


PERIODS, DRIVE = 3.0, 0.05
"""Delay from a command to the motion of its joint: periods, and the lag of a drive [s] (20 rad/s, 3 Hz)."""


def state_bounds(robot: Robot, bounds: StateBounds, max_age: float | None) -> dict[str, Any]:
    """Bounds of accepted states, ``(nv,)`` each, and their largest age [s].

    ordinary: sum of squares below which every number is within its bounds.
    """
    if max_age is not None:
        max_age = number("session", "max_age", max_age, 0.0, strict=True)
    limited = np.isfinite(robot.lower) & np.isfinite(robot.upper)
    low = np.where(limited, robot.lower - bounds.outside, -bounds.angle)
    high = np.where(limited, robot.upper + bounds.outside, bounds.angle)
    limit = np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 0.0)
    speed = np.maximum(bounds.speed, 10.0 * limit)
    smallest = min((float(np.min(s)) for s in (high, -low, speed) if s.size), default=math.inf)
    return {
        "low": low.tolist(),
        "high": high.tolist(),
        "speed": speed.tolist(),
        "distance": bounds.distance,
        "ordinary": max(0.0, min(smallest, bounds.distance)) ** 2,
        "max_age": max_age,
    }


def motor_limits(robot: Robot, stack: Stack, kind: str, turns: Mask) -> dict[str, Any]:
    """Inverse limits of the model, to which commands are held after the solver, 0 for none.

    The speed of each motor [rad/s, m/s]; at torque level ``OVERLOAD`` times its torque [N m, N], none for motors too
    weak to hold the robot at home (``hqp.torque.motors``).  turns: mask of rotational coordinates ``(nv,)``.
    """
    actuated = robot.actuated
    if kind == "torque":
        from hqp.torque.motors import overload  # an exported plan is followed without it

        limit, units = overload(stack, robot)[0], ("N", "N m")
    else:
        limit, units = robot.velocity_limit[actuated], ("m/s", "rad/s")
    inverse = np.zeros(limit.size)
    np.divide(1.0, limit, out=inverse, where=limit > 0.0)
    return {"inverse": inverse.tolist(), "units": [units[turn] for turn in turns[actuated].tolist()]}


def following(robot: Robot, dt: float, max_age: float, turns: Mask) -> dict[str, Any]:
    """Speed limits of the motors, 0 for none, and the longest delay [s] from a command to its measured motion.

    A state is at most ``max_age`` old, and drives lag (hqp/cpp/session/follow_watch.hpp).
    turns: mask of rotational coordinates ``(nv,)``.
    """
    actuated = robot.actuated
    speed = robot.velocity_limit[actuated]
    return {
        "speed": np.where(np.isfinite(speed), speed, 0.0).tolist(),
        "units": ["rad" if turn else "m" for turn in turns[actuated].tolist()],
        "delay": max_age + PERIODS * dt + DRIVE,
    }


def rate_limits(robot: Robot, limits: RateLimits | None, kind: str, dt: float) -> list[float] | None:
    """Inverse of the largest change of each motor's command in a tick, None without a declared limit.

    Raises DeclarationError for a sequence of another length than the command's.
    """
    limit = None if limits is None else getattr(limits, kind)
    if limit is None:
        return None
    motors = len(robot.joint_names)
    if isinstance(limit, tuple) and len(limit) != motors:
        raise DeclarationError("RateLimits", kind, value=limit, allowed=f"one number, or {motors} on {robot.name}")
    inverse: list[float] = (1.0 / (dt * np.broadcast_to(np.asarray(limit, dtype=np.float64), (motors,)))).tolist()
    return inverse


def jerk_limits(robot: Robot, stack: Stack, formulation: Formulation, kind: str, dt: float) -> dict[str, Any] | None:
    """Limits of the motors by ``JointLimits(jerk=)`` (hqp/cpp/session/jerk_limiter.hpp), None without one.

    rate: the largest gain of the tasks.  Raises DeclarationError above velocity level.
    """
    from hqp.tasks import JointLimits

    found = [element for element in stack if isinstance(element, JointLimits) and element.jerk]
    if not found:
        return None
    if kind != "velocity":
        limit = "RateLimits(acceleration=...) of the controller" if kind == "acceleration" else "none"
        raise found[0].invalid("jerk", found[0].jerk, f"{limit} at {kind} level")
    nv = robot.nv
    inverse, low = np.zeros(nv), np.full(nv, -math.inf)
    high, speed = np.full(nv, math.inf), np.full(nv, math.inf)
    for element in found:
        k = element.selection(robot)
        lower, upper = element.position_limits(robot)
        assert element.jerk
        inverse[k] = np.maximum(inverse[k], 1.0 / element.jerk)
        low[k], high[k] = np.maximum(low[k], lower), np.minimum(high[k], upper)
        speed[k] = np.minimum(speed[k], element.speeds(robot))
    laws = formulation.laws(stack)
    tasks = [laws[element.name] for level in stack.levels for element in level]
    gains = [float(np.max(np.abs(law.gain), initial=0.0)) for law in tasks if isinstance(law, P)]
    motors = robot.actuated
    limits = {"inverse": inverse, "change": _windows(robot, found, dt), "low": low, "high": high, "speed": speed}
    return {
        **{name: one[motors].tolist() for name, one in limits.items()},
        "elements": [element.name for element in found],
        "rate": max(gains, default=0.0),
    }
