"""Inverse kinematics to a target: strict levels, step control, restarts."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Vec
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot
from hqp.declare.stack import Stack, require_stack
from hqp.errors import DeclarationError, ModelError
from hqp.loop.session import one_second
from hqp.numbers import number, whole
from hqp.search.newton import Search
from hqp.search.starts import random_start

from .kept import Kept

_SEARCHES: Kept[Search] = Kept(8)
SETTLING = 0.2
"""Share of the budget that may be spent on top of it to settle levels that cannot be met."""


@dataclass(frozen=True)
class Reached:
    """Result of ``reach``.

    q ``(nq,)``: the configuration.  success: true if every target is within the tolerance.  reason: of a failure, else
    "".  residuals: by level, ``subject_to`` first, the norm of the errors of all its elements [m, rad].  errors: by
    element, the norm of its error.  starts, steps: their numbers.  time [s].
    """

    q: Vec
    success: bool
    reason: str
    residuals: dict[str, float]
    errors: dict[str, float]
    starts: int
    steps: int
    time: float

    def __str__(self) -> str:
        outcome = "reached" if self.success else f"not reached: {self.reason}"
        levels = ", ".join(f"{name} {value:.3g}" for name, value in self.residuals.items())
        return f"{outcome} ({self.starts} starts, {self.steps} steps, {1e3 * self.time:.1f} ms; {levels})"


def reach(
    stack: Stack,
    robot: Robot,
    *references: Reference,
    q0: Vec | None = None,
    restarts: int = 50,
    tolerance: float = 1e-3,
    budget: float = 1.0,
    steps: int = 100,
    seed: int = 0,
) -> Reached:
    """The configuration that meets the references level by level, from q0 (home), then from random starts.

    Each step is the exact hierarchy at gain 1, x with J x = -e level by level inside the limits (Gauss-Newton on strict
    levels), no coordinate by more than 0.8 rad or m, halved while it makes the first unmet level worse.  Targets are
    the elements with a reference here and the members of ``subject_to``, which hold their values at q0; elements
    without a reference hold that as well as the levels above allow and count for nothing.  Joint limits are kept
    even if the stack does not name them.  If levels exclude each other the result with the smallest first unmet
    level is returned, ``success`` False.

    tolerance [m, rad]: on the norm of each target's error.  restarts: random configurations inside the joint limits,
    tried where a start stalls.  steps: limit for one start.  budget [s]: limit for the search, a fifth more if the best
    result must settle on levels that cannot be met.  seed: for the restarts.
    Raises DeclarationError without references or for bad numbers, ModelError for a q0 of another shape.
    """
    _check(stack, robot, references, q0)
    restarts, steps = whole("reach", "restarts", restarts, 0), whole("reach", "steps", steps, 1)
    tolerance = number("reach", "tolerance", tolerance, 0.0, strict=True, infinite=True)
    budget = number("reach", "budget", budget, 0.0, strict=True, infinite=True)
    begin = time.perf_counter()
    search = _SEARCHES.get(robot, stack, lambda copy: Search(stack, copy, one_second))
    q0 = robot.home if q0 is None else np.array(q0, dtype=np.float64)
    search.aim(q0, references)
    first = best = found = search.descend(q0, tolerance, steps, begin + budget)
    starts, taken, rng = 1, found.steps, None
    while not found.met and starts <= restarts and time.perf_counter() < begin + budget:
        rng = np.random.default_rng(seed) if rng is None else rng
        found = search.descend(random_start(robot, q0, rng), tolerance, steps, begin + budget)
        starts, taken, best = starts + 1, taken + found.steps, min(best, found, key=lambda descent: descent.merit)
    last = "time budget spent" if time.perf_counter() > begin + budget else found.reason
    if not best.met:
        for start in {id(first): first, id(best): best}.values():
            found = search.descend(start.q, tolerance, steps, begin + (1.0 + SETTLING) * budget, calm=True)
            taken, best = taken + found.steps, min(found, best, key=lambda descent: descent.merit)
    errors = search.errors(best)
    reason = "" if best.met else _reason(search, best.merit, errors, starts, last)
    residuals = dict(zip(search.groups, search.residuals(errors), strict=True))
    return Reached(best.q, best.met, reason, residuals, errors, starts, taken, time.perf_counter() - begin)


def _reason(search: Search, merit: tuple[float, ...], errors: dict[str, float], starts: int, last: str) -> str:
    level = next(i for i, value in enumerate(merit) if value > 1.0)
    name = search.worst(level, errors)
    return f"{search.groups[level]}: {name} has error {errors[name]:.3g} after {starts} starts; the last ended: {last}"


def _check(stack: Stack, robot: Robot, references: tuple[Reference, ...], q0: Vec | None) -> None:
    require_stack("reach", stack)
    if not references:
        raise DeclarationError("reach", "no references given", allowed="task.at(...) of at least one task of the stack")
    if not hasattr(robot, "nq"):
        raise DeclarationError("reach", "not a robot", value=robot, allowed='hqp.robots.load("panda")')
    for reference in references:
        if not isinstance(reference, Reference):
            raise DeclarationError("reach", "not a Reference", value=reference, allowed="task.at(...)")
        stack.find(reference.name)
    if q0 is not None and np.shape(q0) != (robot.nq,):
        raise ModelError(f"{robot.name}: q0 has shape {np.shape(q0)}, needed ({robot.nq},)")
    if q0 is not None and not np.isfinite(numbers("reach", "q0", q0, (robot.nq,))).all():
        raise DeclarationError("reach", "bad q0", value=q0, allowed="finite numbers")
