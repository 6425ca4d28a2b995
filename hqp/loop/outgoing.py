"""What a session sends: answers, or what goes on in their place, no further from the last one than it may go.

hqp/cpp/session/outgoing.hpp has the rules.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hqp.declare.robot import Robot
from hqp.declare.safety import RateLimits
from hqp.problem import Status
from hqp.programs.envelope import native
from hqp.programs.formulation import Program
from hqp.tolerances import VIOLATION_TOLERANCE

if TYPE_CHECKING:
    from hqp._session import Outgoing

GRADUAL = RateLimits(velocity=10.0, acceleration=500.0, torque=500.0)
"""Of a command in a transition and towards an unfinished answer: 0.02 rad/s, 1 rad/s^2 or 1 N m in a tick of 2 ms."""


def largest_change(kind: str, dt: float) -> float:
    """What ``GRADUAL`` allows of each motor in a tick [rad/s, rad/s^2, N m]."""
    rate: float = getattr(GRADUAL, kind)
    return dt * rate


def outgoing(program: Program, robot: Robot, dt: float) -> Outgoing:
    """What is sent of the answers to a program's hierarchy."""
    problem = program.problem
    parts = [
        (name, place.level, place.part.start, place.part.stop, list(place.element.row_names(robot)))
        for name, place in program.places.items()
        if place.level < problem.constraints
    ]
    motors = program.command(np.arange(problem.n, dtype=np.float64)).astype(int).tolist()
    most, sentences = largest_change(program.kind, dt), [status.value for status in Status]
    found: Outgoing = native.Outgoing(problem, parts, motors, most, VIOLATION_TOLERANCE, sentences)
    return found
