"""What a session lets in and out: the size and age of states, the rate of a command."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.declare.robot import Robot, State
from hqp.declare.safety import RateLimits, StateBounds, positive
from hqp.errors import DeclarationError
from hqp.programs.envelope import native

if TYPE_CHECKING:
    from hqp._session import RateLimiter


class StateCheck:
    """Says what is wrong with a state; one comparison where q and v are of ordinary size."""

    def __init__(self, robot: Robot, bounds: StateBounds, max_age: float | None) -> None:
        if max_age is not None:
            positive("session", "max_age", max_age)
        self._bounds, self._max_age = bounds, max_age
        self._age = None if max_age is None else native.StateAge(max_age)
        self.ages = max_age is not None
        """Whether states must tell their time."""
        limited = np.isfinite(robot.lower) & np.isfinite(robot.upper)
        self._low = np.where(limited, robot.lower - bounds.outside, -bounds.angle)
        self._high = np.where(limited, robot.upper + bounds.outside, bounds.angle)
        limit = np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 0.0)
        self._speed = np.maximum(bounds.speed, 10.0 * limit)
        names = [robot.joint_name(i) for i in range(robot.nv)]
        sizes = (x.tolist() for x in (self._low, self._high, self._speed))
        self._native = native.StateBounds(*sizes, bounds.distance, robot.floating, names)
        smallest = min((float(np.min(s)) for s in (self._high, -self._low, self._speed) if s.size), default=math.inf)
        self.ordinary = max(0.0, min(smallest, bounds.distance)) ** 2
        """A valid state that tells no time and whose ``square`` is less has nothing wrong with it."""

    def fault(self, state: State, now: float | None) -> str:
        """What is wrong with the state at time ``now`` [s]; "" where nothing is."""
        if not state.valid:
            return state.fault
        if self._age is not None and (fault := self._age.fault(state.time, math.nan if now is None else now)):
            return f"{fault}: robot.state(q, v, time=...)" if state.time is None else fault
        return "" if state.square < self.ordinary else self.too_large(state)

    @property
    def parts(self) -> dict[str, Any]:
        """The bounds, for a file."""
        bounds = {"low": self._low, "high": self._high, "speed": self._speed, "distance": self._bounds.distance}
        numbers = {name: np.asarray(value).tolist() for name, value in bounds.items()}
        return {**numbers, "ordinary": self.ordinary, "max_age": self._max_age}

    def too_large(self, state: State) -> str:
        """Which number of a valid state is beyond its bounds; "" for none."""
        found: str = self._native.fault(state.angles, state.q, state.v)
        return found


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
