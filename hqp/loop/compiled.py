"""Stacks made ready for a robot, and a cache of those that a session has seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from hqp.arrays import FLOAT, Vec
from hqp.declare.element import Element
from hqp.declare.law import Law
from hqp.declare.price import Price, Priced, affordable, as_price, is_exact
from hqp.declare.robot import Robot
from hqp.declare.safety import RateLimits
from hqp.declare.stack import Stack, coupled
from hqp.explanation.notes import STATUSES
from hqp.loop.checks import turning, units_of
from hqp.loop.guards import following, jerk_limits, largest_changes, motor_limits, rate_limits
from hqp.loop.presence import PhaseLaws, Presence
from hqp.loop.way import Waypoint, path
from hqp.problem import Solution, Stats, Status
from hqp.programs.assembly import kinematics
from hqp.programs.formulation import Formulation, Program
from hqp.programs.rest import Holding
from hqp.solvers.base import Solver, Workspace
from hqp.solvers.second_opinion import STUCK

if TYPE_CHECKING:
    from hqp._assembly import Kinematics

MEASURES = ("acceleration", "braking")
"""Fields of JointLimits and BallLimits that slow commands by default."""

KEPT = 16
"""Stacks whose compiled form a session keeps; one that was completed counts as two."""


ANSWERED, STAGED = 1, 2
"""Bits of the last byte: the solver gave an answer, and it is that of stages."""


class Layout:
    """Layout of the records of one program: numbers, then marks of rows and a byte (hqp/cpp/session/record.hpp)."""

    def __init__(self, program: Program, robot: Robot, *, moves: bool) -> None:
        """moves: true if a record holds the next q."""
        problem, motors = program.problem, robot.actuated.size
        n, rows = problem.n, [level.m for level in problem.levels]
        sizes = (motors, n, n, sum(rows), 6, robot.nq, robot.nv, robot.nq if moves else 0)
        ends = list(accumulate(sizes))
        parts = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
        self._command, self._x, self._answer, self._slack, self._stats, self._q, self._v, self._moved = parts
        self._length, self._moves = ends[-1], moves
        level_ends = [0, *accumulate(rows)]
        self._rows = [slice(a, b) for a, b in pairwise(level_ends)]
        self._total, self._n = level_ends[-1], n
        self._picks = None if program.kind == "torque" else robot.actuated
        self.width = motors
        """Numbers of the command, the first of a record."""
        self.q_shape, self.v_shape = (robot.nq,), (robot.nv,)
        self.rest, self.zero = np.zeros(robot.nv), np.zeros(n)
        self.zero.setflags(write=False)

    def _part(self, record: bytearray, part: slice) -> Vec:
        return np.frombuffer(record, FLOAT, part.stop - part.start, 8 * part.start)

    def x(self, record: bytearray) -> Vec:
        """The sent x ``(n,)``, read-only."""
        x = self._part(record, self._x)
        x.setflags(write=False)
        return x

    def answer(self, record: bytearray) -> Vec:
        """The x of the solver ``(n,)``."""
        return self._part(record, self._answer)

    def slacks(self, record: bytearray) -> Vec:
        """Slacks of all rows at the solver's x."""
        return self._part(record, self._slack)

    def state(self, record: bytearray) -> tuple[Vec, Vec]:
        """q and v of the tick."""
        return self._part(record, self._q).copy(), self._part(record, self._v).copy()

    def moved(self, record: bytearray) -> tuple[Vec, Vec] | None:
        """q and v one period later, at velocity level."""
        if not self._moves:
            return None
        return self._part(record, self._moved).copy(), self._part(record, self._x).copy()

    def seconds(self, record: bytearray) -> tuple[float, float, float]:
        """Start of the native call on the clock of ``perf_counter``, and the time for rows and for the solver [s]."""
        begin, rows, solve, *_ = self._part(record, self._stats).tolist()
        return begin, rows, solve

    def send(self, record: bytearray, x: Vec) -> None:
        """Write another x and its command."""
        self._part(record, self._x)[:] = x
        self._part(record, self._command)[:] = x if self._picks is None else x[self._picks]

    def solution(self, record: bytearray) -> Solution | None:
        """Answer of the solver, None if it did not run."""
        if not record[-1] & ANSWERED:
            return None
        _, _, solve, iterations, factorisations, severity = self._part(record, self._stats).tolist()
        points = None
        if record[-1] & STAGED:
            count = len(self._rows)
            points = np.frombuffer(record, FLOAT, count * self._n, 8 * self._length).reshape(count, self._n).copy()
        marks = np.frombuffer(record, np.int8, self._total, len(record) - 1 - self._total)
        slack, status = self.slacks(record), STATUSES[int(severity)]
        for shared in (answer := self.answer(record), slack, marks):
            shared.setflags(write=False)
        return Solution(
            answer,
            status,
            tuple(slack[part] for part in self._rows),
            tuple(marks[part] for part in self._rows),
            Stats(int(iterations), int(factorisations), 0.0, solve),
            STUCK if status is Status.NOT_CERTIFIED else "",
            stage_points=points,
        )


def staged(record: bytearray) -> bool:
    """Return true if the answer has stage points."""
    return record[-1] > ANSWERED


@dataclass(slots=True, eq=False)
class Compiled:
    """A stack compiled for a robot: its program, a workspace, and the parts of a native session.

    limit: function that limits the solver's time, or None.  dropped: prices that the solver and limits that the robot
    does not support, in words.  units: units of joint limits, by name.  holding: torque that holds the robot up, at
    torque level.  guards: limits of states and commands, see ``hqp.loop.document``.  call: the solver as native code
    runs it, None for one in Python.
    """

    stack: Stack
    program: Program
    workspace: Workspace
    robot: Robot
    limit: Callable[[float], None] | None
    hard: frozenset[str]
    dropped: str
    units: dict[str, list[str]]
    laws: PhaseLaws
    presence: Presence
    holding: Holding | None
    guards: dict[str, Any]
    call: object
    moving: Kinematics | None
    layout: Layout
    tree: dict[str, Any] | None = None
    """Tree of native sessions over the arrays of the program, None before the first one."""

    @property
    def native_solver(self) -> bool:
        """True if native code runs the solver."""
        return self.call is not None

    @property
    def placed(self) -> bool:
        """True if native kinematics know all joints."""
        return self.moving is not None


class Declared(Protocol):
    """Interface of a controller."""

    @property
    def formulation(self) -> Formulation: ...
    @property
    def solver(self) -> str | Solver: ...
    @property
    def price(self) -> Priced: ...
    @property
    def rates(self) -> RateLimits | None: ...
    @property
    def calm(self) -> bool: ...


class Compiler:
    """Compiles stacks for one controller on one robot, and keeps the latest of them."""

    def __init__(self, controller: Declared, robot: Robot, dt: float, guards: Mapping[str, Any]) -> None:
        """guards: independent of a stack, see ``hqp.loop.document.guards``."""
        self._controller, self._robot, self._dt, self._guards = controller, robot, dt, guards
        self._deadline: float = guards["deadline"]
        self._seen: dict[Stack, Compiled] = {}
        self._ways: dict[tuple[Stack, Stack], list[Waypoint]] = {}

    def way(self, before: Compiled, after: Stack) -> list[Waypoint]:
        """The stacks on the way of a transition, from the cache if known."""
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
        """Compile a stack, or take it from the cache."""
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

    def completed(self, stack: Stack) -> Stack:
        """The stack with the elements that controller and formulation add."""
        return self._completed(stack)[0]

    def _completed(self, stack: Stack) -> tuple[Stack, Price | None, str, bool]:
        """The stack, its default price, dropped prices and limits in words, and true if it is bounded."""
        formulation = self._controller.formulation
        whole = formulation.completed(coupled(stack if self._controller.calm else undamped(stack), self._robot))
        solver = self._controller.solver
        assert isinstance(solver, Solver)  # Controller has loaded it
        price, dropped = affordable(whole, as_price("controller", self._controller.price), solver)
        bounded = solver.inequalities and not is_exact(price)
        if bounded:
            whole, unbounded = formulation.bounded(whole, self._robot)
            dropped = "; ".join(filter(None, (dropped, unbounded)))
        return whole, price, dropped, bounded

    def _compiled(self, stack: Stack) -> Compiled:
        formulation, solver = self._controller.formulation, self._controller.solver
        assert isinstance(solver, Solver)  # Controller has loaded it
        whole, price, dropped, bounded = self._completed(stack)
        program = formulation.compile(whole, self._robot, self._dt, price)
        solver.require(program.shape)
        workspace = solver.workspace(program.shape)
        limit = None if getattr(solver, "deadline", 0.0) is not None else getattr(workspace, "limit", None)
        if limit is not None and self._deadline == math.inf:
            limit(math.inf)
            limit = None
        bind = getattr(workspace, "kernel", None)
        kernel = None if bind is None else bind(program.problem)  # here, not in the first tick
        hard = frozenset(element.name for element in whole.subject_to)
        deadline = self._deadline if limit is not None else math.inf
        guards = {
            **self._guards,
            "deadline": deadline,
            "gradual": largest_changes(self._robot, whole, program.kind, self._dt),
        }
        guards["rates"] = rate_limits(self._robot, self._controller.rates, program.kind, self._dt)
        guards["jerk"] = jerk_limits(self._robot, whole, formulation, program.kind, self._dt)
        netted = program.kind != "torque" or (bounded and getattr(formulation, "effort_limits", True))
        checked = self._controller.calm and netted
        turns = turning(self._robot)
        guards["motors"] = motor_limits(self._robot, whole, program.kind, turns) if checked else None
        max_age = guards["state"]["max_age"]
        guards["following"] = None if max_age is None else following(self._robot, self._dt, max_age, turns)
        moving = program.assembly.moving or kinematics(self._robot)
        return Compiled(
            stack=whole,
            program=program,
            workspace=workspace,
            robot=self._robot,
            limit=limit,
            hard=hard,
            dropped=dropped,
            units=units_of(program, self._robot),
            laws=PhaseLaws(program.assembly),
            presence=Presence(whole, program),
            holding=program.holding(self._robot),
            guards=guards,
            call=None if kernel is None else kernel[3],
            moving=moving,
            layout=Layout(program, self._robot, moves=program.kind == "velocity" and moving is not None),
        )


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
