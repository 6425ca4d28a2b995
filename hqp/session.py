"""The control loop: a controller makes sessions, a session takes a state each tick and returns a command."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from hqp.arrays import Vec
from hqp.errors import DeclarationError, HqpError, ModelError, NotSolved, UnknownReference, closest
from hqp.explain import Explanation, explain
from hqp.formulation import Formulation, Program, Velocity
from hqp.problem import VIOLATION_TOLERANCE, Hierarchy, Solution, Status
from hqp.reference import Reference
from hqp.robot import Robot, State
from hqp.solvers import load
from hqp.solvers.base import Solver
from hqp.stack import Stack, coupled


@dataclass(frozen=True, slots=True)
class Note:
    """What went wrong with which element."""

    element: str
    status: Status
    detail: str


@dataclass(frozen=True, slots=True)
class Times:
    """Where a tick's wall time went [s]."""

    state: float
    assemble: float
    solve: float
    command: float


@dataclass(frozen=True)
class Controller:
    """A stack, a formulation and a solver: everything of a controller but the robot.

    solver: a name for ``hqp.solvers.load`` or a Solver.
    """

    stack: Stack
    formulation: Formulation = field(default_factory=Velocity)
    solver: str | Solver = "lexicographic"

    def __post_init__(self) -> None:
        if not isinstance(self.stack, Stack):
            raise DeclarationError("controller", "stack is not a Stack", value=self.stack)
        if not isinstance(self.formulation, Formulation):
            raise DeclarationError("controller", "not a formulation", value=self.formulation, allowed="Velocity(), ...")
        if isinstance(self.solver, str):
            object.__setattr__(self, "solver", load(self.solver))

    def session(self, robot: Robot, dt: float) -> Session:
        """Compile for a robot at a control period dt [s].

        Raises DeclarationError, ModelError or UnsupportedProblem for what does not fit, before the loop.
        """
        return Session(self, robot, dt)


class Tick:
    """What one step gave.

    command: ``(n_actuated,)``, in robot.joint_names order.  status: the worst of the tick.  notes: the culprits.
    solution: None where none was computed (invalid state).  times: where the time went.
    """

    __slots__ = ("_count", "_session", "_state", "command", "notes", "solution", "status", "times")

    def __init__(
        self,
        session: Session,
        state: State,
        command: Vec,
        status: Status,
        notes: tuple[Note, ...],
        solution: Solution | None,
        times: Times | None,
    ) -> None:
        self._session, self._state, self._count = session, state, session.count
        self.command, self.status, self.notes = command, status, notes
        self.solution, self.times = solution, times

    def explain(self) -> Explanation:
        """Which element got what and lost to which; raises HqpError once the session has taken another step."""
        return self._session.explain(self)

    def advance(self) -> tuple[Vec, Vec]:
        """(q, v) one period later if the command is carried out exactly (Mistry 2008, eqs. 19 to 22)."""
        x = self._session.safe_x if self.solution is None else self.solution.x
        return self._session.program.advance(self._state, x)

    def unwrap(self) -> Vec:
        """The command if the status is ``solved``; raises NotSolved with a copy of the problem otherwise."""
        if not self.status.solved:
            detail = "; ".join(f"{n.element}: {n.detail}" for n in self.notes)
            raise NotSolved(
                f"{self.status.name}: {self.status.value}" + (f" ({detail})" if detail else ""),
                self._session.problem.copy(),
            )
        return self.command

    def __repr__(self) -> str:
        return f"<Tick {self.status.name}, {len(self.notes)} notes>"


class Session:
    """A controller on one robot; keeps hold values, the last safe command and the solver's warm start."""

    def __init__(self, controller: Controller, robot: Robot, dt: float) -> None:
        if not isinstance(dt, (int, float)) or not 0.0 < dt < math.inf:
            raise DeclarationError("session", "bad control period", value=dt, unit="s", allowed="dt > 0")
        self.controller, self.robot, self.dt = controller, robot, float(dt)
        self.count = 0
        self._holds: dict[str, Reference] = {}
        self._compile(controller.stack)
        self.safe_x: Vec = np.zeros(self.program.problem.n)
        self._safe_command: Vec = np.zeros(len(robot.joint_names))

    def _compile(self, stack: Stack) -> None:
        solver = self.controller.solver
        assert isinstance(solver, Solver)  # Controller has loaded it
        self.stack = stack = coupled(stack, self.robot)
        self.program: Program = self.controller.formulation.compile(stack, self.robot, self.dt)
        solver.require(self.program.shape)
        self.workspace = solver.workspace(self.program.shape)
        self._current: dict[str, Reference] = {}
        self._given: list[Reference] = []

    @property
    def problem(self) -> Hierarchy:
        """The hierarchy of the latest tick: live, refilled by the next step; ``problem.copy()`` is not."""
        return self.program.problem

    def step(self, state: State, *references: Reference) -> Tick:
        """One tick: the command for a state, with references good for this tick only.

        Data never raises: what is wrong with it is told by status and notes.  Raises StaleState, UnknownReference
        or ModelError (a state of another robot), which are errors of the program.
        """
        start = perf_counter()
        self.count += 1
        if state.robot is not self.robot:
            raise ModelError(f"the session runs on {self.robot!r}, the state belongs to {state.robot!r}")
        if not state.finite:
            return self._hold_still(state, Note("state", Status.INVALID_STATE, "q or v is not finite"))
        program = self.program
        program.prepare(state)
        if not self._current:
            self._take_holds(state)
        prepared = perf_counter()
        if references or self._given:
            self._take(references)
        program.fill(state, self._current, self._given)
        unfit = program.unfit()
        left_out = self._leave_out(state, unfit) if unfit else ()
        filled = perf_counter()
        solution = self.workspace.solve(program.problem)
        solved = perf_counter()
        x = solution.x
        if not float(x @ x) < math.inf:
            return self._hold_still(state, Note("solver", Status.NOT_CERTIFIED, "the answer is not finite"), *left_out)
        command = program.command(x)
        status, notes = solution.status, left_out
        if left_out:
            status = Status.worst(status, Status.INVALID_REFERENCE)
        if solution.status is not Status.OPTIMAL:
            notes += self._culprits(solution)
        if status.usable:
            self.safe_x, self._safe_command = x, command
        times = Times(prepared - start, filled - prepared, solved - filled, perf_counter() - solved)
        return Tick(self, state, command, status, notes, solution, times)

    def _take_holds(self, state: State) -> None:
        """Hold values of elements that have none yet, at the first step or after a change of stack."""
        for element in self.stack:
            if element.name not in self._holds:
                self._holds[element.name] = element.hold(state)
        self._current = dict(self._holds)

    def _take(self, references: tuple[Reference, ...]) -> None:
        """Put this tick's references in place of the hold values; raises UnknownReference."""
        current, holds = self._current, self._holds
        for old in self._given:
            current[old.name] = holds[old.name]
        self._given = []
        for reference in references:
            name = reference.name
            if name not in current:
                near = ", ".join(closest(name, current) or list(current)[:3])
                raise UnknownReference(f"a reference for {name!r}, which the stack does not hold; closest: {near}")
            if reference.value is None:
                reference = Reference(
                    name,
                    holds[name].value,
                    reference.velocity,
                    reference.acceleration,
                    reference.normal,
                    reference.gravity_normal,
                )
            current[name] = reference
            self._given.append(reference)

    def _leave_out(self, state: State, unfit: tuple[str, ...]) -> tuple[Note, ...]:
        """Fill again with hold values for what was not finite, free its rows, and say so."""
        self._given = [reference for reference in self._given if reference.name not in unfit]
        notes = []
        for name in unfit:
            what = "rows" if self._current[name].finite else "reference"
            notes.append(Note(name, Status.INVALID_REFERENCE, f"its {what} came out not finite: left out of this tick"))
            self._current[name] = self._holds[name]
        self.program.fill(state, self._current, self._given)
        for name in unfit:
            self.program.leave_out(name)
        return tuple(notes)

    def _hold_still(self, state: State, *notes: Note) -> Tick:
        status = Status.worst(*(note.status for note in notes))
        return Tick(self, state, self._safe_command.copy(), status, notes, None, None)

    def _culprits(self, solution: Solution) -> tuple[Note, ...]:
        """Notes on the constraints that are violated, or on the solver where none is."""
        notes = []
        constraints = self.problem.constraints
        for name, place in self.program.places.items():
            if place.level < constraints:
                w = solution.residuals[place.level][place.part]
                worst = float(np.abs(w).max(initial=0.0))
                if worst > VIOLATION_TOLERANCE:
                    notes.append(Note(name, Status.CONSTRAINTS_VIOLATED, f"off by up to {worst:.3g}"))
        if not notes or solution.status is not Status.CONSTRAINTS_VIOLATED:
            notes.append(Note("solver", solution.status, solution.detail or solution.status.value))
        return tuple(notes)

    def change(self, stack: Stack) -> None:
        """Switch to another stack; elements whose name survives keep hold values, the robot its last command.

        Raises what ``Controller.session`` raises, and then leaves the session as it was.
        """
        before = self.program, self.workspace, self.stack, self._current, self._given
        try:
            self._compile(stack)
        except HqpError:
            self.program, self.workspace, self.stack, self._current, self._given = before
            raise
        if self.program.shape == before[0].shape:
            self.workspace = before[1]  # warm: the rows keep their places
        names = {element.name for element in stack}
        self._holds = {name: hold for name, hold in self._holds.items() if name in names}

    def explain(self, tick: Tick) -> Explanation:
        """The account of the latest tick; raises HqpError for an earlier one, whose rows are overwritten."""
        if tick._count != self.count or tick.solution is None:
            raise HqpError("explain() tells of the latest step with a solution; call it before the next step")
        row_names = {element.name: element.row_names(self.robot) for element in self.stack if not element.equality}
        return explain(self.problem, tick.solution, self.program.places, row_names)
