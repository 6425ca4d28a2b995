"""Guards of a session's inputs and outputs: size and age of states, rate of a command."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Mask
from hqp.declare.robot import Robot
from hqp.declare.safety import RateLimits, StateBounds, positive
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError
from hqp.programs.envelope import native

if TYPE_CHECKING:
    from hqp._session import RateLimiter


PERIODS, DRIVE = 3.0, 0.05
"""A command shows in the motion of its joint after so many periods and the lag of a drive [s] (20 rad/s, 3 Hz)."""


def state_bounds(robot: Robot, bounds: StateBounds, max_age: float | None) -> dict[str, Any]:
    """Numbers beyond which a state is refused, ``(nv,)`` each, and how old it may be [s].

    ordinary: a valid state whose squares sum up to less has nothing wrong with it.
    """
    if max_age is not None:
        positive("session", "max_age", max_age)
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
    """Limits of the model that every command is checked against after the solver, one over each, 0 for none.

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


def rate_limiter(
    robot: Robot, limits: RateLimits | None, kind: str, dt: float, name: str = "rate"
) -> RateLimiter | None:
    """The limiter of a formulation, by the name that notes have for it; None where nothing is declared for it.

    Raises DeclarationError for a sequence of another length than the command's.
    """
    limit = None if limits is None else getattr(limits, kind)
    if limit is None:
        return None
    motors = len(robot.joint_names)
    if isinstance(limit, tuple) and len(limit) != motors:
        raise DeclarationError("RateLimits", kind, value=limit, allowed=f"one number, or {motors} on {robot.name}")
    inverse = 1.0 / (dt * np.broadcast_to(np.asarray(limit, dtype=np.float64), (motors,)))
    found: RateLimiter = native.RateLimiter(list(robot.joint_names), inverse.tolist(), dt, name)
    return found
