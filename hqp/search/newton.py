"""Newton steps of a stack from one configuration towards references, level by level."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Vec
from hqp.declare.element import Element, Inequality, Task, selection_of
from hqp.declare.law import P
from hqp.declare.price import Price
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.programs.formulation import Velocity

from .descent import LAST, LEAST, POLISH, PROGRESS, SETTLED, STALLED, STEP, STILL, Descent, Merit
from .native import CONTINUED, NativeDescents
from .sessions import Session, Sessions

CAP = 0.5
"""Most of an error that one step goes for [m or rad]: more would only press joints against their limits."""
TAU = 0.05
"""Price of motion [s] for targets out of reach: directions that are nearly lost move by 1/tau at most."""

GUARD_RATE = 0.5
"""Share of the way to a bound, a collision for one, that one step may go."""


class Compiled(NamedTuple):
    """A session, its stack with the robot's own elements, and live errors of its elements by name."""

    session: Session
    stack: Stack
    errors_by_name: list[tuple[str, Vec]]


def steps_of(stack: Stack, robot: Robot) -> Stack:
    """The stack for steps of one second: gain 1, limits of positions alone, other bounds left at half their way."""
    from hqp.tasks import CollisionAvoidance, Cone, JointLimits, SupportPolygon, Within

    def tame(element: Element) -> Element:
        if isinstance(element, JointLimits):
            return dataclasses.replace(element, acceleration=0.0, braking=0.0)
        if isinstance(element, (CollisionAvoidance, Cone, SupportPolygon, Within)):
            return dataclasses.replace(element, rate=GUARD_RATE, recovery=1.0, acceleration=math.inf)
        if not isinstance(element, (Task, Inequality)):
            return element
        most = CAP if selection_of(element, robot) is None else math.inf
        return dataclasses.replace(element, law=P(1.0, max_velocity=most))

    limited = any(isinstance(element, JointLimits) for element in stack)
    extra = () if limited else (JointLimits(acceleration=0.0, braking=0.0, name="reach_limits"),)
    levels = (level.replace(*map(tame, level)) for level in stack.levels)
    return Stack(*levels, subject_to=[*map(tame, stack.subject_to), *extra])


class Search:
    """Compile a stack for steps of one second; its rows hold the errors."""

    def __init__(self, stack: Stack, robot: Robot, sessions: Sessions) -> None:
        from hqp.tasks import JointLimits

        self.robot, self._sessions = robot, sessions
        self._stack, self._laws = steps_of(stack, robot), Velocity(law=P(1.0), contact_law=P(1.0))
        self._exact = self._compiled(Price(0.0))
        self._calm: Compiled | None = None
        members = [("subject_to", self._exact.stack.subject_to)]
        members += [(level.title, level.elements) for level in self._exact.stack.levels]
        self.groups: list[str] = [name for name, _ in members]
        self._members = [elements for _, elements in members]
        every = [e for elements in self._members for e in elements]
        self._limits = [e for e in every if isinstance(e, Inequality)]
        self._guards = [e for e in self._limits if not isinstance(e, JointLimits)]
        self._references: tuple[Reference, ...] = ()
        self._steered: dict[str, Vec | None] = {}
        self._targets: frozenset[str] = frozenset()
        self._native = NativeDescents(self._exact.session, self._members, GUARD_RATE, STILL, STALLED)
        self._calm_native: NativeDescents | None = None

    def _compiled(self, price: Price) -> Compiled:
        session = self._sessions(self._stack, self.robot, self._laws, price)
        members = session.program.assembly.members
        tasks = (e.name for e in session.stack if e.name in members and not isinstance(e, Inequality))
        return Compiled(session, session.stack, [(name, members[name].views.error) for name in tasks])

    @property
    def calm(self) -> Compiled:
        """The levels with a price on motion, for targets out of reach: slower, and the result is nearer."""
        if self._calm is None:
            self._calm = self._compiled(Price(tau=TAU))
        return self._calm

    def aim(self, q0: Vec, references: Sequence[Reference]) -> None:
        """Take targets; every other element holds its value at q0, in ``subject_to`` as a constraint."""
        state = self.robot.state(q0)
        given = {reference.name: reference for reference in references}
        held = [e.hold(state) for elements in self._members for e in elements if e.name not in given]
        self._references = (*references, *(r for r in held if r.value is not None and r.value.size))
        self._steered = {r.name: r.value for r in self._references}
        self._targets = frozenset((*given, *(e.name for e in self._members[0])))
        for native in (self._native, self._calm_native):
            if native is not None:
                native.aim(self._references, self._targets)

    def errors(self, descent: Descent) -> dict[str, float]:
        """Errors by element at the end of a start, joint limits included."""
        errors = descent.errors
        if errors is None or any(errors[element.name] > 0.0 for element in self._limits):
            _, errors = self.step(descent.q, whole=True)
        return errors

    def step(self, q: Vec, whole: bool = False, calm: bool = False) -> tuple[Vec | None, dict[str, float]]:
        """The step from q ``(nv,)`` (None without an answer) and errors at q by element.

        Joint limits, which no step from inside leaves, have an error only with ``whole``.
        """
        self._natively(calm).leave()
        state = self.robot.state(q)
        run = self.calm if calm else self._exact
        tick = run.session.step(state, *self._references)
        errors = {name: math.sqrt(float(error @ error)) for name, error in run.errors_by_name}
        errors.update((r.name, math.inf) for r in self._references if not r.finite)
        for element in self._limits if whole else self._guards:
            errors[element.name] = self._violation(run, element, state)
        return (np.array(tick.x) if tick.held == 0 else None), errors

    def _violation(self, run: Compiled, element: Inequality, state: State) -> float:
        """Violation of an inequality [m or rad]; distances of links are those of the step's rows."""
        from hqp.tasks import CollisionAvoidance

        if isinstance(element, CollisionAvoidance):
            rows = run.session.program.assembly.members[element.name].views
            return _beyond(rows.lower, rows.upper) / (element.weight * GUARD_RATE)
        value = (self._steered.get(element.name),) if element.steered else ()
        return _beyond(*element.bounds(state, *value))

    def merit(self, errors: Mapping[str, float], tolerance: float) -> Merit:
        """Errors of targets by group, those within the tolerance alike."""
        found = []
        for elements in self._members:
            worst = max((errors[e.name] for e in elements if e.name in self._targets and e.name in errors), default=0.0)
            found.append(max(1.0, worst / tolerance))
        return tuple(found)

    def residuals(self, errors: Mapping[str, float]) -> tuple[float, ...]:
        """Norm of the errors of each group, of all its members."""
        return tuple(math.sqrt(sum(errors.get(e.name, 0.0) ** 2 for e in elements)) for elements in self._members)

    def worst(self, group: int, errors: Mapping[str, float]) -> str:
        """The target of a group with the largest error."""
        names = [e.name for e in self._members[group] if e.name in self._targets and e.name in errors]
        return max(names, key=lambda name: errors[name])

    def descend(self, q: Vec, tolerance: float, most: int, end: float, calm: bool = False) -> Descent:
        """Steps from q until the targets are met and the rest has settled, ``most`` of them, until the time ``end``."""
        found = self._natively(calm).descend(q, tolerance, most, end - time.perf_counter())
        if found is None:
            return self._descend(q, tolerance, most, end, calm)
        if found.reason != CONTINUED:
            return found
        rest = self._descend(found.q, tolerance, most - found.steps, end, calm)
        return rest._replace(steps=found.steps + rest.steps)

    def _natively(self, calm: bool) -> NativeDescents:
        if not calm:
            return self._native
        if self._calm_native is None:
            self._calm_native = NativeDescents(self.calm.session, self._members, GUARD_RATE, SETTLED, stalled=None)
            self._calm_native.aim(self._references, self._targets)
        return self._calm_native

    def _descend(self, q: Vec, tolerance: float, most: int, end: float, calm: bool) -> Descent:
        met = (1.0,) * len(self.groups)
        here, at, x, size, radius = (math.inf,) * len(met), q, np.zeros(self.robot.nv), 0.0, STEP
        best, mark, since, settled, taken = Descent(q, here, 0, ""), here, 0, 0, 0
        while True:
            found, errors = self.step(q, calm=calm)
            merit = self.merit(errors, tolerance)
            if merit <= best.merit:
                best = Descent(q, merit, taken, "")
            if merit > here and radius > LEAST:  # back to where it came from, half the way
                radius *= 0.5
            else:
                if found is None:
                    return best._replace(steps=taken, reason="the solver found no solution")
                here, at, x, radius = merit, q, found, min(2.0 * radius, STEP)
                size = float(np.abs(x).max())
                if merit == met:
                    settled += 1
                    if size <= POLISH or settled > LAST:
                        return Descent(q, merit, taken, "")
                elif size < (SETTLED if calm else STILL):
                    return best._replace(steps=taken, reason="no step improves it")
                since = 0 if merit == met or advanced(merit, mark) else since + 1
                mark = merit if since == 0 else mark
                if since > STALLED and not calm:
                    return best._replace(steps=taken, reason="stalled")
            if taken == most or time.perf_counter() > end:
                return best._replace(steps=taken, reason="step limit reached")
            taken += 1
            radius = min(radius, size)
            q = self.robot.integrate(at, x, radius / max(size, 1e-12))


def _beyond(lower: ArrayLike, upper: ArrayLike) -> float:
    """Largest number that bounds demand."""
    return max(0.0, float(np.max(lower, initial=0.0)), float(np.max(np.negative(upper), initial=0.0)))


def advanced(merit: Merit, mark: Merit) -> bool:
    """Return true if the first unmet group has fallen or is met."""
    for now, then in zip(merit, mark, strict=True):
        if now != then:
            return now < PROGRESS * then or now == 1.0
    return False
