"""A session changes its stack: at once, or by ticks between two stacks."""

from __future__ import annotations

import math
import threading
from typing import TYPE_CHECKING

from hqp.compiled import Compiled
from hqp.errors import DeclarationError
from hqp.outgoing import within_rates
from hqp.reference import Reference
from hqp.references import References, refuse
from hqp.robot import State
from hqp.stack import Stack
from hqp.tick import BlendedTick, OrdinaryTick, Tick
from hqp.transition import Transition, surviving
from hqp.waypoints import Waypoint, bearing
from hqp.waypoints import path as path_of

if TYPE_CHECKING:
    from hqp.session import Session

DEEPEST = 3
"""Transitions that may be under way at a time."""


def change(session: Session, stack: Stack, over: float) -> None:
    """Switch to another stack; the session is as it was where this raises."""
    if not isinstance(over, (int, float)) or not 0.0 <= over < math.inf:
        raise DeclarationError("change", "bad duration", value=over, unit="s", allowed="over >= 0")
    session._leave_direct()
    if session._transition is not None:
        for each in session._transition.pair:
            each._leave_direct()
            each._direct, each._direct_known = None, True
    points = path(session, stack, over)
    compiled = [session._compiler.compile(point.stack) for point in points]
    holds = surviving(session.stack, session._references.holds, compiled[-1].stack)
    sessions = [clone(session), *(clone(session, item) for item in compiled[1:])] if over else []
    if len(sessions) == 2 and session._transition is None and sessions[0].program is not sessions[1].program:
        for each in sessions:  # each with rows and a solver of its own: ordinary ticks in one native call
            each._direct_known = False
    session._activate(compiled[-1], References(holds))
    session._transition = Transition(sessions, points, over, session.dt, session.program.kind) if over else None


def path(session: Session, stack: Stack, over: float) -> list[Waypoint]:
    """The stacks on the way to another one."""
    if not over:
        return [Waypoint(stack)]
    law = session.controller.formulation.contact_law if session.program.kind == "torque" else None
    return path_of(session.stack, stack, session.robot, law)


def clone(session: Session, compiled: Compiled | None = None) -> Session:
    """The session as it runs now, or on another stack, to go on beside it; without rate limits of its own."""
    found = object.__new__(type(session))
    found.__dict__.update(session.__dict__)
    found._lock, found._limiter, found._deadline = threading.Lock(), None, 0.5 * session._deadline
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
    for reference in references:
        name = getattr(reference, "name", "")
        if name not in session.stack and not transition.knows(name):
            refuse(reference, [element.name for element in session.stack])
    if not second._references.current:
        second._references.holds = surviving(first.stack, first._references.holds, second.stack)
    # each keeps the last x of its own: limits that stand around it (a window on acceleration) then bound how fast
    # its answer moves, not how far it may be from the blend
    second._contacts = session._contacts
    here = transition.here(state, references) if transition.released_rows else ()
    a = beside(first, state, (*references, *here), now)
    b = beside(second, state, references, now)
    session.count += 1
    if a.held or b.held:
        worst = b if b.held else a
        session._rest = second._rest  # of the contacts that the robot stands on now
        tick = session._held_tick(state, worst.solution, worst.notes, fit=worst.fit)
        tick.take_place_of(worst)
        return tick
    last = session._x
    waits = bearing(first.program, a.x, transition.released) if transition.released else ()
    unfinished = not (a.finished and b.finished)
    x = transition.blend(a.x, b.x, last, session._joints, wait=bool(waits), unfinished=unfinished)
    notes = waits or tuple(note for note in b.notes if note not in a.notes)
    notes = (*a.notes, *notes)
    if waits:  # the contact is still there: so are the dynamics of the first stack
        second, b = first, a
    if session._limiter is not None:
        x, notes = within_rates(session._limiter, x, last, notes, second.program)
    session._x, session._good, session._held = x, state, 0
    command = second.program.command
    if type(b) is OrdinaryTick and not notes:
        b = BlendedTick(b, x, command(x), command(last), transition.progress)
    else:
        b = b.general() if isinstance(b, OrdinaryTick) else b
        b.follow(x, command(x), command(last), notes, transition.progress)
    if transition.done:
        session._transition = None
        first._leave_direct()
        second._leave_direct()
        session._rest = second._rest
        session._references = second._references
    else:
        transition.advance()
    return b


def beside(session: Session, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
    """A tick of one of two stacks, with the references that are its own."""
    session._named = mine = tuple(r for r in references if session.knows(r.name))
    if session._direct is not None and not session._contacts.missing:
        tick = session._ordinary_tick(session._direct, state, mine)
        if tick is not None:
            return tick
    return session._tick(state, mine, now)
