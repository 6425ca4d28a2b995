"""Ticks that are one native call: what they can tell is computed when asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import FLOAT, Vec
from hqp.explanation.questions import restless_notes
from hqp.loop.stepping import conclude
from hqp.problem import Solution, Status
from hqp.reference import Reference
from hqp.tick import Note, Notes, Tick, Times, added

if TYPE_CHECKING:
    from hqp.formulation import Program
    from hqp.loop.direct import Direct
    from hqp.robot import State
    from hqp.session import Session


_new = object.__new__


class OrdinaryTick(Tick):
    """A tick whose answer is the optimum, with few notes; what it can tell is computed when asked for."""

    __slots__ = ("_before", "_command", "_direct", "_noted", "_record", "_solution", "_start")

    status = Status.OPTIMAL
    held = 0
    fit = True
    transition = 1.0

    def __init__(
        self,
        session: Session,
        direct: Direct,
        state: State,
        record: bytearray,
        before: bytearray | Vec,
        start: float,
    ) -> None:
        self._session, self._direct, self._state, self._count = session, direct, state, session.count
        self._record, self._before, self._start = record, before, start
        self._noted: Notes = ()
        self._command: Vec | None = None
        self._solution: Solution | None = None

    @property
    def _notes(self) -> tuple[Note, ...]:  # type: ignore[override]
        """Levels that a price keeps from being met, and joints whose command alternates between its limits."""
        if callable(self._noted):
            self._noted = self._noted()
        return self._noted

    def note(self, notes: Notes) -> None:
        """Give the tick notes."""
        self._noted = notes

    def add(self, note: Note) -> None:
        """One note more."""
        self._noted = added(self._noted, (note,))

    @property
    def finished(self) -> bool:
        """The solver came to its end."""
        return True

    @property
    def command(self) -> Vec:  # type: ignore[override]
        """The command ``(n_actuated,)``, the caller's own copy."""
        if self._command is None:
            self._command = np.frombuffer(self._record, FLOAT, self._direct.width)
        return self._command

    @property
    def solution(self) -> Solution:  # type: ignore[override]
        """What the solver gave."""
        if self._solution is None:
            self._solution = self._direct.solution(self._record)
        return self._solution

    @property
    def times(self) -> Times:  # type: ignore[override]
        """Where the time went, but for what it took to make this object."""
        begin, rows, solve = self._direct.seconds(self._record)
        return Times(begin - self._start, rows, solve, 0.0)

    @property
    def x(self) -> Vec:  # type: ignore[override]
        """The answer that the command is part of, read-only."""
        return self._direct.x(self._record)

    @property
    def program(self) -> Program | None:  # type: ignore[override]
        """The compiled stack of the session."""
        return None if self._session is None else self._session.program

    @property
    def _last(self) -> Vec:  # type: ignore[override]
        before = self._before
        x = self._direct.x(before) if isinstance(before, bytearray) else before
        return self._live().program.command(x)

    @property
    def _names(self) -> tuple[str, ...]:  # type: ignore[override]
        return self._live().robot.joint_names

    def _solved(self) -> tuple[Vec, Vec, bool]:
        direct, record = self._direct, self._record
        return direct.slacks(record), direct.x(record), direct.staged(record)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled, it is a Tick as any other."""
        kept = {name: getattr(self, name) for name in Tick.__slots__ if name != "_session"}
        return _restored, ({**kept, "_notes": self.notes, "x": self.x.copy(), "program": None, "_session": None},)


class BlendedTick(OrdinaryTick):
    """An ordinary tick in a transition: what one stack's solver gave, another command, notes and status of both."""

    __slots__ = ("_blend", "_told")

    def __init__(
        self,
        tick: OrdinaryTick,
        x: Vec,
        last: Vec,
        transition: float,
        told: Notes = (),
        status: Status = Status.OPTIMAL,
    ) -> None:
        self._session, self._direct, self._state, self._count = tick._session, tick._direct, tick._state, tick._count
        self._record, self._before, self._start = tick._record, tick._before, tick._start
        self._noted, self._command, self._solution = (), None, None
        self._blend = x, last, transition, status
        self._told = told

    @property
    def status(self) -> Status:  # type: ignore[override]
        """The worst of the two stacks."""
        return self._blend[3]

    @property
    def notes(self) -> tuple[Note, ...]:
        """Those of both stacks."""
        if callable(self._told):
            self._told = self._told()
        return self._told

    @property
    def _notes(self) -> Notes:  # type: ignore[override]
        return self._told

    def add(self, note: Note) -> None:
        """One note more."""
        self._told = added(self._told, (note,))

    @property
    def command(self) -> Vec:  # type: ignore[override]
        """The command ``(n_actuated,)``, the caller's own copy."""
        if self._command is None:
            self._command = self._live().program.command(self._blend[0])
        return self._command

    @property
    def x(self) -> Vec:  # type: ignore[override]
        """The answer that the command is part of, read-only."""
        return self._blend[0]

    @property
    def transition(self) -> float:  # type: ignore[override]
        """How far the change of stack has come."""
        return self._blend[2]

    @property
    def _last(self) -> Vec:  # type: ignore[override]
        return self._live().program.command(self._blend[1])


def _restored(kept: dict[str, Any]) -> Tick:
    tick = Tick.__new__(Tick)
    tick.__setstate__(kept)
    return tick


def ordinary_tick(session: Session, direct: Direct, state: State, references: tuple[Reference, ...]) -> Tick | None:
    """A tick in one native call; None for what is out of the ordinary, which the general path tells."""
    start = perf_counter()
    robot = session.robot
    if state.robot is not robot or robot.current is not state or direct.workspace is not session.workspace:
        return None
    if not state.valid or (state.square >= session._check.ordinary and session._check.fault(state, None)):
        return None
    limit = session._limit if direct.fresh else None
    if limit is not None:
        session._budget.begin()
    if direct.prepare is not None:
        direct.prepare(state)
    if limit is not None:
        limit(session._budget.left(perf_counter() - start))
    if direct.writes:  # rows of the user's own may take any time
        direct.after_writing = partial(give, session, start)
    before = session._x if session._latest is None else session._latest
    found = direct.step(state, references, before)
    if found is None:
        return None
    if isinstance(found, tuple):
        session._leave_direct()
        session.count += 1
        if limit is None:
            session._budget.skip()
        solution = session.workspace.answer(session.program.problem, found)  # type: ignore[attr-defined]
        return conclude(session, state, solution, (), start, start, start)
    session.count += 1
    session._earlier = session._latest
    session._latest, session._good, session._held = found, state, 0
    if session._status is not Status.OPTIMAL:
        session._log(Status.OPTIMAL, ())
    tick = _new(OrdinaryTick)
    tick.__init__(session, direct, state, found, before, start)  # type: ignore[misc]  # OrdinaryTick() costs more
    if found[-1] or session._limits.busy:
        note(session, tick, direct, found, references)
    return tick


def give(session: Session, start: float) -> None:
    """Give the solver what is left of a tick that began at ``start``."""
    if session._limit is not None:
        session._limit(session._budget.left(perf_counter() - start))


def note(
    session: Session, tick: OrdinaryTick, direct: Direct, found: bytearray, references: tuple[Reference, ...]
) -> None:
    """Notes of an ordinary tick: levels that a stage keeps from being met, and restless joints."""
    later: Callable[[], tuple[Note, ...]] | None = None
    if direct.staged(found):
        later = session._teller.held_back(session.count, direct.slacks(found), direct.x(found), references)
    limits, state, before = session._limits, tick.state, tick._before
    restless = limits.record(found, direct.marks, session.count)
    if not restless and not limits.meet:
        if later is not None:
            tick.note(later)
        return
    v = state.v
    if session._velocity:
        v = direct.x(before) if isinstance(before, bytearray) else before

    def told() -> tuple[Note, ...]:
        return (*(later() if later is not None else ()), *restless_notes(restless), *limits.overrun_notes(state, v))

    tick.note(told)
