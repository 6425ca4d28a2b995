"""A compiled stack in operation: its native session, latest references, and latest answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from threading import get_ident
from time import monotonic, perf_counter
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import numpy as np

from hqp.arrays import FLOAT, Mat, Vec
from hqp.declare.element import Element
from hqp.declare.law import Law
from hqp.declare.reference import Reference, copied
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError, ModelError
from hqp.explanation.counters import Counters
from hqp.explanation.notes import STATUSES, Note, of_native
from hqp.explanation.questions import HeldBackNotes, Teller
from hqp.loop.callbacks import Callbacks
from hqp.loop.compiled import Compiled
from hqp.loop.document import assumed, session_tree
from hqp.loop.guards import Turn, alone, refuse
from hqp.loop.tick import Tick
from hqp.loop.way import surviving_holds
from hqp.problem import Hierarchy, Status
from hqp.programs.envelope import native

if TYPE_CHECKING:
    from hqp._session import Live
    from hqp.explanation.account import TickAccount
    from hqp.explanation.conflict import Conflict
    from hqp.explanation.words import Explanation
    from hqp.loop.transition import Transition

T = TypeVar("T")

_new = object.__new__


@dataclass(slots=True, eq=False)
class Guards:
    """State shared by the lines of a session.  first: notes of the first tick.  count: ticks so far.  ages: true if
    states must have a time."""

    robot: Robot
    dt: float
    ages: bool
    turn: Turn
    first: tuple[Note, ...]
    count: int = 0
    phase: str | None = None
    """The phase of the latest tick."""
    laws: Mapping[str, Law] | None = None
    """Laws by element name in the phase of a sequence, None without one."""

    def now(self, now: float | None) -> float:
        """Time of a tick [s], 0 if nothing reads it."""
        return (monotonic() if self.ages else 0.0) if now is None else now


class Line:
    """A stack, compiled and in operation; during a change of stack one of two, inside a line that blends them.

    named: the references of the latest tick, or its targets by name.  latest: its record.  transition: change to this
    line from another one, which answers as well.  lasting: true for an outgoing line, whose references hold until the
    next ones.
    """

    def __init__(
        self,
        guards: Guards,
        compiled: Compiled,
        holds: Mapping[str, Reference] | None = None,
        before: Line | None = None,
    ) -> None:
        self.guards, self.robot, self.dt = guards, guards.robot, guards.dt
        self.compiled, self.stack, self.program = compiled, compiled.stack, compiled.program
        self.workspace, self.presence, self.layout = compiled.workspace, compiled.presence, compiled.layout
        self.transition: Transition | None = None
        self.velocity = self.program.kind == "velocity"
        self.latest: bytearray | None = None
        self.named: tuple[Reference, ...] | dict[str, Any] = ()
        self.good = self.begun = self.lasting = False
        self.callbacks = Callbacks(compiled, self.robot, self.presence, holds or {})
        self.native: Live = native.Live(session_tree(compiled, self.callbacks))
        self._attentive = self.callbacks.attentive
        self._given = dict(holds or {})
        self.hold(self._given)
        if before is not None:
            self.latest, self.named = before.latest, before.named
            if before.transition is None:
                self.native.follow(before.native)
            else:
                before.transition.native.pass_on(self.native)
                self.latest = before.transition.latest
            self.good, self.callbacks.last_good = before.good, before.callbacks.last_good
        self.teller = Teller(self.stack, self.program, self.workspace, self.robot, self.dt)
        self._phase: str | None = None
        self._laws: Mapping[str, Law] | None = None

    @property
    def counters(self) -> Counters:
        """Counters of the session so far."""
        return Counters(*self.native.counters)

    @property
    def problem(self) -> Hierarchy:
        """The hierarchy of the latest tick: live, refilled by the next step."""
        return self.program.problem

    @property
    def hold_values(self) -> dict[str, Vec | Mat]:
        """Copies of the hold values of elements without a reference, by name; empty before the first step."""
        return {n: np.array(r.value) for n, r in self.holds.items() if r.value is not None}

    @property
    def holds(self) -> dict[str, Reference]:
        """Hold values by name; empty before the first step."""
        if not self.begun:
            return dict(self._given)
        targets = self.program.live_targets
        found = {name: np.array(value).reshape(targets[name].shape) for name, value in self.native.holds().items()}
        natively = {name: Reference(name, value) for name, value in found.items()}
        return {
            e.name: natively.get(e.name) or self.callbacks.holds.get(e.name) or Reference(e.name) for e in self.stack
        }

    @property
    def names(self) -> list[str]:
        """Elements that the latest tick has references for."""
        return [each if isinstance(each, str) else each.name for each in self.named]

    @property
    def last_references(self) -> tuple[Reference, ...]:
        """References of the latest tick."""
        if isinstance(self.named, tuple):
            return self.named
        targets = self.program.live_targets
        return tuple(Reference(name, np.array(targets[name])) for name in self.named)

    @property
    def x(self) -> Vec:
        """The x that was sent last, read-only."""
        return self.layout.x(self.latest) if self.latest is not None else self.layout.zero

    def __contains__(self, name: str) -> bool:
        return name in self.stack or (self.transition is not None and name in self.transition)

    def find(self, name: str) -> Element | None:
        """Element of that name, during a change of stack from either stack."""
        found = next((element for element in self.stack if element.name == name), None)
        if found is None and self.transition is not None:
            return next(filter(None, (line.find(name) for line in self.transition.lines)), None)
        return found

    def require_phase(self, phase: str) -> None:
        """Raise DeclarationError for a phase that this stack does not name, nor another one during a change."""
        others = () if self.transition is None else self.transition.lines
        if not any(phase in line.presence.phases for line in (self, *others)):
            self.presence.require(phase)

    def step(self, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
        """Run a tick for any data; raises ModelError for a state of another robot."""
        self.require(state, "step")
        if state.valid and self.robot.current is not state:
            state.kinematics()  # raises for a stale state
        if self.transition is not None:
            return self.transition.step(self, state, references, now)
        start, session = perf_counter(), self.native
        self.take_references(references)
        self.ready(state, references)
        angles = fault = None
        if not state.valid:
            fault = state.fault
        elif not self.compiled.placed:
            angles = state.angles
        outcome = session.step(state.q, state.v, state.time, self.guards.now(now), angles, fault)
        return self.answered(outcome, state, start)

    def ready(self, state: State, references: tuple[Reference, ...]) -> None:
        """Begin a tick; the native session has its references."""
        self._attend()
        if self.lasting:
            given = {reference.name for reference in references}
            last = [r for r in self.last_references if r.name not in given and r.finite]
            kept = [Reference(**{**vars(copied(r)), "load": None}) for r in last]  # a load holds for its own tick
            if any(r.gravity_normal is not None for r in kept):
                self.native.ask()
            references = (*references, *kept)
        self.named = references
        if not self.compiled.placed and state.valid:
            self.program.prepare(state)
        if self._attentive and self.callbacks.begin(state, references, self.x if self.velocity and self.good else None):
            self.native.ask()

    def require(self, state: State, call: str) -> None:
        """Raise ModelError for a state of another robot, DeclarationError for anything but a state."""
        robot = self.robot
        try:
            same = state.robot is robot
        except AttributeError:
            raise DeclarationError(call, "not a State", value=state, allowed="robot.state(q, v)") from None
        if not same:
            raise ModelError(
                f"the state belongs to {state.robot!r}, the session runs on {robot!r}: use robot.state(q, v) of the "
                "latter"
            )

    def begin(self, command: Vec, state: State | None) -> None:
        """Start all lines of a transition from the present command."""
        known = () if state is None else (state.q, state.v, state.angles)
        self.latest = self.native.begin(command, *(known or (None, None, None)))
        self.good = True
        if self.callbacks.reads and state is not None:
            self.callbacks.last_good = state
        if self.transition is not None:
            self.transition.begin(self, command, state)

    def tick(self, q: Vec, v: Vec | None, targets: dict[str, Any]) -> Tick | None:
        """Run a tick of arrays alone, without State and References; return None if it needs the general path."""
        start = perf_counter()
        if self.transition is not None or self.callbacks.reads or not self.compiled.placed or self.guards.ages:
            return None
        if not _plain(q, self.layout.q_shape):
            return None
        if v is None:
            v = self.layout.rest
        elif not _plain(v, self.layout.v_shape):
            return None
        if type(targets) is not dict or not self.native.aim(targets):
            return None
        self._attend()
        if self._attentive:
            self.callbacks.begin(None, (), None)
        self.robot.leave()
        outcome = self.native.step(q, v, None, 0.0, None, None)
        self.named = targets
        return self.answered(outcome, None, start)

    def _attend(self) -> None:
        """The phase of this tick, and its laws."""
        guards = self.guards
        if guards.phase != self._phase:
            self._phase = guards.phase
            self.native.phase((guards.phase if guards.phase in self.presence.known else None) or "")
        if guards.laws is not self._laws:
            self._laws = guards.laws
            self.compiled.laws.obey(guards.laws or {}, self.program.out if self.begun else None)

    def take_references(self, references: tuple[Reference, ...]) -> None:
        """Pass references to the native session; raise for references that fit no element."""
        unfit = self.native.take_references(references)
        if unfit >= 0:
            references = tuple([self._of_doubles(r) for r in references])
            unfit = self.native.take_references(references)
            if unfit >= 0:
                self._refuse(references[unfit])

    @staticmethod
    def _of_doubles(reference: Reference) -> Reference:
        """The reference with its numbers as arrays of doubles, if it has numbers."""
        if not isinstance(reference, Reference):
            return reference
        names = ("value", "velocity", "acceleration", "normal", "gravity_normal")
        arrays = {name: np.asarray(x, FLOAT) for name in names if (x := getattr(reference, name)) is not None}
        return Reference(**{**vars(reference), **arrays})

    def _refuse(self, reference: Reference) -> NoReturn:
        """Raise for a reference without an element, or of another shape."""
        names = [e.name for e in self.stack]
        if getattr(reference, "name", None) not in names or not isinstance(reference, Reference):
            refuse(reference, names)
        name, element = reference.name, self.stack.find(reference.name)
        if reference.load is not None and not assumed(element):
            allowed = ", ".join(e.name for e in self.stack if assumed(e)) or "a contact of the stack, which has none"
            raise DeclarationError(
                name, "not a contact: it takes no measured load", value=reference.load, allowed=allowed
            )
        if reference.on is not None and element.quantity == "load":
            raise DeclarationError(name, "a load has no rows, so on() does not apply", allowed="at(...) with zeros")
        target = self.program.live_targets.get(name)
        value = reference.value
        if value is not None and target is not None and value.shape != target.shape:
            raise DeclarationError(name, f"value has shape {value.shape}", allowed=f"shape {target.shape}")
        rows = element.rows(self.robot)
        for what in ("velocity", "acceleration"):
            given = getattr(reference, what)
            if given is not None and given.shape != (rows,):
                raise DeclarationError(name, f"{what} has shape {given.shape}", allowed=f"shape ({rows},)")
        raise DeclarationError(
            name, "its reference does not fit", value=reference, allowed=f"what {name}.at(...) takes"
        )

    def answered(self, outcome: Any, state: State | None, start: float) -> Tick:
        """The tick of a record."""
        record, status, held = outcome, Status.OPTIMAL, 0
        notes: tuple[Note, ...] = ()
        limits: tuple[Note, ...] = ()
        if type(outcome) is tuple:
            record, severity, held, native_notes, plain = outcome
            status, notes = STATUSES[severity], of_native(native_notes)
            if held == 0:
                notes, limits = notes[:plain], notes[plain:]
        self.begun = True
        before: Vec | bytearray | None = self.latest
        if before is None and self.program.kind == "torque":
            before = np.array(self.native.start)
        self.latest = record
        solution, self.callbacks.solution = self.callbacks.solution, None  # belongs to this tick alone
        tick = _new(Tick)
        tick.__init__(self, state, before, record, start, solution, status, notes, held)  # type: ignore[misc]
        if held == 0:
            self.good = True
            if self.callbacks.reads:
                self.callbacks.last_good = state
            if self.guards.first:
                tick.add(self.guards.first)
                self.guards.first = ()
            if record[-1] > 1:
                w, named = self.layout.slacks(record), self.named
                values = self.teller.held_back(w, self.layout.answer(record))
                if values is not None:
                    tick.add(HeldBackNotes(self.teller, values, w.copy(), tuple(named)))
            if limits:
                tick.add(limits)
        elif self.guards.ages and status is Status.INVALID_STATE and state is not None and state.time is None:
            tick.suggest("robot.state(q, v, time=...)")
        self.program.took(state, self.named if isinstance(self.named, tuple) else ())
        return tick

    def hold(self, holds: Mapping[str, Reference]) -> None:
        """Hold these values until their elements are switched off."""
        for name, held in holds.items():
            if name in self.callbacks.names:
                self.callbacks.holds[name] = held
            elif held.value is not None:
                self.native.keep_hold(name, np.ascontiguousarray(held.value).reshape(-1))

    def inherit(self, before: Line) -> None:
        """Take hold values of another stack for elements without native code."""
        kept = surviving_holds(before.stack, before.callbacks.holds, self.stack)
        self.callbacks.holds |= {name: held for name, held in kept.items() if name in self.callbacks.names}

    def take_over(self, tick: Tick) -> None:
        """Continue alone from the last command of a blend."""
        self.latest, self.good, self.begun, self.lasting = tick.record, True, True, False
        self.transition = None  # last: an interrupt before it leaves a finished transition

    def explain(self, tick: Tick) -> Explanation:
        """The account of the latest tick."""
        return self._explained(self.teller.explain, tick)

    def account(self, tick: Tick) -> TickAccount:
        """Return which element holds back which in the latest tick."""
        return self._explained(self.teller.account, tick)

    def conflict(self, tick: Tick) -> Conflict:
        """Return the rows of ``subject_to`` that conflict in the latest tick."""
        return self._explained(self.teller.conflict, tick)

    def _explained(self, what: Callable[[int, Tick], T], tick: Tick) -> T:
        """Query the rows of a tick while no other thread writes them; steps may call it, too."""
        turn = self.guards.turn
        if turn.get(None) == get_ident():
            return what(self.guards.count, tick)
        return alone(turn, self, lambda: what(self.guards.count, tick))


def _plain(array: Any, shape: tuple[int, ...]) -> bool:
    """Return true if native parts can read an array of that shape where it is."""
    return type(array) is np.ndarray and array.dtype is FLOAT and array.shape == shape and array.flags.c_contiguous
