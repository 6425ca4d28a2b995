"""A session changes its stack: at once, or by ticks of two stacks whose answers are blended.

hqp/cpp/session/transition.hpp has the order of such a tick and its equations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import FLOAT, Vec
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.declare.stack import Stack
from hqp.explanation.notes import STATUSES, Note, Notes, added, made, of_native
from hqp.loop.compiled import Compiled, Compiler
from hqp.loop.guards import refuse
from hqp.loop.tick import Tick
from hqp.loop.way import Waypoint, surviving_holds, way_parts
from hqp.numbers import number
from hqp.programs.envelope import native

if TYPE_CHECKING:
    from hqp import _session
    from hqp.loop.line import Line


Told = tuple[str, int, str]
"""A note: element, number of the status, text."""


def change(line: Line, compiler: Compiler, stack: Stack, over: float) -> Line:
    """The line of another stack, which takes over at once or within ``over`` seconds at least."""
    over = number("change", "over", over, 0.0, unit="s")
    points = compiler.way(line.compiled, stack) if over else [Waypoint(line.stack), Waypoint(stack)]
    compiled = [line.compiled, *(compiler.compile(point.stack) for point in points[1:])]
    holds = line.holds
    lines = [_successor(line, item, surviving_holds(line.stack, holds, item.stack)) for item in compiled[1:]]
    if over:
        if line.transition is not None and line.transition.depth >= native.Transition.DEEPEST:
            line.transition.end(line)  # too many changes at a time: the oldest ones end here
        lines[-1].transition = Transition([line, *lines[:-1]], lines[-1], points, over)
    return lines[-1]


def _successor(line: Line, compiled: Compiled, holds: Mapping[str, Reference]) -> Line:
    """Line of another stack that continues from this one."""
    return type(line)(line.guards, compiled, holds, line)


class Transition:
    """The lines of the stacks on the way, and the native transition that steps them."""

    def __init__(self, lines: Sequence[Line], last: Line, path: Sequence[Waypoint], over: float) -> None:
        """lines: without the last one, which has this object."""
        self.lines: list[Line] = list(lines)
        first, every = lines[0], (*lines, last)
        way = way_parts(path, [line.compiled for line in every], last.robot)
        inner = None if first.transition is None else first.transition.native
        self._here: list[str] = way["here"]
        sessions = [line.native for line in every]
        self.native: _session.Transition = native.Transition(sessions, way, over / last.dt, inner, self)
        first.lasting = True
        self.names: frozenset[str] = frozenset(e.name for line in every for e in line.stack)
        """Elements of all blended stacks, but for those of transitions under way."""
        self.latest: bytearray | None = first.latest if first.transition is None else first.transition.latest
        """Record of the last command."""
        self.tick: Tick | None = None
        self._every: tuple[Line, ...] = ()
        self._ticks: dict[int, Tick] = {}
        self._given: tuple[State, tuple[Reference, ...]] | None = None
        self._began, self._ended = 0.0, False

    @property
    def depth(self) -> int:
        """Number of transitions under way, this one included."""
        return self.native.depth

    def __contains__(self, name: str) -> bool:
        return name in self.names or (self.lines[0].transition is not None and name in self.lines[0].transition)

    def step(self, line: Line, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
        """A tick between two stacks; line: the last one."""
        stranger = next((r for r in references if getattr(r, "name", "") not in self), None)
        if stranger is not None:
            refuse(stranger, [element.name for element in line.stack])
        try:
            self._enter(line, state, references)
            placed = all(each.compiled.placed for each in self._every)
            if not placed and state.valid:
                line.program.prepare(state)
            angles = None if placed or not state.valid else state.angles
            fault = None if state.valid else state.fault
            self.native.step(state.q, state.v, state.time, line.guards.now(now), angles, fault)
        finally:
            self._leave()
        tick, self.tick = self.tick, None  # it refers to the line, and the line to this
        assert tick is not None
        if self._ended:
            line.take_over(tick)
        return tick

    def _enter(self, line: Line, state: State, references: tuple[Reference, ...]) -> None:
        """Give every stack its own references."""
        self._every, self._given = (*self.lines, line), (state, references)
        first = self.lines[0]
        if first.transition is not None:
            first.transition._enter(first, state, references)
        for each in self._every[first.transition is not None :]:
            each.take_references(tuple([r for r in references if r.name in each.stack]))
        for reference in references:
            if reference.load is not None:
                self.native.measure(reference.name, reference.load)

    def _leave(self) -> None:
        first = self.lines[0]
        if first.transition is not None:
            first.transition._leave()
            first.transition.tick = None
            if first.transition._ended:
                first.transition = None
        self._every, self._given = (), None
        self._ticks.clear()

    def begin(self, line: Line, command: Vec, state: State | None) -> None:
        """Start all stacks from the present command; line: the last one, which has begun."""
        for each in self.lines:
            each.begin(command, state)
        self.native.begin()
        self.latest = line.latest

    def end(self, line: Line) -> None:
        """Let the last line continue alone from the last command."""
        self.native.end()
        line.latest, line.transition, line.lasting = self.latest, None, False

    # called by the native transition, with indices of lines

    def begins(self, first: int, second: int, arriving: bool) -> None:
        """A pair begins: elements that native code does not know take over hold values and references."""
        before, after = self._every[first], self._every[second]
        after.inherit(self._every[0])
        after.inherit(before)
        before.callbacks.here = frozenset(self._here) & before.callbacks.names if first == 0 else frozenset()
        after.lasting = after.lasting or not arriving
        if after.lasting:
            after.named = before.last_references

    def before(self, k: int) -> None:
        """A tick of that line begins."""
        assert self._given is not None
        state, references = self._given
        self._began, line = perf_counter(), self._every[k]
        line.ready(state, tuple([r for r in references if r.name in line.stack]))

    def after(self, k: int, record: object) -> None:
        """A tick of that line ends."""
        assert self._given is not None
        self._ticks[k] = self._every[k].answered(record, self._given[0], self._began)

    def sent(
        self,
        pair: tuple[int, int],
        stands: int,
        x: bytes,
        status: int,
        waits: Sequence[Told],
        limited: Sequence[Told],
        held: int,
        done: bool,
    ) -> None:
        """Send the tick of the line that represents the blend, with another x, status and notes."""
        a, b = (self._tick(k) for k in pair)
        tick = a if stands == pair[0] else b
        notes = tuple(n for n in tick.notes if n.element != "session") if held else notes_of(a, b, waits)
        if limited:
            notes = added(notes, of_native(limited))
        line = self._every[-1]
        last = a.before if self.latest is None else line.layout.x(self.latest)
        tick.follow(np.frombuffer(x, FLOAT), last, notes, STATUSES[status], self.native.progress)
        tick.held = held
        self.latest, self.tick, self._ended = tick.record, tick, done

    def _tick(self, k: int) -> Tick:
        inner = self.lines[0].transition if k == 0 else None
        tick = self._ticks[k] if inner is None else inner.tick
        assert tick is not None
        return tick


def notes_of(a: Tick, b: Tick, waits: Sequence[Told]) -> Notes:
    """Notes on both stacks, or on the first one and on waiting contacts; lazy texts stay lazy."""
    first, second = a.unread, b.unread
    if waits or not second:
        return added(first, of_native(waits))

    def notes() -> tuple[Note, ...]:
        known = made(first)
        return (*known, *(note for note in made(second) if note not in known))

    return notes if callable(first) or callable(second) else notes()
