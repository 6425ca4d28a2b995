"""Result of one step of a session: a command, a status, and notes that name the culprits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import FLOAT, Vec
from hqp.errors import HqpError, NotSolved
from hqp.explanation.notes import Note, Notes, added
from hqp.explanation.words import Explanation
from hqp.loop.compiled import staged
from hqp.problem import Solution, Status

if TYPE_CHECKING:
    from hqp.declare.robot import State
    from hqp.explanation.account import TickAccount
    from hqp.explanation.conflict import Conflict
    from hqp.explanation.counters import Counters
    from hqp.loop.line import Line
    from hqp.programs.formulation import Program


NO_ROWS: Vec = np.zeros(0)


@dataclass(frozen=True, slots=True)
class Times:
    """Wall time of the parts of a tick [s]."""

    state: float
    assemble: float
    solve: float
    command: float


@dataclass(frozen=True, slots=True)
class Jump:
    """The largest change of a command since the tick before, and its joint."""

    joint: str
    change: float

    def __str__(self) -> str:
        return f"{self.joint} by {self.change:+.3g}"


@dataclass(frozen=True, slots=True)
class Stuck(Note):
    """A note on a stuck task, with a posture ``(nq,)`` that meets it."""

    posture: Vec


class Tick:
    """Result of a step; plain data once pickled.

    status: the worst of the tick.  held: ticks for which the command has been coming to rest without a usable answer, 0
    in normal operation.  count: the tick's number in its session.  transition: progress of a change of stack, 1 without
    one.  phase: as in ``Session.step``.  event: event of a Sequence in this tick, "" for none.  Everything else is
    computed on first use.
    """

    __slots__ = (
        "_before", "_began", "_blended", "_change", "_command", "_layout", "_line", "_notes", "_record", "_solution",
        "_state", "_times", "_x", "count", "event", "held", "phase", "status", "transition",
    )  # fmt: skip

    def __init__(
        self,
        line: Line,
        state: State | None,
        before: Vec | bytearray | None,
        record: bytearray,
        began: float,
        solution: Solution | None = None,
        status: Status = Status.OPTIMAL,
        notes: Notes = (),
        held: int = 0,
    ) -> None:
        """state: None for the state of the record.  before: record of the last command, None without one.  began: time
        of ``perf_counter``.  solution: result of a Python solver."""
        self._line: Line | None = line
        self._layout, self.count = line.layout, line.guards.count
        self.phase, self.event = line.guards.phase, ""
        self._record: bytearray | None = record
        self._solution, self._state, self._before, self._began = solution, state, before, began
        self.status, self._notes, self.held = status, notes, held
        self.transition, self._blended = 1.0, False
        self._x: Vec | None = None
        self._times: Times | None = None
        self._command: Vec | None = None
        self._change: tuple[tuple[str, ...], Vec] | None = None

    def follow(self, x: Vec, before: Vec, notes: Notes, status: Status, transition: float) -> None:
        """Replace the tick in a transition: another answer, status and notes of both stacks."""
        assert self._record is not None
        self._record = bytearray(self._record)
        self._layout.send(self._record, x)
        self._blended = True
        self._before, self._notes, self.transition = before, notes, transition
        self._x, self._command, self._change, self.status = None, None, None, status

    @property
    def record(self) -> bytearray:
        """The record of the tick."""
        assert self._record is not None
        return self._record

    @property
    def x(self) -> Vec:
        """The answer that contains the command, read-only."""
        if self._x is None:
            self._x = self._layout.x(self.record)
        return self._x

    @property
    def command(self) -> Vec:
        """The command ``(n_actuated,)``, in robot.joint_names order, the caller's own copy."""
        if self._command is None:
            self._command = np.frombuffer(self.record, FLOAT, self._layout.width).copy()
        return self._command

    @property
    def before(self) -> Vec:
        """The previous x, read-only."""
        before = self._before
        if not isinstance(before, np.ndarray):
            self._before = before = self._layout.zero if before is None else self._layout.x(before)
        return before

    @property
    def solution(self) -> Solution | None:
        """Solution of the solver, None if it did not run (invalid state)."""
        if self._solution is None and self._record is not None:
            self._solution = self._layout.solution(self._record)
        return self._solution

    @property
    def times(self) -> Times:
        """Times of the parts, without the construction of this object."""
        if self._times is None:
            begin, rows, solve = self._layout.seconds(self.record)
            self._times = Times(begin - self._began, rows, solve, 0.0)
        return self._times

    def solved(self) -> tuple[Vec, Vec, bool] | None:
        """Slacks of all rows, the solver's answer, and true if stages gave it; None without a solution."""
        if (record := self._record) is not None:
            if not record[-1]:
                return None
            return self._layout.slacks(record), self._layout.answer(record), staged(record)
        if (solution := self._solution) is None:
            return None
        return np.concatenate([*solution.residuals, NO_ROWS]), solution.x, solution.stage_points is not None

    @property
    def program(self) -> Program | None:
        """The compiled stack whose rows the tick has, None once pickled."""
        return None if self._line is None else self._line.program

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes on the culprits, with texts made on first use."""
        if callable(self._notes):
            self._notes = self._notes()
        return self._notes

    @property
    def unread(self) -> Notes:
        """The notes, or a function that makes them."""
        return self._notes

    def add(self, notes: Notes) -> None:
        """Append notes."""
        self._notes = added(self._notes, notes)

    def suggest(self, what: str) -> None:
        """Append advice to the first note."""
        first, *others = self.notes
        self._notes = (Note(first.element, first.status, f"{first.detail}: {what}"), *others)

    @property
    def state(self) -> State:
        """State of the tick; the plain numbers after pickling."""
        if self._state is None:
            robot = self._live().robot
            latest = self.count == self._live().guards.count and robot.current is None
            self._state = (robot.state if latest else robot.past)(*self._layout.state(self.record))
        return self._state

    @property
    def line(self) -> Line | None:
        """Line with the rows of the tick: the session's, or during a change of stack one of the blended ones; None once
        pickled."""
        return self._line

    @property
    def counters(self) -> Counters:
        """Counters of the session, up to its latest tick."""
        return self._live().counters

    @property
    def refused(self) -> bool:
        """True if the state was not valid."""
        if self.status is Status.STOPPED:
            return any(note.status is Status.INVALID_STATE for note in self.notes)
        return self.status is Status.INVALID_STATE

    @property
    def jump(self) -> Jump:
        """The largest change of the command since the tick before."""
        names, change = self._compared
        i = int(np.abs(change).argmax()) if change.size else 0
        return Jump(names[i], float(change[i])) if change.size else Jump("", 0.0)

    @property
    def _compared(self) -> tuple[tuple[str, ...], Vec]:
        """Names of the motors, and the change of their command."""
        if self._change is None:
            line = self._live()
            self._change = line.robot.joint_names, self.command - line.program.command(self.before)
        return self._change

    def explain(self) -> Explanation:
        """Explain the residual of each element by the elements that it lost to; raises HqpError after another step."""
        return self._live().explain(self)

    def account(self) -> TickAccount:
        """Account in microseconds for which element holds back which, so that a history can be kept; as ``explain``."""
        return self._live().account(self)

    def conflict(self) -> Conflict:
        """Return conflicting rows of ``subject_to`` with the least relaxation of each; as ``explain``."""
        return self._live().conflict(self)

    def way_out(self) -> Vec | None:
        """A posture ``(nq,)`` that meets a stuck task, None without one: a note names the task and its error.

        A task is stuck if it is off and at rest for half a second although such a posture is known.  The session does
        not move there by itself: use ``Posture.at(robot.state(q).angles[...])`` in a level above, or a motion planner.
        """
        return next((note.posture for note in self.notes if isinstance(note, Stuck)), None)

    def advance(self) -> tuple[Vec, Vec]:
        """Return (q, v) one period later for exact execution of the command (Mistry 2008, eqs. 19 to 22).

        Raises HqpError if there is no start: the state of the tick is not valid, or too large.
        """
        line = self._live()
        refused = self.refused
        if not refused and not self._blended and (moved := self._layout.moved(self.record)) is not None:
            return moved
        state = self.state
        if not state.valid:
            raise HqpError(f"cannot advance from an invalid state: {state.fault}")
        if refused and (fault := line.native.too_large(state.q, state.v, state.angles)):
            raise HqpError(f"cannot advance from an invalid state: {fault}")
        if self.count == line.guards.count:
            line.program.took(state, ())
        return line.program.advance(state, self.x)

    def unwrap(self) -> Vec:
        """The command if the status is ``solved``; raises NotSolved with a copy of the problem otherwise."""
        if not self.status.solved:
            detail = "; ".join(f"{n.element}: {n.detail}" for n in self.notes)
            problem = None if self._line is None else self._line.problem.copy()
            raise NotSolved(f"{self.status.name}: {self.status.value}" + (f" ({detail})" if detail else ""), problem)
        return self.command

    def _live(self) -> Line:
        if self._line is None:
            raise HqpError("a pickled tick has no session: call explain() before pickling and pickle its result")
        return self._line

    def __getstate__(self) -> dict[str, Any]:
        plain = {"_line": None, "_layout": None, "_record": None, "_before": None, "_began": 0.0, "_blended": False}
        made = {"_x": self.x.copy(), "_command": self.command, "_notes": self.notes, "_times": self.times}
        made |= {"_solution": self.solution, "_change": self._compared, "_state": self.state}
        kept = {name: getattr(self, name) for name in ("count", "event", "held", "phase", "status", "transition")}
        return {**plain, **made, **kept}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        for name, value in kept.items():
            setattr(self, name, value)

    def __repr__(self) -> str:
        held = f", held for {self.held} ticks" if self.held else ""
        return f"<Tick {self.status.name}, {len(self.notes)} notes{held}>"
