"""What a session sends: no further from the last answer than it may go, and the rows that are violated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Vec
from hqp.declare.robot import Robot
from hqp.declare.safety import RateLimits
from hqp.explanation.notes import Note
from hqp.problem import Solution, Status
from hqp.programs.formulation import Program
from hqp.tolerances import VIOLATION_TOLERANCE

if TYPE_CHECKING:
    from hqp._session import RateLimiter

GRADUAL = RateLimits(velocity=10.0, acceleration=500.0, torque=500.0)
"""Of a command in a transition and towards an unfinished answer: 0.02 rad/s, 1 rad/s^2 or 1 N m in a tick of 2 ms."""

NAMED = 3
"""Of so many rows that are off a note says the names."""


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
    return x, notes + limited + violations(program, robot, program.problem.slacks(x), f" by the {by} limit")


def violations(program: Program, robot: Robot, residuals: tuple[Vec, ...], why: str = "") -> tuple[Note, ...]:
    """Notes on the members of ``subject_to`` that are off, with the rows that have names, the worst first."""
    notes, problem = [], program.problem
    sizes = [np.abs(w) for w in residuals[: problem.constraints]]
    off = [
        w > VIOLATION_TOLERANCE * (1.0 + np.minimum(np.abs(rows.lower), np.abs(rows.upper)))
        for rows, w in zip(problem.levels, sizes, strict=False)
    ]
    any_off = [bool(found.any()) for found in off]
    for name, place in program.places.items():
        k = place.level
        if k < problem.constraints and any_off[k] and off[k][place.part].any():
            size, out = sizes[k][place.part], off[k][place.part]
            rows = _worst(place.element.row_names(robot), size * out)
            notes.append(Note(name, Status.CONSTRAINTS_VIOLATED, f"off by up to {size.max():.3g}{why}{rows}"))
    return tuple(notes)


def _worst(names: Sequence[str], off: Vec) -> str:
    """Which rows are off, and by how much, in words; empty where rows have no names."""
    if len(names) != off.size:
        return ""
    order = [i for i in np.argsort(-off, kind="stable").tolist() if off[i] > 0.0]
    told = ", ".join(f"{names[i]} {off[i]:.3g}" for i in order[:NAMED])
    return f": {told}" + (f" and {len(order) - NAMED} more" if len(order) > NAMED else "")


def culprits(program: Program, robot: Robot, solution: Solution) -> tuple[Note, ...]:
    """Notes on the constraints that are violated, or on the solver where none is."""
    notes = violations(program, robot, solution.residuals)
    if not notes or solution.status is not Status.CONSTRAINTS_VIOLATED:
        notes += (Note("solver", solution.status, solution.detail or solution.status.value),)
    return notes
