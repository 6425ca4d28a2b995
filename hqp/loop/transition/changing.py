"""A session changes its stack: at once, or by ticks between two stacks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError
from hqp.explanation.notes import Note, Notes, added, made, of_native
from hqp.loop.compiled import Compiled, Compiler
from hqp.loop.record import staged
from hqp.loop.references import refuse
from hqp.loop.tick import Tick
from hqp.loop.transition.blend import Transition, surviving
from hqp.loop.transition.waypoints import Waypoint, bearing
from hqp.problem import Status

if TYPE_CHECKING:
    from hqp.loop.line import Line

DEEPEST = 3
"""Transitions that may be under way at a time."""


def change(line: Line, compiler: Compiler, stack: Stack, over: float) -> Line:
    """The line of another stack, which takes over at once or within ``over`` seconds at least."""
    if not isinstance(over, (int, float)) or not 0.0 <= over < math.inf:
        raise DeclarationError("change", "duration over", value=over, unit="s", allowed="0 or above")
    latest, under_way = line.latest, line.transition
    ordinary = latest is not None and line.begun and line.held == 0 and not staged(latest)
    last = line.last_references
    if under_way is not None:
        for each in under_way.pair:
            each.ease(None)
    points = compiler.way(line.compiled, stack) if over else [Waypoint(stack)]
    compiled = [compiler.compile(point.stack) for point in points]
    holds = line.holds
    if not over:
        return successor(line, compiled[-1], surviving(line.stack, holds, compiled[-1].stack))
    lines = [line, *(successor(line, item, holds) for item in compiled[1:])]
    for each in lines:
        each.native.aside()
    if under_way is not None:
        under_way.within = True
    if under_way is not None and under_way.depth >= DEEPEST:
        line.transition = None  # so many changes at a time: the oldest ones end here
    named = last if under_way is None else under_way.last_references
    found = successor(line, compiled[-1], surviving(line.stack, holds, compiled[-1].stack))
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
    if not second.begun and not transition.taken:
        begin(transition, first, second)
    # each keeps the last x of its own: limits that stand around it (a window on acceleration) then bound how fast
    # its answer moves, not how far it may be from the blend
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
    line.named = references
    if a.held or b.held:
        return held(line, second, state, b if b.held else a, transition.progress)
    last = line.x if line.latest is not None else a.before
    x, reach = transition.blend(a.x, b.x, last, line.guards.joints, h)
    told: Notes = ()
    status = Status.OPTIMAL
    if waits or not plain(a) or not plain(b):
        told, status = notes_of(a, b, waits), Status.worst(a.status, b.status)
    if waits:  # the contact is still there: so are the dynamics of the first stack
        second, b, status = first, a, a.status
    limited: tuple[Note, ...] = ()
    if reach > transition.most:
        limited = of_native(second.native.limit(line.guards.gradual, last, x))
    if line.guards.limiter is not None:
        limited += of_native(second.native.limit(line.guards.limiter, last, x))
    if limited:
        transition.clipped()
        status = Status.worst(status, *(note.status for note in limited))
        told = added(told, limited)
    b.follow(x, last, told, status, transition.progress)
    line.latest, line.held, line.good = b.record, 0, True
    if transition.done:
        for each in (first, second):
            each.ease(None)
        line.take_over(second, beside=transition.within)
    else:
        transition.advance()
    return b


def begin(transition: Transition, first: Line, second: Line) -> None:
    """The first tick of a pair: hold values of the second stack, and its eased tasks."""
    transition.taken = True
    ease = transition.ease
    if ease is not None:
        (second if ease.second else first).ease(ease)
    second.hold(surviving(first.stack, first.holds, second.stack))


def held(line: Line, second: Line, state: State, worst: Tick, progress: float) -> Tick:
    """A tick in which one of the two stacks has no usable answer."""
    line.held += 1
    fit = not any(note.status in (Status.INVALID_STATE, Status.DYNAMICS_FAILED) for note in worst.notes)
    last = line.x if line.latest is not None else worst.before
    x, notes = second.native.rest(last, line.good, line.held, fit, worst.status.severity)
    told = tuple(note for note in worst.notes if note.element != "session")
    worst.follow(np.array(x), last, (*told, *of_native(notes)), worst.status, progress)
    worst.held = line.held
    line.latest = worst.record
    return worst


def plain(tick: Tick) -> bool:
    """Whether there is nothing to tell of an optimum."""
    return not tick.unread and tick.status is Status.OPTIMAL


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


def successor(line: Line, compiled: Compiled, holds: Mapping[str, Reference]) -> Line:
    """A line of another stack that goes on where this one is."""
    return type(line)(line.guards, compiled, holds, line)
