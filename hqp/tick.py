"""What one step of a session gave: a command, a status, and notes that name the culprits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from hqp.arrays import Vec
from hqp.errors import HqpError, NotSolved
from hqp.explanation.words import Explanation
from hqp.problem import Solution, Status

if TYPE_CHECKING:
    from hqp.explanation.account import TickAccount
    from hqp.explanation.conflict import Conflict
    from hqp.formulation import Program
    from hqp.robot import State
    from hqp.session import Session


NO_ROWS: Vec = np.zeros(0)

Notes: TypeAlias = "tuple[Note, ...] | Callable[[], tuple[Note, ...]]"
"""Notes, or what makes them."""


@dataclass(frozen=True, slots=True)
class Note:
    """What went wrong with which element."""

    element: str
    status: Status
    detail: str


def added(notes: Notes, more: tuple[Note, ...]) -> Notes:
    """Those notes and some more, without making their texts."""
    return (lambda: (*notes(), *more)) if callable(notes) else (*notes, *more)


@dataclass(frozen=True, slots=True)
class Times:
    """Where a tick's wall time went [s]."""

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


class Tick:
    """What one step gave; plain data once pickled.

    command: ``(n_actuated,)``, in robot.joint_names order, the caller's own copy.  status: the worst of the tick.
    notes: the culprits.  solution: what the solver gave, None where it was not asked (invalid state).
    held: for how many ticks the command has been coming to rest because no answer was usable, 0 in normal operation.
    x: the answer that the command is part of, read-only.  times: where the time went.  transition: how far a change
    of stack has come, 1 where none is under way.
    """

    __slots__ = (
        "_count", "_last", "_names", "_notes", "_session", "_state",
        "command", "fit", "held", "program", "solution", "status", "times", "transition", "x",
    )  # fmt: skip

    def __init__(
        self,
        session: Session,
        state: State,
        x: Vec,
        command: Vec,
        last: Vec,
        status: Status,
        notes: Notes,
        solution: Solution | None,
        times: Times | None,
        held: int,
        fit: bool = True,
    ) -> None:
        self._session: Session | None = session
        self._state, self._count, self.x, self._last = state, session.count, x, last
        self.command, self.status, self._notes = command, status, notes
        self.solution, self.times, self.held = solution, times, held
        self.transition, self.fit = 1.0, fit
        self.program: Program | None = session.program
        self._names = session.robot.joint_names

    def follow(self, x: Vec, command: Vec, last: Vec, notes: Notes, status: Status, transition: float) -> None:
        """Take the place of the tick in a transition: another answer, status and notes of both stacks."""
        self.x, self.command, self._last, self._notes, self.transition = x, command, last, notes, transition
        self.status = status

    @property
    def notes(self) -> tuple[Note, ...]:
        """The culprits; their text is made when it is first asked for."""
        if callable(self._notes):
            self._notes = self._notes()
        return self._notes

    def add(self, note: Note) -> None:
        """One note more."""
        self._notes = added(self._notes, (note,))

    def take_place_of(self, tick: Tick) -> None:
        """Take the rows of another tick, whose solution this one has."""
        self._session, self._count, self.program = tick._session, tick._count, tick.program

    @property
    def state(self) -> State:
        """The state of the tick; of a tick that was pickled its plain numbers."""
        return self._state

    @property
    def finished(self) -> bool:
        """Whether the solver came to its end, rather than to its deadline."""
        return self.solution is not None and self.solution.status.solved

    @property
    def session(self) -> Session | None:
        """Whose rows the tick has: the session, in a transition one of those that it blends; None once pickled."""
        return self._session

    @property
    def jump(self) -> Jump:
        """The largest change of the command since the tick before."""
        change = self.command - self._last
        i = int(np.abs(change).argmax()) if change.size else 0
        return Jump(self._names[i], float(change[i])) if change.size else Jump("", 0.0)

    def explain(self) -> Explanation:
        """Which element got what and lost to which; raises HqpError once the session has taken another step."""
        return self._live().explain(self)

    def account(self) -> TickAccount:
        """Which element holds which back, in microseconds, so that a history can be kept; as ``explain``."""
        return self._live().account(self)

    def _solved(self) -> tuple[Vec, Vec, bool] | None:
        """Slacks of all rows, the solver's answer, and whether it is that of stages; None without a solution."""
        if (solution := self.solution) is None:
            return None
        return np.concatenate([*solution.residuals, NO_ROWS]), solution.x, solution.stage_points is not None

    def conflict(self) -> Conflict:
        """Which rows of ``subject_to`` exclude each other, and what each would have to give way; as ``explain``."""
        return self._live().conflict(self)

    def advance(self) -> tuple[Vec, Vec]:
        """(q, v) one period later if the command is carried out exactly (Mistry 2008, eqs. 19 to 22).

        Raises HqpError where there is nothing to start from: the state of the tick is not valid, or too large.
        """
        if not self._state.valid:
            raise HqpError(f"nothing to advance from: {self._state.fault}")
        session = self._live()
        if not self.fit and (fault := session.too_large(self._state)):
            raise HqpError(f"nothing to advance from: {fault}")
        assert self.program is not None  # a tick with a session has one
        return self.program.advance(self._state, self.x)

    def unwrap(self) -> Vec:
        """The command if the status is ``solved``; raises NotSolved with a copy of the problem otherwise."""
        if not self.status.solved:
            detail = "; ".join(f"{n.element}: {n.detail}" for n in self.notes)
            problem = None if self._session is None else self._session.problem.copy()
            raise NotSolved(f"{self.status.name}: {self.status.value}" + (f" ({detail})" if detail else ""), problem)
        return self.command

    def _live(self) -> Session:
        if self._session is None:
            raise HqpError("a tick that was pickled has no session any more; pickle what tick.explain() gives")
        return self._session

    def __getstate__(self) -> dict[str, Any]:
        kept = {name: getattr(self, name) for name in self.__slots__ if name != "_session"}
        return {
            **kept,
            "_notes": self.notes,
            "x": self.x.copy(),
            "program": None,
            "_last": self._last.copy(),
            "_session": None,
        }

    def __setstate__(self, kept: dict[str, Any]) -> None:
        for name, value in kept.items():
            setattr(self, name, value)

    def __repr__(self) -> str:
        held = f", held for {self.held} ticks" if self.held else ""
        return f"<Tick {self.status.name}, {len(self.notes)} notes{held}>"
