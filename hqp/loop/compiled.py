"""Stacks made ready for a robot, and a cache of those that a session has seen."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

from hqp.declare.element import Element
from hqp.declare.law import Law
from hqp.declare.price import affordable, as_price, is_exact
from hqp.declare.robot import Robot
from hqp.declare.stack import Stack, coupled
from hqp.loop.outgoing import outgoing
from hqp.loop.phase_laws import PhaseLaws
from hqp.loop.restless import Watched
from hqp.loop.transition.waypoints import Waypoint, path
from hqp.programs.direct import Direct
from hqp.programs.formulation import Program
from hqp.programs.rest import Rest
from hqp.solvers.base import Solver, Workspace

if TYPE_CHECKING:
    from hqp._session import Outgoing
    from hqp.loop.controller import Controller

MEASURES = ("acceleration", "braking")
"""Fields of JointLimits and BallLimits that slow commands by default."""

KEPT = 16
"""Stacks whose compiled form a session keeps; one that was completed counts as two."""


@dataclass(slots=True, eq=False)
class Compiled:
    """A stack made ready for a robot: its program, a workspace, how to limit its time, how to come to rest.

    dropped: what of prices the solver and of limits the robot cannot do, in words.  watched: its limits of joints.
    outgoing: what is sent of its answers.  laws: of its elements by phase.  loop: of ordinary ticks, once it was found.
    """

    stack: Stack
    program: Program
    workspace: Workspace
    limit: Callable[[float], None] | None
    rest: Rest
    hard: frozenset[str]
    dropped: str
    watched: Watched
    outgoing: Outgoing
    laws: PhaseLaws
    loop: Direct | None = None

    def direct(self) -> Direct | None:
        """The loop of ordinary ticks, made once; None where there is none now."""
        if self.loop is None:  # at torque level there may be one later, once the rows have been filled
            self.loop = self.program.direct(self.workspace)
        return self.loop


class Compiler:
    """Compiles stacks for one controller on one robot, and keeps the latest of them."""

    def __init__(self, controller: Controller, robot: Robot, dt: float, deadline: float) -> None:
        self._controller, self._robot, self._dt, self._deadline = controller, robot, dt, deadline
        self._seen: dict[Stack, Compiled] = {}
        self._ways: dict[tuple[Stack, Stack], list[Waypoint]] = {}

    def way(self, before: Compiled, after: Stack) -> list[Waypoint]:
        """The stacks on the way of a transition, from the cache where it was gone before."""
        law = self._controller.formulation.contact_law if before.program.kind == "torque" else None
        return self._way(before.stack, after, law)

    def _way(self, before: Stack, after: Stack, law: Law | None) -> list[Waypoint]:
        try:
            known = self._ways.pop((before, after), None)
        except TypeError:  # as below
            return path(before, after, self._robot, law)
        known = known or path(before, after, self._robot, law)
        self._ways[before, after] = known
        if len(self._ways) > KEPT:
            del self._ways[next(iter(self._ways))]
        return known

    def compile(self, stack: Stack) -> Compiled:
        """Everything that a stack needs, from the cache where it was seen before."""
        try:
            known = self._seen.pop(stack, None)
        except TypeError:  # an element of the user's own with a field that has no hash
            return self._compiled(stack)
        known = known or self._compiled(stack)
        for key in (known.stack, stack):  # a transition starts from the stack as it was completed
            self._seen.pop(key, None)
            self._seen[key] = known  # the latest last
        while len(self._seen) > KEPT:
            del self._seen[next(iter(self._seen))]
        return known

    def _compiled(self, stack: Stack) -> Compiled:
        whole = coupled(stack if self._controller.calm else undamped(stack), self._robot)
        solver = self._controller.solver
        assert isinstance(solver, Solver)  # Controller has loaded it
        price, dropped = affordable(whole, as_price("controller", self._controller.price), solver)
        formulation = self._controller.formulation
        if solver.inequalities and not is_exact(price):
            whole, unbounded = formulation.bounded(whole, self._robot)
            dropped = "; ".join(filter(None, (dropped, unbounded)))
        program = formulation.compile(whole, self._robot, self._dt, price)
        solver.require(program.shape)
        workspace = solver.workspace(program.shape)
        limit = None if getattr(solver, "deadline", 0.0) is not None else getattr(workspace, "limit", None)
        if limit is not None and self._deadline == math.inf:
            limit(math.inf)
            limit = None
        if bind := getattr(workspace, "kernel", None):
            bind(program.problem)  # here, not in the first tick
        hard = frozenset(element.name for element in whole.subject_to)
        rest = program.rest(self._robot, self._controller.braking)
        watched, laws = Watched(program, self._robot), PhaseLaws(program.assembly)
        sent = outgoing(program, self._robot, self._dt)
        return Compiled(whole, program, workspace, limit, rest, hard, dropped, watched, sent, laws)


def undamped(stack: Stack) -> Stack:
    """The stack with neither acceleration window nor braking curve, but where its limits declare other numbers."""
    levels = [level.replace(*map(_undamped, level)) for level in stack.levels]
    return Stack(*levels, subject_to=[_undamped(element) for element in stack.subject_to])


def _undamped(element: Element) -> Element:
    from hqp.tasks import BallLimits, JointLimits

    if not isinstance(element, (JointLimits, BallLimits)):
        return element
    given = {f.name: f.default for f in fields(element) if f.name in MEASURES}
    off = {name: 0.0 for name, default in given.items() if getattr(element, name) == default}
    return replace(element, **off)  # type: ignore[arg-type]
