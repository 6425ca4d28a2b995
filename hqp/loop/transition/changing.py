"""A session changes its stack: at once, or by ticks between two stacks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError, DynamicsFailed
from hqp.explanation.notes import Note, Notes, added, made, of_native
from hqp.loop.compiled import Compiler
from hqp.loop.references import refuse
from hqp.loop.stepping import held_tick
from hqp.loop.tick import Tick
from hqp.loop.transition.blend import Transition, surviving
from hqp.loop.transition.waypoints import Waypoint, bearing
from hqp.problem import Status
from hqp.programs.direct import Direct

if TYPE_CHECKING:
    from hqp.loop.line import Line

DEEPEST = 3
"""Transitions that may be under way at a time."""


def change(line: Line, compiler: Compiler, stack: Stack, over: float) -> Line:
    """The line of another stack, which takes over at once or within ``over`` seconds at least."""
    if not isinstance(over, (int, float)) or not 0.0 <= over < math.inf:
        raise DeclarationError("change", "duration over", value=over, unit="s", allowed="0 or above")
    latest, under_way = line.latest, line.transition
    ordinary = latest is not None and not Direct.staged(latest)
    last = line.last_references
    line.leave_direct()
    if under_way is not None:
        for each in under_way.pair:
            each.leave_direct()
            each.stay_general()
    points = compiler.way(line.compiled, stack) if over else [Waypoint(stack)]
    compiled = [compiler.compile(point.stack) for point in points]
    holds = surviving(line.stack, line.references.holds, compiled[-1].stack)
    found = line.successor(compiled[-1], holds)
    if not over:
        return found
    direct, others = line.direct, [line.successor(item, line.references.holds) for item in compiled[1:]]
    lines = [each.stand_aside() for each in (line, *others)]
    if under_way is None and len({id(each.program) for each in lines}) == len(lines):
        for each in lines:  # each with rows and a solver of its own: ordinary ticks in one native call
            each.direct_known = False
        line.direct, line.direct_known = direct, direct is not None
    elif under_way is not None and under_way.depth >= DEEPEST:
        line.transition = None  # so many changes at a time: the oldest ones end here
    named = last if under_way is None else under_way.last_references
    found.transition = Transition(lines, points, over, line.dt, line.program.kind, ordinary=ordinary, given=named)
    return found


def blended(
    line: Line, transition: Transition, state: State, references: tuple[Reference, ...], now: float | None
) -> Tick:
    """A tick between two stacks: both are solved, their answers blended."""
    transition.feel(references, line.robot)
    first, second = transition.pair
    names = [getattr(reference, "name", "") for reference in references]
    if not transition.names.issuperset(names):
        stranger = next(r for r, name in zip(references, names, strict=True) if name not in transition.names)
        refuse(stranger, [element.name for element in line.stack])
    if not second.references.current:
        begin(transition, first, second, state)
    # each keeps the last x of its own: limits that stand around it (a window on acceleration) then bound how fast
    # its answer moves, not how far it may be from the blend
    second.contacts = line.contacts
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
    if a.held or b.held:
        return held(line, second, state, b if b.held else a, transition.progress)
    last = line.x
    x, reach = transition.blend(a.x, b.x, last, line.guards.joints, h)
    told: Notes = ()
    status = Status.OPTIMAL
    if waits or not plain(a) or not plain(b):
        told, status = notes_of(a, b, waits), Status.worst(a.status, b.status)
    if waits:  # the contact is still there: so are the dynamics of the first stack
        second, b, status = first, a, a.status
    limited: tuple[Note, ...] = ()
    if reach > transition.most:
        limited = of_native(second.outgoing.limit(line.guards.gradual, last, x))
    if line.limiter is not None:
        limited += of_native(second.outgoing.limit(line.limiter, last, x))
    if limited:
        transition.clipped()
        status = Status.worst(status, *(note.status for note in limited))
        told = added(told, limited)
    line.send(x, state)
    b.follow(x, last, told, status, transition.progress)
    if transition.done:
        for each in (first, second):
            each.leave_direct()
            each.stop_easing()
        line.take_over(second)
    else:
        transition.advance()
    return b


def begin(transition: Transition, first: Line, second: Line, state: State) -> None:
    """The first tick of a pair: hold values of the second stack, its eased tasks, and its native loop."""
    ease = transition.ease
    if ease is not None:
        eased = second if ease.second else first
        eased.ease = ease
        if eased.direct is not None:
            eased.direct.before_solving(ease)
    first.take_renewed()
    second.references.holds = surviving(first.stack, first.references.holds, second.stack)
    if second.direct_known or not state.valid or second.good is None:
        return
    try:
        second.program.prepare(state)
        second.references.take_holds(second.stack, state)
    except (DynamicsFailed, np.linalg.LinAlgError):  # the general path tells
        return
    second.find_direct()
    second.direct_known = second.direct is not None  # else after a tick


def held(line: Line, second: Line, state: State, worst: Tick, progress: float) -> Tick:
    """A tick in which one of the two stacks has no usable answer."""
    line.rest = second.rest  # of the contacts that the robot stands on now
    tick = held_tick(line, state, worst.solution, worst.notes, fit=worst.fit)
    tick.take_place_of(worst, progress)
    return tick


def plain(tick: Tick) -> bool:
    """Whether there is nothing to tell of an optimum that was one native call."""
    return tick.native and not tick.unread and tick.status is Status.OPTIMAL


def notes_of(a: Tick, b: Tick, waits: tuple[Note, ...]) -> Notes:
    """Notes on both stacks, or on the first one and on what waits; texts that are not made yet are made when read."""
    first, second = a.unread, b.unread
    if waits or not second:
        return added(first, waits)

    def notes() -> tuple[Note, ...]:
        known = made(first)
        return (*known, *(note for note in made(second) if note not in known))

    return notes if callable(first) or callable(second) else notes()


def beside(line: Line, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
    """A tick of one of two stacks, with the references that are its own."""
    return line.step(state, tuple([r for r in references if r.name in line]), now)
