"""Ticks that are one native call."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter, thread_time
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import FLOAT, Mat, Vec
from hqp.declare.reference import Reference
from hqp.explanation.notes import Note
from hqp.explanation.questions import restless_notes
from hqp.loop.stepping import conclude
from hqp.loop.tick import Tick

if TYPE_CHECKING:
    from hqp.declare.robot import State
    from hqp.loop.line import Line
    from hqp.programs.direct import Counts, Direct


_new = object.__new__


def ordinary_tick(line: Line, direct: Direct, state: State, references: tuple[Reference, ...]) -> Tick | None:
    """A tick in one native call; None for what is out of the ordinary, which the general path tells."""
    start = perf_counter()
    robot = line.robot
    if state.robot is not robot or robot.current is not state or direct.workspace is not line.workspace:
        return None
    if not state.valid or (state.square >= line.check.ordinary and line.check.fault(state, None)):
        return None
    presence = line.presence
    out = presence.of(line.guards.phase, references)
    if out is not presence.now:
        if line.program.refuses(out):
            return None
        line.attend(out, state)
        if line.direct is None:
            return None
    if out:
        state.out = out
        references = presence.spoken(references, out)
    limit = line.limit if direct.fresh else None
    if limit is not None:
        line.budget.begin(thread_time())
    if direct.prepare is not None:
        direct.prepare(state)
    if limit is not None:
        limit(line.budget.left(perf_counter() - start))
    if direct.writes:  # rows of the user's own may take any time
        direct.after_writing = partial(give, line, start)
    before = line.x if line.latest is None else line.latest
    found = direct.step(state, references, before)
    if found is None:
        return None
    if isinstance(found, tuple):
        if limit is None:
            line.budget.skip()
        return unsolved(line, state, found, start)
    return solved(line, direct, state, before, found, start)


def array_tick(line: Line, direct: Direct, q: Vec, v: Vec | None, targets: dict[str, Vec | Mat]) -> Tick | None:
    """The same of arrays alone, without a State and without References."""
    start = perf_counter()
    if not direct.takes_arrays or direct.workspace is not line.workspace or type(q) is not np.ndarray:
        return None
    if line.guards.phase is not None or line.presence.now:
        return None
    if q.dtype is not FLOAT or (v is not None and (type(v) is not np.ndarray or v.dtype is not FLOAT)):
        return None
    limit = line.limit if direct.fresh else None
    if limit is not None:
        line.budget.begin(thread_time())
        limit(line.budget.left(perf_counter() - start))
    line.robot.leave()
    before = line.x if line.latest is None else line.latest
    found = direct.tick(q, v, targets, before, line.check.ordinary)
    if found is None:
        return None
    line.named = tuple(targets)
    if isinstance(found, tuple):
        if limit is None:
            line.budget.skip()
        return unsolved(line, line.robot.state(q, v), found, start)
    return solved(line, direct, None, before, found, start)


def unsolved(line: Line, state: State, found: Counts, start: float) -> Tick:
    """A tick whose outcome is no optimum."""
    line.leave_direct()
    solution = line.workspace.answer(line.program.problem, found)  # type: ignore[attr-defined]
    return conclude(line, state, solution, (), start, start, start)


def solved(
    line: Line, direct: Direct, state: State | None, before: bytearray | Vec, found: bytearray, start: float
) -> Tick:
    """A tick whose outcome is an optimum, with its record."""
    line.earlier, line.latest, line.latest_count = line.latest, found, line.guards.count
    line.good, line.held = state or (direct, found), 0
    tick = _new(Tick)
    tick.__init__(line, state, before, found, start)  # type: ignore[misc]  # Tick() costs more
    if found[-1] or line.limits.busy:
        note(line, tick, direct, found)
    return tick


def give(line: Line, start: float) -> None:
    """Give the solver what is left of a tick that began at ``start``."""
    if line.limit is not None:
        line.limit(line.budget.left(perf_counter() - start))


def note(line: Line, tick: Tick, direct: Direct, found: bytearray) -> None:
    """Notes of an ordinary tick: levels that a stage keeps from being met, and restless joints."""
    later: Callable[[], tuple[Note, ...]] | None = None
    if direct.staged(found):
        later = line.teller.held_back(line.guards.count, direct.slacks(found), direct.x(found), line.names)
    limits = line.limits
    restless = limits.record(found, direct.marks, line.guards.count)
    if not restless and not limits.meet:
        if later is not None:
            tick.note(later)
        return

    def told() -> tuple[Note, ...]:
        state = tick.state
        v = tick.before if line.velocity else state.v
        return (*(later() if later is not None else ()), *restless_notes(restless), *limits.overrun_notes(state, v))

    tick.note(told)
