"""A tick: what comes in is checked, rows, solver, safe command; each failure is told by a status."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from time import monotonic, perf_counter, thread_time
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import FLOAT, Mat, Vec
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.errors import DeclarationError, DynamicsFailed, ModelError
from hqp.explanation.notes import Note, made, of_native
from hqp.loop.tick import NO_ROWS, Tick, Times
from hqp.problem import Solution, Status

if TYPE_CHECKING:
    from hqp.loop.line import Line
    from hqp.programs.direct import Counts, Direct
    from hqp.programs.rest import Start

_new = object.__new__


def step(line: Line, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
    """A tick, whatever comes in; raises ModelError for a state of another robot."""
    start = perf_counter()
    direct = None if line.contacts.missing else line.direct
    robot, check, presence = line.robot, line.check, line.presence
    try:
        same = state.robot is robot
    except AttributeError:
        raise DeclarationError("step", "not a State", value=state, allowed="robot.state(q, v)") from None
    if not same:
        raise ModelError(
            f"the state belongs to {state.robot!r}, the session runs on {robot!r}: use robot.state(q, v) of the latter"
        )
    if not state.valid or check.ages or state.square >= check.ordinary:
        fault = check.fault(state, monotonic() if check.ages and now is None else now)
        if fault:
            line.leave_direct()
            return held_tick(line, state, None, (Note("state", Status.INVALID_STATE, fault),), fit=False)
    if line.guards.laws is not None:
        line.compiled.laws.obey(line.guards, presence.now)
    out = presence.of(line.guards.phase, references)
    limit = None  # of native ticks the first one says it
    if direct is None or direct.fresh or out is not presence.now:
        limit = line.limit
        if limit is not None:
            line.budget.begin(thread_time())
    notes: tuple[Note, ...] = ()
    changed = False
    if out is not presence.now:
        out, notes = presence.supported(out)
        changed = out is not presence.now
    if direct is not None and (notes or robot.current is not state or direct.workspace is not line.workspace):
        direct = None
    if changed:
        line.attend(out, state, direct)
        direct = direct and line.direct
    if direct is not None:
        spoken = references
        if out:
            state.out, spoken = out, presence.spoken(references, out)
        if direct.prepare is not None:
            direct.prepare(state)
        if limit is not None:
            limit(line.budget.left(perf_counter() - start))
        if direct.writes:  # rows of the user's own may take any time
            direct.after_writing = partial(give, line, start)
        before = line.x if line.latest is None else line.latest
        found = direct.step(state, spoken, before)
        if found is not None:
            return answered(line, direct, state, before, found, start, limit is not None)
    return in_python(line, state, references, out, notes, start, limit is not None)


def step_arrays(line: Line, q: Vec, v: Vec | None, targets: dict[str, Vec | Mat]) -> Tick | None:
    """The same of arrays alone, without a State and without References; None for what is out of the ordinary."""
    start, direct, presence = perf_counter(), line.direct, line.presence
    if direct is None or not direct.takes_arrays or direct.workspace is not line.workspace or line.contacts.missing:
        return None
    if presence.usual or presence.now is not presence.usual or type(q) is not np.ndarray or type(targets) is not dict:
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
    state = line.robot.state(q, v) if isinstance(found, tuple) else None
    return answered(line, direct, state, before, found, start, limit is not None)


def answered(
    line: Line,
    direct: Direct,
    state: State | None,
    before: bytearray | Vec,
    found: bytearray | Counts,
    start: float,
    measured: bool,
) -> Tick:
    """A tick whose rows and solver were one native call: the record of an optimum, or how the solver ended.

    state: None for that of the record.  measured: whether the budget knows when the tick began.
    """
    if isinstance(found, tuple):
        if not measured:
            line.budget.skip()
        line.leave_direct()
        solution = line.workspace.answer(line.program.problem, found)  # type: ignore[attr-defined]
        assert state is not None
        return conclude(line, state, solution, (), start, start, start)
    line.earlier, line.latest, line.latest_count = line.latest, found, line.guards.count
    line.good, line.held = state or (direct, found), 0
    tick = _new(Tick)
    tick.__init__(line, state, before, found, start)  # type: ignore[misc]  # Tick() costs more
    if found[-1] or line.limits.busy:
        held_back = None
        if direct.staged(found):
            slacks, x = direct.slacks(found), direct.x(found)
            held_back = line.teller.held_back(line.guards.count, slacks, x, line.names)
        remark(line, tick, held_back, line.limits.look(found, direct.marks, line.guards.count), line.velocity)
    return tick


def in_python(
    line: Line,
    state: State,
    references: tuple[Reference, ...],
    out: frozenset[str],
    notes: tuple[Note, ...],
    start: float,
    measured: bool,
) -> Tick:
    """A tick of rows and a solver of any kind, and of references that are out of the ordinary."""
    line.leave_direct()
    if line.limit is not None and not measured:
        line.budget.begin(thread_time())
    program, asked, stays = line.program, line.references, notes
    try:
        if program.out != out:
            program.go_without(out)
        program.prepare(state)
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


def give(line: Line, start: float) -> None:
    """Give the solver what is left of a tick that began at ``start``."""
    if line.limit is not None:
        line.limit(line.budget.left(perf_counter() - start))


def remark(
    line: Line,
    tick: Tick,
    held_back: Callable[[], tuple[Note, ...]] | None,
    restless: Sequence[tuple[str, int, str]],
    around: bool,
) -> None:
    """Notes on an optimum whose texts are made when they are read: levels that a stage keeps from being met, restless
    joints, limits that are passed.  around: whether limits stand around the x before, else around the velocity."""
    if not restless and not line.limits.meet:
        if held_back is not None:
            tick.add(held_back)
        return

    def told() -> tuple[Note, ...]:
        state = tick.state
        overrun = line.compiled.watched.overrun_notes(state, tick.before if around else state.v)
        return (*made(held_back or ()), *of_native(restless), *overrun)

    tick.add(told)


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
    solved, x, status = perf_counter(), np.empty(line.x.size), solution.status.severity
    staged = solution.stage_points is not None
    w = np.concatenate(solution.residuals) if status or staged else NO_ROWS
    answer = status, solution.x, w, solution.detail
    rest = line.rest.answers, partial(line.rest.start, state)
    usable, told = line.outgoing.take(answer, line.before, *rest, line.contacts, line.limiter, x)
    notes += of_native(told)
    if not usable:
        return held_tick(line, state, solution, notes, fit=True)
    held_back = line.teller.held_back(line.guards.count, w, solution.x, line.names) if staged else None
    marks = bytearray().join([each.tobytes() for each in solution.active])
    restless = line.limits.look(marks, 0, line.guards.count)
    around = line.velocity and line.good is not None
    if line.guards.first:
        notes, line.guards.first = notes + line.guards.first, ()
    last = line.send(x, state)
    end = perf_counter()
    if line.limit is not None:
        line.budget.end(thread_time(), solution.status is Status.TIME_LIMIT)
    times = Times(prepared - start, filled - prepared, solved - filled, end - solved)
    tick = Tick(line, state, last, None, times, solution, x, worst(notes), notes)
    remark(line, tick, held_back, restless, around)
    return tick


def held_tick(line: Line, state: State, solution: Solution | None, notes: tuple[Note, ...], *, fit: bool) -> Tick:
    """No answer is usable: the command comes to rest.  fit: whether this state is one to start from."""
    start, x, line.held = perf_counter(), np.empty(line.x.size), line.held + 1

    def begin() -> Start | None:
        return line.rest.start(state if fit else line.last_good)

    how = fit, line.held, worst(notes).severity
    told = line.outgoing.rest(line.rest.answers, begin, *how, line.before, line.limiter, x)
    notes += of_native(told)
    last = line.send(x)
    times = Times(0.0, 0.0, 0.0, perf_counter() - start)
    return Tick(line, state, last, None, times, solution, x, worst(notes), notes, line.held, fit)


def worst(notes: tuple[Note, ...]) -> Status:
    """Of a tick with these notes."""
    return Status.worst(*[note.status for note in notes])
