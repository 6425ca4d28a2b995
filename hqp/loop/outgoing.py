"""What a session sends: no further from the last answer than it may go, and the rows that are violated."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from hqp.arrays import Vec
from hqp.declare.robot import Robot
from hqp.declare.safety import RateLimits
from hqp.explanation.notes import Note
from hqp.problem import Solution, Status
from hqp.programs.envelope import native
from hqp.programs.formulation import Program
from hqp.tolerances import VIOLATION_TOLERANCE

if TYPE_CHECKING:
    from hqp._session import RateLimiter

GRADUAL = RateLimits(velocity=10.0, acceleration=500.0, torque=500.0)
"""Of a command in a transition and towards an unfinished answer: 0.02 rad/s, 1 rad/s^2 or 1 N m in a tick of 2 ms."""


def largest_change(kind: str, dt: float) -> float:
    """What ``GRADUAL`` allows of each motor in a tick [rad/s, rad/s^2, N m]."""
    rate: float = getattr(GRADUAL, kind)
    return dt * rate


def within_rates(
    limiter: RateLimiter, x: Vec, last: Vec, notes: tuple[Note, ...], program: Program, robot: Robot, by: str = "rate"
) -> tuple[Vec, tuple[Note, ...]]:
    """x, or the point towards it that the limiter allows, and what of ``subject_to`` is off by that.

    last: the x before.  program: whose rows are those of this tick.  by: what sets the limit, in words.
    """
    command = program.command
    share, why = limiter.share(command(last), command(x))
    if share == 1.0:
        return x, notes
    x = last + share * (x - last)
    limited = (Note(f"{by}s", Status.OPTIMAL, why),)
    return x, notes + limited + violations(program, robot, program.problem.slacks(x), by)


def violations(program: Program, robot: Robot, residuals: tuple[Vec, ...], limit: str = "") -> tuple[Note, ...]:
    """Notes on the members of ``subject_to`` that are off, by the limit of that name, with rows that have names."""
    notes, problem = [], program.problem
    for name, place in program.places.items():
        if place.level < problem.constraints:
            part, rows, names = place.part, problem.levels[place.level], partial(place.element.row_names, robot)
            w, lower, upper = residuals[place.level][part], rows.lower[part], rows.upper[part]
            if why := native.violation(w, lower, upper, VIOLATION_TOLERANCE, limit, names):
                notes.append(Note(name, Status.CONSTRAINTS_VIOLATED, why))
    return tuple(notes)


def culprits(program: Program, robot: Robot, solution: Solution) -> tuple[Note, ...]:
    """Notes on the constraints that are violated, or on the solver where none is."""
    notes = violations(program, robot, solution.residuals)
    if not notes or solution.status is not Status.CONSTRAINTS_VIOLATED:
        notes += (Note("solver", solution.status, solution.detail or solution.status.value),)
    return notes
