"""A tick on the general path: rows, solver, safe command, each failure told by a status."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from time import monotonic, perf_counter, thread_time
from typing import TYPE_CHECKING

import numpy as np

from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.errors import DynamicsFailed, ModelError
from hqp.explanation.notes import Note, Notes
from hqp.explanation.questions import restless_notes
from hqp.loop.late import late
from hqp.loop.outgoing import culprits, largest_change, within_rates
from hqp.loop.tick import Tick, Times
from hqp.problem import Solution, Status

if TYPE_CHECKING:
    from hqp.loop.line import Line


def step(line: Line, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
    """A tick, whatever comes in; raises ModelError for a state of another robot."""
    start = perf_counter()
    if line.limit is not None:
        line.budget.begin(thread_time())
    line.leave_direct()
    if state.robot is not line.robot:
        raise ModelError(f"the session runs on {line.robot!r}, the state belongs to {state.robot!r}")
    if line.check.ages and now is None:
        now = monotonic()
    fault = line.check.fault(state, now)
    if fault:
        return held_tick(line, state, None, (Note("state", Status.INVALID_STATE, fault),), fit=False)
    program, asked = line.program, line.references
    out, notes = line.presence.supported(line.presence.of(line.guards.phase, references))
    stays = notes
    try:
        if program.out != out:
            program.go_without(out)
        program.prepare(state)
        if out is not line.presence.now:
            line.attend(out, state)
        if not asked.current or asked.without:
            asked.take_holds(line.stack, state)
        prepared = perf_counter()
        state.commanded = line.x if line.velocity and line.good is not None else None
        if out:
            references = tuple([r for r in references if getattr(r, "name", None) not in out])
        if references or asked.given:
            asked.apply(references)
        program.fill(state, asked.current, asked.given)
        unusable = program.unusable()
        if asked.without:
            unusable = tuple(dict.fromkeys(unusable + asked.lacking()))
        if unusable:
            notes = stays + asked.repair(program, line.hard, state, unusable)
    except (DynamicsFailed, np.linalg.LinAlgError) as error:
        return held_tick(line, state, None, (Note("robot", Status.DYNAMICS_FAILED, str(error)),), fit=False)
    if line.ease is not None:
        line.ease()
    filled = perf_counter()
    if line.limit is not None:  # what comes before the first answer is done for the first time, and slow
        line.limit(line.budget.left(0.0 if line.good is None else filled - start))
    solution = line.workspace.solve(program.problem)
    tick = conclude(line, state, solution, notes, start, prepared, filled)
    if not line.direct_known and line.good is not None:
        line.find_direct()
    return tick


def conclude(
    line: Line,
    state: State,
    solution: Solution,
    notes: tuple[Note, ...],
    start: float,
    prepared: float,
    filled: float,
) -> Tick:
    """The command of a solution, or what is sent where it is not usable; the rest: when which part began."""
    program, solved = line.program, perf_counter()
    x, status = solution.x, solution.status
    if status is not Status.OPTIMAL:
        notes += culprits(program, line.robot, solution)
        if not status.usable or not float(x.dot(x)) < math.inf:
            return held_tick(line, state, solution, notes, fit=True)
        if not status.solved and status is not Status.NOT_STRICT:
            most = math.inf if line.good is None else largest_change(program.kind, line.dt)
            ahead = np.empty(x.size)
            line.trend.after(line.x, line.guards.count, ahead)
            x = late(program.problem, x, line.x, ahead, line.guards.motors, most)
    elif not float(x.dot(x)) < math.inf:
        notes += (Note("solver", Status.NOT_CERTIFIED, "the answer is not finite"),)
        return held_tick(line, state, solution, notes, fit=True)
    later: list[Callable[[], tuple[Note, ...]]] = []  # all OPTIMAL: their texts are made when they are read
    if solution.stage_points is not None:
        w = np.concatenate(solution.residuals)
        if held_back := line.teller.held_back(line.guards.count, w, solution.x, line.names):
            later.append(held_back)
    if restless := line.limits.look(solution.active, line.guards.count):
        later.append(partial(restless_notes, restless))
    if line.limits.meet:
        v = line.x if line.velocity and line.good is not None else state.v
        later.append(partial(line.limits.overrun_notes, state, v))
    if line.contacts.missing:
        notes += tuple(Note(name, Status.CONTACT_LOST, why) for name, why in line.contacts.lost())
    if line.guards.first:
        notes, line.guards.first = notes + line.guards.first, ()
    if line.limiter is not None:
        x, notes = within_rates(line.limiter, x, line.x, notes, line.program, line.robot)
    last = line.send(x.copy(), state)
    if not solution.status.cut:
        line.trend.take(line.x, line.guards.count)
    for note in notes:
        status = status if note.status.severity <= status.severity else note.status
    end = perf_counter()
    if line.limit is not None:
        line.budget.end(thread_time(), solution.status is Status.TIME_LIMIT)
    times = Times(prepared - start, filled - prepared, solved - filled, end - solved)
    told: Notes = (lambda: (*notes, *(note for make in later for note in make()))) if later else notes
    return Tick(line, state, last, None, times, solution, line.x, status, told)


def held_tick(line: Line, state: State, solution: Solution | None, notes: tuple[Note, ...], *, fit: bool) -> Tick:
    """No answer is usable: the command comes to rest.  fit: whether this state is one to start from."""
    start, line.held = perf_counter(), line.held + 1
    line.trend.forget()
    if fit or line.held == 1:
        line.rest.begin(state if fit else line.last_good, line.x, now=fit)
    if line.good is None and not fit:
        notes += (Note("session", notes[0].status, "no good state so far: the command is zero"),)
    x = line.rest.next()
    if line.limiter is not None:
        x, notes = within_rates(line.limiter, x, line.x, notes, line.program, line.robot)
    last = line.send(x)
    status = Status.worst(*(note.status for note in notes))
    times = Times(0.0, 0.0, 0.0, perf_counter() - start)
    return Tick(line, state, last, None, times, solution, x, status, notes, line.held, fit)
