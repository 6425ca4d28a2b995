"""Commands of a session: answers or their replacements, within a distance of the last command.

hqp/cpp/session/outgoing.hpp has the rules.
"""

from __future__ import annotations

from hqp.declare.safety import RateLimits

GRADUAL = RateLimits(velocity=10.0, acceleration=500.0, torque=500.0)
"""Rate of a command in a transition and towards an unfinished answer: 0.02 rad/s, 1 rad/s^2 or 1 N m per 2 ms."""


def largest_change(kind: str, dt: float) -> float:
    """Largest change of each motor in a tick by ``GRADUAL`` [rad/s, rad/s^2, N m]."""
    rate: float = getattr(GRADUAL, kind)
    return dt * rate
