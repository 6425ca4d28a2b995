"""What a session lets in and out: the size and age of states, the rate of a command."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.declare.robot import Robot
from hqp.declare.safety import RateLimits, StateBounds, positive
from hqp.errors import DeclarationError
from hqp.programs.envelope import native

if TYPE_CHECKING:
    from hqp._session import RateLimiter


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
