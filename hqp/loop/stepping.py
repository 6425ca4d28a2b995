"""A tick on the general path: rows, solver, safe command, each failure told by a status."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from time import monotonic, perf_counter
from typing import TYPE_CHECKING

import numpy as np

from hqp.errors import DynamicsFailed, ModelError
from hqp.explanation.questions import restless_notes
from hqp.loop.late import late
from hqp.loop.outgoing import culprits, largest_change, within_rates
from hqp.problem import Solution, Status
from hqp.reference import Reference
from hqp.robot import State
from hqp.tick import Note, Notes, Tick, Times

if TYPE_CHECKING:
    from hqp.session import Session


def step(session: Session, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
    """A tick, whatever comes in; raises ModelError for a state of another robot."""
    start = perf_counter()
    if session._limit is not None:
        session._budget.begin()
    session._leave_direct()
    session.count += 1
    if state.robot is not session.robot:
        raise ModelError(f"the session runs on {session.robot!r}, the state belongs to {state.robot!r}")
    if session._check.ages and now is None:
        now = monotonic()
    fault = session._check.fault(state, now)
    if fault:
        return held_tick(session, state, None, (Note("state", Status.INVALID_STATE, fault),), fit=False)
    program, asked = session.program, session._references
    notes: tuple[Note, ...] = ()
    try:
        program.prepare(state)
        if not asked.current or asked.without:
            asked.take_holds(session.stack, state)
        prepared = perf_counter()
        state.commanded = session._x if session._velocity and session._good is not None else None
        if references or asked.given:
            asked.apply(references)
        program.fill(state, asked.current, asked.given)
        unusable = program.unusable()
        if asked.without:
            unusable = tuple(dict.fromkeys(unusable + asked.lacking()))
        if unusable:
            notes = asked.repair(program, session._hard, state, unusable)
    except (DynamicsFailed, np.linalg.LinAlgError) as error:
        return held_tick(session, state, None, (Note("robot", Status.DYNAMICS_FAILED, str(error)),), fit=False)
    if session._ease is not None:
        session._ease()
    filled = perf_counter()
    if session._limit is not None:  # what comes before the first answer is done for the first time, and slow
        session._limit(session._budget.left(0.0 if session._good is None else filled - start))
    solution = session.workspace.solve(program.problem)
    tick = conclude(session, state, solution, notes, start, prepared, filled)
    if not session._direct_known and session._good is not None:
        session._find_direct()
    return tick


def conclude(
    session: Session,
    state: State,
    solution: Solution,
    notes: tuple[Note, ...],
    start: float,
    prepared: float,
    filled: float,
) -> Tick:
    """The command of a solution, or what is sent where it is not usable; the rest: when which part began."""
    program, solved = session.program, perf_counter()
    x, status = solution.x, solution.status
    if status is not Status.OPTIMAL:
        notes += culprits(program, session.robot, solution)
        if not status.usable or not float(x.dot(x)) < math.inf:
            return held_tick(session, state, solution, notes, fit=True)
        if not status.solved and status is not Status.NOT_STRICT:
            last = session._x
            most = math.inf if session._good is None else largest_change(program.kind, session.dt)
            x = late(program.problem, x, last, session._trend.after(last, session.count), session._joints, most)
    elif not float(x.dot(x)) < math.inf:
        notes += (Note("solver", Status.NOT_CERTIFIED, "the answer is not finite"),)
        return held_tick(session, state, solution, notes, fit=True)
    later: list[Callable[[], tuple[Note, ...]]] = []  # all OPTIMAL: their texts are made when they are read
    if solution.stage_points is not None:
        w = np.concatenate(solution.residuals)
        if held_back := session._teller.held_back(session.count, w, solution.x, session._named):
            later.append(held_back)
    if restless := session._limits.look(solution.active, session.count):
        later.append(partial(restless_notes, restless))
    if session._limits.meet:
        v = session._x if session._velocity and session._good is not None else state.v
        later.append(partial(session._limits.overrun_notes, state, v))
    if session._contacts.missing:
        notes += tuple(Note(name, Status.CONTACT_LOST, why) for name, why in session._contacts.lost())
    if session._first:
        notes, session._first = notes + session._first, ()
    if session._limiter is not None:
        x, notes = within_rates(session._limiter, x, session._x, notes, session.program, session.robot)
    last, session._good, session._held = session._send(x.copy()), state, 0
    if not solution.status.cut:
        session._trend.take(session._x, session.count)
    for note in notes:
        status = status if note.status.severity <= status.severity else note.status
    command = program.command(x)
    end = perf_counter()
    if session._limit is not None:
        session._budget.end(cut=solution.status is Status.TIME_LIMIT)
    times = Times(prepared - start, filled - prepared, solved - filled, end - solved)
    told: Notes = (lambda: (*notes, *(note for make in later for note in make()))) if later else notes
    return Tick(session, state, session._x, command, program.command(last), status, told, solution, times, 0)


def held_tick(session: Session, state: State, solution: Solution | None, notes: tuple[Note, ...], *, fit: bool) -> Tick:
    """No answer is usable: the command comes to rest.  fit: whether this state is one to start from."""
    start, session._held = perf_counter(), session._held + 1
    session._trend.forget()
    if fit or session._held == 1:
        session._rest.begin(state if fit else session._good, session._x, now=fit)
    if session._good is None and not fit:
        notes += (Note("session", notes[0].status, "no good state so far: the command is zero"),)
    x = session._rest.next()
    if session._limiter is not None:
        x, notes = within_rates(session._limiter, x, session._x, notes, session.program, session.robot)
    last = session._send(x)
    status = Status.worst(*(note.status for note in notes))
    times = Times(0.0, 0.0, 0.0, perf_counter() - start)
    command, before = session.program.command(x), session.program.command(last)
    return Tick(session, state, x, command, before, status, notes, solution, times, session._held, fit)
