"""Sequences: named phases of one stack, and the timed and measured events that lead from one to the next."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

import numpy as np

from hqp.declare.element import Task
from hqp.declare.law import Law
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError, closest
from hqp.numbers import set_numbers


class TickLike(Protocol):
    """Interface of a tick for a sequence."""

    phase: str | None
    event: str


T = TypeVar("T", bound=TickLike)
T_co = TypeVar("T_co", bound=TickLike, covariant=True)


class Stepped(Protocol[T_co]):
    """Interface of a session for a sequence."""

    dt: float

    @property
    def presence(self) -> Any: ...
    def obey(self, laws: Mapping[str, Law]) -> None: ...
    @property
    def stack(self) -> Stack: ...
    @property
    def program(self) -> Any: ...
    @property
    def hold_values(self) -> Mapping[str, Any]: ...
    def step(
        self, state: State, *references: Reference, now: float | None = None, phase: str | None = None
    ) -> T_co: ...


Pairs: TypeAlias = "tuple[tuple[str, Law], ...]"
"""Laws by names of elements, in the order of these."""

Action = Callable[[State], object]
"""Function called when a phase begins or ends, before the rows of that tick are written."""


@dataclass(frozen=True)
class Event:
    """Measured or signalled event."""

    name: str

    def happens(self, run: Run[Any]) -> bool:
        """Return true if it happens in this tick."""
        raise NotImplementedError

    def require(self, session: Stepped[Any]) -> None:
        """Raise DeclarationError for a name that is not there."""


@dataclass(frozen=True)
class loaded(Event):  # read as words: until=loaded("left", 40.0)
    """The contact of that name was measured to bear so much or more [N], by ``reference.loaded`` of this tick."""

    newtons: float

    def happens(self, run: Run[Any]) -> bool:
        """False where nothing was measured."""
        return run.loads.get(self.name, -math.inf) >= self.newtons

    def require(self, session: Stepped[Any]) -> None:
        """Raise DeclarationError for a name without a contact."""
        contacts = [e.name for e in session.stack if e.is_contact]
        if self.name not in contacts:
            raise DeclarationError(
                type(self).__name__, "unknown contact", value=self.name, allowed=", ".join(contacts) or "none"
            )


@dataclass(frozen=True)
class unloaded(loaded):
    """The contact of that name was measured to bear so much or less [N]."""

    def happens(self, run: Run[Any]) -> bool:
        """False where nothing was measured."""
        return run.loads.get(self.name, math.inf) <= self.newtons


@dataclass(frozen=True)
class near(Event):
    """The task of that name is within a distance of its reference: ||e|| <= distance, in the unit of its rows."""

    distance: float

    def happens(self, run: Run[Any]) -> bool:
        """By the error at the state of this tick, to the reference of this tick or the hold value."""
        task: Any = run.session.stack.find(self.name)
        held = run.session.hold_values.get(self.name)
        value = next((r.value for r in run.references if r.name == self.name and r.value is not None), held)
        return value is not None and float(np.linalg.norm(task.error(run.state, value))) <= self.distance

    def require(self, session: Stepped[Any]) -> None:
        """Raise DeclarationError for a name without a task."""
        if not isinstance(element := session.stack.find(self.name), Task):
            raise DeclarationError(self.name, f"is a {type(element).__name__}", allowed="a task")


@dataclass(frozen=True)
class signal(Event):
    """Signal of the program: ``run.signal(name)`` since the phase began."""

    def happens(self, run: Run[Any]) -> bool:
        """Return true if it was signalled."""
        return self.name in run.signals


EVENTS: dict[str, type[Event]] = {kind.__name__: kind for kind in (loaded, unloaded, near, signal)}
"""Events by their names in files."""


@dataclass(frozen=True, kw_only=True)
class Phase:
    """One phase: the ``name`` in the ``when`` of levels and elements, and its end.

    It ends once it has lasted ``after`` [s] and ``until`` happens, whichever are given; without either it lasts until
    ``Run.go``.  to: the phase that follows, the next one of the sequence by default, the first after the last.  within
    [s]: if it has not ended by then the event ``late <name>`` happens, and ``late`` follows, if given.  laws: laws of
    elements by name while it lasts, those of the stack for all others; kept as pairs.  They go over, see
    ``hqp.loop.presence``.  Raises DeclarationError for times that are not positive and finite, and no laws.
    """

    name: str
    after: float | None = None
    until: Event | None = None
    to: str | None = None
    within: float | None = None
    late: str | None = None
    laws: Mapping[str, Law] | Pairs = ()

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise DeclarationError("phase", "no name", value=self.name, allowed="a string")
        for what in ("after", "within"):
            if getattr(self, what) is not None:
                set_numbers(self, f"phase {self.name}", (what,), 0.0, strict=True, unit="s")
        if self.until is not None and not isinstance(self.until, Event):
            allowed = ", ".join(f"{kind}(...)" for kind in EVENTS)
            raise DeclarationError(f"phase {self.name}", "until is not an event", value=self.until, allowed=allowed)
        if self.late is not None and self.within is None:
            raise DeclarationError(f"phase {self.name}", "late without a time", value=self.late, allowed="within=...")
        try:
            laws: dict[Any, Any] = dict(self.laws)
        except (TypeError, ValueError):
            laws = {"": self.laws}
        if not all(isinstance(name, str) and isinstance(law, Law) for name, law in laws.items()):
            allowed = '{"hand": P(...)}, a law of an element by its name'
            raise DeclarationError(f"phase {self.name}", "bad laws", value=self.laws, allowed=allowed)
        object.__setattr__(self, "laws", tuple(sorted(laws.items())))


class Sequence:
    """Phases in their order; plain data, equal where their phases are.

    Raises DeclarationError for names that occur twice or are not there.
    """

    def __init__(self, *phases: Phase) -> None:
        self.phases = tuple(phases)
        if not phases or not all(isinstance(phase, Phase) for phase in phases):
            raise DeclarationError("sequence", "no phases", value=phases, allowed="Phase(...), one or more")
        self._by_name = {phase.name: phase for phase in phases}
        if len(self._by_name) < len(phases):
            raise DeclarationError("sequence", "duplicate name", value=[phase.name for phase in phases])
        for phase in phases:
            for what in (phase.to, phase.late):
                if what is not None:
                    self.find(what)

    def find(self, name: str) -> Phase:
        """The phase of that name; raises DeclarationError with the closest names."""
        if name not in self._by_name:
            near_by = ", ".join(closest(name, self._by_name) or self._by_name)
            raise DeclarationError("sequence", "unknown phase", value=name, allowed=near_by)
        return self._by_name[name]

    def after(self, phase: Phase) -> Phase:
        """The one that follows."""
        if phase.to is not None:
            return self.find(phase.to)
        return self.phases[(self.phases.index(phase) + 1) % len(self.phases)]

    def laws(self) -> dict[str, dict[str, Law]]:
        """Laws of elements by name, by phase."""
        return {phase.name: dict(phase.laws) for phase in self.phases}

    def require(self, session: Stepped[Any]) -> None:
        """Raise DeclarationError where it does not fit a session, as ``run`` does."""
        presence = session.presence
        for name in presence.phases:
            self.find(name)
        for phase in self.phases:
            if phase.until is not None:
                phase.until.require(session)
            if phase.name not in presence.phases and (why := session.program.refuses(presence.known[None])):
                raise DeclarationError(f"phase {phase.name}", why, allowed="contacts that determine the motion")
            for name, law in dict(phase.laws).items():
                session.stack.find(name)
                session.program.assembly.require_law(name, law)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self.phases == other.phases

    def __hash__(self) -> int:
        return hash(self.phases)

    def __repr__(self) -> str:
        return f"Sequence({', '.join(map(repr, self.phases))})"

    def run(
        self,
        session: Stepped[T],
        *,
        entry: Mapping[str, Action] | None = None,
        exit: Mapping[str, Action] | None = None,
    ) -> Run[T]:
        """The sequence at work on a session, from its first phase on.

        entry, exit: functions called with the state when a phase of that name begins and ends.  Raises DeclarationError
        for names that are not there: phases of the stack, contacts and tasks of events, phases of entry and exit,
        elements of laws; for laws that do not fit their element, or one without a law; and for a phase in which
        constraints and actuators do not determine the motion.
        """
        return Run(self, session, entry or {}, exit or {})


class Run(Generic[T]):
    """A sequence on a session; ``step`` takes the place of ``session.step``.

    phase: the one of the latest tick.  since [s]: its age in that tick.  loads: measured loads of contacts in it, by
    name [N].  signals: names given to ``signal`` since the phase began.
    """

    def __init__(
        self, sequence: Sequence, session: Stepped[T], entry: Mapping[str, Action], exit: Mapping[str, Action]
    ) -> None:
        self.sequence, self.session, self.entry, self.exit = sequence, session, entry, exit
        sequence.require(session)
        for name in (*entry, *exit):
            sequence.find(name)
        self._laws = sequence.laws()
        self.phase = sequence.phases[0]
        self.ticks = -1
        self.loads: dict[str, float] = {}
        self.signals: set[str] = set()
        self.references: tuple[Reference, ...] = ()
        self.state: State
        self._next: Phase | None = None
        self._is_late = False

    @property
    def since(self) -> float:
        """For how long the phase has lasted [s]."""
        return max(self.ticks, 0) * self.session.dt

    def signal(self, name: str) -> None:
        """Set the signal ``name``; events of that name see it until the phase ends."""
        self.signals.add(name)

    def go(self, name: str) -> None:
        """Begin that phase with the next tick; raises DeclarationError for one that is not there."""
        self._next = self.sequence.find(name)

    def step(self, state: State, *references: Reference, now: float | None = None) -> T:
        """One tick of the session in the phase that is due; ``tick.phase`` and ``tick.event`` report it.

        The event is the name of a phase that begins, ``late <name>`` for one that did not end in time, else "".
        """
        self.state, self.references = state, references
        measured = ((r.name, getattr(r, "load", None)) for r in references)
        self.loads = {name: load for name, load in measured if load is not None}
        event = self._advance() if state.valid else ""
        known = self.phase.name in self.session.presence.phases
        tick = self.session.step(state, *references, now=now, phase=self.phase.name if known else None)
        tick.phase, tick.event = self.phase.name, event
        return tick

    def _advance(self) -> str:
        """Take the phase of this tick; what happened."""
        self.ticks += 1
        phase, following, event = self.phase, self._next, ""
        if self.ticks == 0:
            return self._begin(following or phase)
        if following is None and self._ended(phase):
            following = self.sequence.after(phase)
        elif following is None and phase.within is not None and not self._is_late and self._past(phase.within):
            self._is_late, event = True, f"late {phase.name}"
            following = None if phase.late is None else self.sequence.find(phase.late)
        if following is not None:
            if action := self.exit.get(phase.name):
                action(self.state)
            began = self._begin(following)
            event = event or began
        return event

    def _begin(self, phase: Phase) -> str:
        self.phase, self.ticks, self._next, self._is_late = phase, 0, None, False
        self.signals.clear()
        self.session.obey(self._laws[phase.name])
        if action := self.entry.get(phase.name):
            action(self.state)
        return phase.name

    def _past(self, seconds: float) -> bool:
        return self.ticks * self.session.dt >= seconds - 0.5 * self.session.dt

    def _ended(self, phase: Phase) -> bool:
        if phase.after is None and phase.until is None:
            return False
        due = phase.after is None or self._past(phase.after)
        return due and (phase.until is None or phase.until.happens(self))
