"""Bounds on the inputs and outputs of a session, and its braking: bounds that a user declares."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hqp.errors import DeclarationError
from hqp.numbers import number, set_numbers

RateLimit = float | Sequence[float] | None


@dataclass(frozen=True, kw_only=True)
class StateBounds:
    """Magnitudes beyond which a state is a fault of its source, not a pose of the robot.

    outside [rad or m]: allowed distance of a joint beyond its position limits.  angle [rad or m]: joints without
    limits.  distance [m]: the free base from the origin.  speed [rad/s or m/s]: of joints and base, or ten times a
    joint's speed limit if that is more.  Raises DeclarationError for a number that is not positive and finite.
    """

    outside: float = 2.0 * math.pi
    angle: float = 1e4
    distance: float = 1e4
    speed: float = 1e3

    def __post_init__(self) -> None:
        set_numbers(self, "StateBounds", ("outside", "angle", "distance", "speed"), 0.0, strict=True)


@dataclass(frozen=True, kw_only=True)
class RateLimits:
    """Largest change of a command, in normal operation and in every fallback alike; None for no limit.

    velocity [rad/s^2 or m/s^2], acceleration [rad/s^3 or m/s^3], torque [N m/s or N/s]: one number, or one a motor in
    robot.joint_names order, for the formulation of that name.  A command that would change faster moves towards the new
    one only as far as the slowest motor allows, so that linear constraints of both (contacts at rest) still hold; a
    note names the motor and each violated row of ``subject_to``.  The limit stands below contact physics: choose it
    above the needs of contacts.  Raises DeclarationError for a number that is not positive.
    """

    velocity: RateLimit = None
    acceleration: RateLimit = None
    torque: RateLimit = None

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration", "torque"):
            value = getattr(self, name)
            if value is None:
                continue
            if isinstance(value, Iterable):
                given = tuple(number("RateLimits", name, x, 0.0, strict=True) for x in value)
                object.__setattr__(self, name, given)
            else:
                set_numbers(self, "RateLimits", (name,), 0.0, strict=True)


@dataclass(frozen=True, kw_only=True)
class Braking:
    """Way of a command to rest while no solution is usable, and after ``stop`` (docs/safety.md).

    deceleration [rad/s^2 or m/s^2]: deceleration of the fastest joint, at velocity and acceleration level; the others
    keep their proportion to it, so that contacts hold.  damping [s]: time constant in which all joints slow down beside
    the holding torque, at torque level.  resume: "auto" to go on with the next usable answer, "ask" to wait for
    ``resume`` if none was usable for longer than ``after`` [s].  Raises DeclarationError for another word, or a number
    that is not positive and finite.
    """

    deceleration: float = 50.0
    damping: float = 0.1
    resume: str = "auto"
    after: float = 0.5

    def __post_init__(self) -> None:
        set_numbers(self, "Braking", ("deceleration", "damping", "after"), 0.0, strict=True)
        if self.resume not in ("auto", "ask"):
            raise DeclarationError("Braking", "resume", value=self.resume, allowed='"auto" or "ask"')
