"""A session changes its stack: at once, or by ticks between two stacks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hqp.errors import DeclarationError, DynamicsFailed
from hqp.loop.budget import Budget
from hqp.loop.compiled import Compiled
from hqp.loop.direct import Direct
from hqp.loop.ordinary import BlendedTick, OrdinaryTick, ordinary_tick
from hqp.loop.outgoing import within_rates
from hqp.loop.references import References, refuse
from hqp.loop.stepping import held_tick
from hqp.problem import Status
from hqp.reference import Reference
from hqp.robot import State
from hqp.stack import Stack
from hqp.tick import Note, Notes, Tick, added
from hqp.transition.blend import Transition, surviving
from hqp.transition.waypoints import Waypoint, bearing

if TYPE_CHECKING:
    from hqp.session import Session

DEEPEST = 3
"""Transitions that may be under way at a time."""


def change(session: Session, stack: Stack, over: float) -> None:
    """Switch to another stack; the session is as it was where this raises."""
    if not isinstance(over, (int, float)) or not 0.0 <= over < math.inf:
        raise DeclarationError("change", "bad duration", value=over, unit="s", allowed="over >= 0")
    latest = session._latest
    ordinary = latest is not None and not Direct.staged(latest)
    session._leave_direct()
    if session._transition is not None:
        for each in session._transition.pair:
            each._leave_direct()
            stop_easing(each)
            each._direct, each._direct_known = None, True
    points = path(session, stack, over)
    compiled = [session._compiler.compile(point.stack) for point in points]
    holds = surviving(session.stack, session._references.holds, compiled[-1].stack)
    sessions = [clone(session), *(clone(session, item) for item in compiled[1:])] if over else []
    if session._transition is None and len({id(each.program) for each in sessions}) == len(sessions) > 0:
        for each in sessions:  # each with rows and a solver of its own: ordinary ticks in one native call
            each._direct_known = False
        sessions[0]._direct, sessions[0]._direct_known = session._direct, session._direct is not None
    named = session._named if session._transition is None else session._transition.last_references
    session._activate(compiled[-1], References(holds))
    kind = session.program.kind
    session._transition = (
        Transition(sessions, points, over, session.dt, kind, ordinary=ordinary, given=named) if over else None
    )


def path(session: Session, stack: Stack, over: float) -> list[Waypoint]:
    """The stacks on the way to another one."""
    if not over:
        return [Waypoint(stack)]
    law = session.controller.formulation.contact_law if session.program.kind == "torque" else None
    return session._compiler.way(session.stack, stack, law)


def clone(session: Session, compiled: Compiled | None = None) -> Session:
    """The session as it runs now, or on another stack, to go on beside it; without rate limits of its own."""
    found = object.__new__(type(session))
    found.__dict__.update(session.__dict__)
    found._limiter, found._budget = None, Budget(0.5 * session._budget.deadline)
    found._direct, found._direct_known = None, True  # side by side they go the general way
    found._references = session._references.copy()
    if compiled is not None:
        found._transition = None
        found._activate(compiled, References(found._references.holds))
        found._direct_known = True
    elif session._transition is not None and session._transition.depth >= DEEPEST:
        found._transition = None  # so many changes at a time: the oldest ones end here
    return found


def blended(
    session: Session, transition: Transition, state: State, references: tuple[Reference, ...], now: float | None
) -> Tick:
    """A tick between two stacks: both are solved, their answers blended."""
    first, second = transition.pair
    names = [getattr(reference, "name", "") for reference in references]
    if not transition.names.issuperset(names):
        stranger = next(r for r, name in zip(references, names, strict=True) if name not in transition.names)
        refuse(stranger, [element.name for element in session.stack])
    if not second._references.current:
        begin(transition, first, second, state)
    # each keeps the last x of its own: limits that stand around it (a window on acceleration) then bound how fast
    # its answer moves, not how far it may be from the blend
    second._contacts = session._contacts
    kept = transition.outgoing(references)
    here = transition.here(state, names) if transition.released_rows else ()
    ease, asked = transition.ease, (*kept, *here)
    arriving = references if transition.arriving else kept
    if ease is None or ease.second:
        a = beside(first, state, asked, now)
        waits = bearing(first.program, a.x, transition.released) if transition.released and not a.held else ()
        h = transition.target(wait=bool(waits))
        if ease is not None:
            ease.aim(a.x, h)
        b = beside(second, state, arriving, now)
    else:
        b = beside(second, state, arriving, now)
        waits, h = (), transition.target()
        ease.aim(b.x, h)
        a = beside(first, state, asked, now)
    session.count += 1
    if a.held or b.held:
        return held(session, second, state, b if b.held else a, transition.progress)
    last = session._x
    x, reach = transition.blend(a.x, b.x, last, session._joints, h)
    told: Notes = ()
    status = Status.OPTIMAL
    if waits or type(a) is not OrdinaryTick or type(b) is not OrdinaryTick or a._noted or b._noted:
        told, status = notes_of(a, b, waits), Status.worst(a.status, b.status)
    if waits:  # the contact is still there: so are the dynamics of the first stack
        second, b, status = first, a, a.status
    limited: tuple[Note, ...] = ()
    if reach > transition.cap:
        x, limited = within_rates(session._gradual, x, last, limited, second.program, session.robot, "transition")
    if session._limiter is not None:
        x, limited = within_rates(session._limiter, x, last, limited, second.program, session.robot)
    if limited:
        transition.clipped()
        status = Status.worst(status, *(note.status for note in limited))
        told = added(told, limited)
    session._send(x)
    session._good, session._held = state, 0
    if isinstance(b, OrdinaryTick):
        b = BlendedTick(b, x, last, transition.progress, told, status)
    else:
        command = second.program.command
        b.follow(x, command(x), command(last), told, status, transition.progress)
    if transition.done:
        finish(session, first, second)
    else:
        transition.advance()
    return b


def begin(transition: Transition, first: Session, second: Session, state: State) -> None:
    """The first tick of a pair: hold values of the second stack, its eased tasks, and its native loop."""
    ease = transition.ease
    if ease is not None:
        eased = second if ease.second else first
        eased._ease = ease
        if eased._direct is not None:
            eased._direct.before_solving(ease)
    second._references.holds = surviving(first.stack, first._references.holds, second.stack)
    if second._direct_known or not state.valid or second._good is None:
        return
    try:
        second.program.prepare(state)
        second._references.take_holds(second.stack, state)
    except (DynamicsFailed, np.linalg.LinAlgError):  # the general path tells
        return
    second._find_direct()
    second._direct_known = second._direct is not None  # else after a tick


def held(session: Session, second: Session, state: State, worst: Tick, progress: float) -> Tick:
    """A tick in which one of the two stacks has no usable answer."""
    session._rest = second._rest  # of the contacts that the robot stands on now
    tick = held_tick(session, state, worst.solution, worst.notes, fit=worst.fit)
    tick.take_place_of(worst)
    tick.transition = progress
    return tick


def notes_of(a: Tick, b: Tick, waits: tuple[Note, ...]) -> Notes:
    """Notes on both stacks, or on the first one and on what waits; texts that are not made yet are made when read."""
    first, second = unread(a), unread(b)
    if waits:
        return added(first, waits)
    if not callable(first) and not callable(second):
        return (*first, *(note for note in second if note not in first)) if first or second else ()

    def notes() -> tuple[Note, ...]:
        known = first() if callable(first) else first
        return (*known, *(note for note in (second() if callable(second) else second) if note not in known))

    return notes


def unread(tick: Tick) -> Notes:
    """The notes of a tick, without making their texts."""
    return tick._noted if type(tick) is OrdinaryTick else tick._notes


def stop_easing(session: Session) -> None:
    """The native loop asks for all of every task again."""
    if session._direct is not None and session._ease is not None:
        session._direct.before_solving(None)


def finish(session: Session, first: Session, second: Session) -> None:
    """The second stack has taken over: the session goes on with what its twin has made ready."""
    first._leave_direct()
    second._leave_direct()
    for each in (first, second):
        stop_easing(each)
    session._rest, session._references = second._rest, second._references
    session._limits = second._limits
    if session._limiter is None:
        session._direct, session._direct_known = second._direct, second._direct is not None
    session._transition = None  # last: an interrupt before it leaves a transition that is done


def beside(session: Session, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
    """A tick of one of two stacks, with the references that are its own."""
    known = session.stack if session._transition is None else session
    session._named = mine = tuple([r for r in references if r.name in known])
    if session._direct is not None and not session._contacts.missing:
        tick = ordinary_tick(session, session._direct, state, mine)
        if tick is not None:
            return tick
    return session._tick(state, mine, now)
