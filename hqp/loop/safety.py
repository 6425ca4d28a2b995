"""What a session lets in and out: the size and age of states, the rate of a command, and how it comes to rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.errors import DeclarationError
from hqp.loop.envelope import native
from hqp.robot import Robot, State

if TYPE_CHECKING:
    from hqp._session import RateLimiter

AHEAD = 1e-3
"""By how much the time of a state may lie ahead of the session's [s]: two clocks kept together agree no better."""

RateLimit = float | Sequence[float] | None


@dataclass(frozen=True, kw_only=True)
class StateBounds:
    """Magnitudes beyond which a state is a fault of its source, not a pose of the robot.

    outside [rad or m]: how far a joint may be beyond its position limits.  angle [rad or m]: joints without limits.
    distance [m]: the free base from the origin.  speed [rad/s or m/s]: of joints and base, or ten times a joint's
    speed limit where that is more.  Raises DeclarationError for a number that is not positive and finite.
    """

    outside: float = 2.0 * math.pi
    angle: float = 1e4
    distance: float = 1e4
    speed: float = 1e3

    def __post_init__(self) -> None:
        for name in ("outside", "angle", "distance", "speed"):
            positive("StateBounds", name, getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class RateLimits:
    """Largest change of a command, in normal operation and in every fallback alike; None for no limit.

    velocity [rad/s^2 or m/s^2], acceleration [rad/s^3 or m/s^3], torque [N m/s or N/s]: one number, or one a motor in
    robot.joint_names order, for the formulation of that name.  A command that would change faster goes only as far
    from the last one towards the new one as the slowest motor allows, so that what is linear in both (contacts that
    rest) still holds; a note names the motor, and what of ``subject_to`` is off by it.  The limit stands below
    contact physics: choose it above what contacts need.  Raises DeclarationError for a number that is not positive.
    """

    velocity: RateLimit = None
    acceleration: RateLimit = None
    torque: RateLimit = None

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration", "torque"):
            value = getattr(self, name)
            if value is None or isinstance(value, (int, float)):
                if value is not None:
                    positive("RateLimits", name, value)
                continue
            numbers = tuple(float(x) for x in value)
            for number in numbers:
                positive("RateLimits", name, number)
            object.__setattr__(self, name, numbers)


@dataclass(frozen=True, kw_only=True)
class Braking:
    """How a command comes to rest while no answer is usable (docs/safety.md).

    deceleration [rad/s^2 or m/s^2]: of the fastest joint, at velocity and acceleration level; the others keep their
    proportion to it, so that contacts hold.  damping [s]: time constant of the joint damping beside the holding
    torque.  Raises DeclarationError for a number that is not positive and finite.
    """

    deceleration: float = 50.0
    damping: float = 0.1

    def __post_init__(self) -> None:
        for name in ("deceleration", "damping"):
            positive("Braking", name, getattr(self, name))


def positive(where: str, name: str, value: object) -> None:
    """Raise DeclarationError unless value is a positive finite number."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not 0.0 < value < math.inf:  # type: ignore[operator]
        raise DeclarationError(where, name, value=value, allowed="a positive finite number")


class StateCheck:
    """Says what is wrong with a state; one comparison where q and v are of ordinary size."""

    def __init__(self, robot: Robot, bounds: StateBounds, max_age: float | None) -> None:
        if max_age is not None:
            positive("session", "max_age", max_age)
        self._bounds, self._max_age = bounds, max_age
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
        if self._max_age is not None and (fault := self._age(state, now)):
            return fault
        return "" if state.square < self.ordinary else self.too_large(state)

    @property
    def parts(self) -> dict[str, Any]:
        """The bounds, for a file."""
        bounds = {"low": self._low, "high": self._high, "speed": self._speed, "distance": self._bounds.distance}
        numbers = {name: np.asarray(value).tolist() for name, value in bounds.items()}
        return {**numbers, "ordinary": self.ordinary, "max_age": self._max_age or 0.0, "ahead": AHEAD}

    @property
    def ages(self) -> bool:
        """Whether states must tell their time."""
        return self._max_age is not None

    def _age(self, state: State, now: float | None) -> str:
        if state.time is None:
            return "it does not tell its time, which max_age asks for: robot.state(q, v, time=...)"
        age = (math.nan if now is None else now) - state.time
        if age < -AHEAD:
            return f"its time is {-age:.3g} s ahead of now, allowed {AHEAD:g} s: its clock must be that of the session"
        if not age <= self._max_age:  # type: ignore[operator]
            return f"it is {age:.3g} s old, allowed {self._max_age:g} s"
        return ""

    def too_large(self, state: State) -> str:
        """Which number of a valid state is beyond its bounds; "" for none."""
        found: str = self._native.fault(state.angles, state.q, state.v)
        return found


def rate_limiter(robot: Robot, limits: RateLimits | None, kind: str, dt: float) -> RateLimiter | None:
    """The limiter of a formulation; None where nothing is declared for it.

    Raises DeclarationError for a sequence of another length than the command's.
    """
    limit = None if limits is None else getattr(limits, kind)
    if limit is None:
        return None
    motors = len(robot.joint_names)
    if isinstance(limit, tuple) and len(limit) != motors:
        raise DeclarationError("RateLimits", kind, value=limit, allowed=f"one number, or {motors} on {robot.name}")
    inverse = 1.0 / (dt * np.broadcast_to(np.asarray(limit, dtype=np.float64), (motors,)))
    found: RateLimiter = native.RateLimiter(list(robot.joint_names), inverse.tolist(), dt)
    return found
