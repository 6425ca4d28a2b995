"""The control loop: a controller makes sessions, a session takes a state each tick and returns a command."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import monotonic, perf_counter
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from hqp.account import MOST, Accountant, TickAccount, of_explanation, too_fast, unit_of
from hqp.arrays import Index, Vec
from hqp.contact_watch import ContactWatch
from hqp.direct import Direct
from hqp.errors import (
    ConcurrentUse,
    DeclarationError,
    DynamicsFailed,
    HqpError,
    ModelError,
    UnknownReference,
    closest,
)
from hqp.explain import Explanation, explain
from hqp.formulation import Formulation, Program, Velocity
from hqp.price import Priced, affordable, as_price
from hqp.problem import Hierarchy, Solution, Status
from hqp.reference import Reference
from hqp.rest import Rest
from hqp.restless import LimitWatch
from hqp.robot import Robot, State
from hqp.safety import Braking, RateLimits, StateBounds, StateCheck, positive, rate_limiter
from hqp.solvers import load
from hqp.solvers.base import Solver, Workspace
from hqp.soundness import rehearse, require_sound
from hqp.stack import Stack, coupled
from hqp.tick import BlendedTick, Note, Notes, OrdinaryTick, Tick, Times
from hqp.tolerances import VIOLATION_TOLERANCE
from hqp.transition import Transition, surviving
from hqp.waypoints import Waypoint, bearing
from hqp.waypoints import path as path_of

if TYPE_CHECKING:
    from hqp.conflict import Conflict
    from hqp.recorder import Recorder

KEPT = 16
"""Compiled stacks that a session keeps."""

DEEPEST = 3
"""Transitions that may be under way at a time."""

UNITS = {
    "motion": {"velocity": "(rad, m)/s", "acceleration": "(rad, m)/s^2", "torque": "(rad, m)/s^2"},
    "force": dict.fromkeys(("velocity", "acceleration", "torque"), "(N, N m)"),
    "effort": dict.fromkeys(("velocity", "acceleration", "torque"), "N m"),
}
"""Units of rows by what they bind and what x is."""

DULL = ("joint_limits", "torque_limits")
"""Elements whose rows say enough by their joint."""

LOG = logging.getLogger("hqp.session")
"""Changes of status: from good to bad as warnings, back as information."""
LOG.addHandler(logging.NullHandler())

DEADLINE = 0.8
"""Share of the control period that a tick may take before its solver returns the best point so far."""


@dataclass(frozen=True)
class Controller:
    """A stack, a formulation and a solver: everything of a controller but the robot.

    solver: a name for ``hqp.solvers.load`` or a Solver, ``hqp.solvers.default()`` for "".  deadline [s]: after the
    start of a tick, when its solver returns the best point so far; 0.8 dt for None, ``math.inf`` for none; the first
    answer of a session may take longer, and only ``lexicographic`` takes notice.  rates: how fast a command may
    change, no limit for None.  bounds: of a state that is believed.  braking: how a command comes to rest.
    price: of levels that declare none, a Price, None for the default (docs/calm.md); 0 makes every level exact,
    whatever it declares.
    """

    stack: Stack
    formulation: Formulation = field(default_factory=Velocity)
    solver: str | Solver = ""
    deadline: float | None = None
    rates: RateLimits | None = None
    bounds: StateBounds = field(default_factory=StateBounds)
    braking: Braking = field(default_factory=Braking)
    price: Priced = None

    def __post_init__(self) -> None:
        if not isinstance(self.stack, Stack):
            raise DeclarationError("controller", "stack is not a Stack", value=self.stack)
        if not isinstance(self.formulation, Formulation):
            raise DeclarationError("controller", "not a formulation", value=self.formulation, allowed="Velocity(), ...")
        object.__setattr__(self, "price", as_price("controller", self.price))
        if isinstance(self.solver, str):
            object.__setattr__(self, "solver", load(self.solver))
        if self.deadline is not None and self.deadline != math.inf:
            positive("controller", "deadline", self.deadline)
        for name, kind in (("rates", RateLimits), ("bounds", StateBounds), ("braking", Braking)):
            value = getattr(self, name)
            if not isinstance(value, kind) and not (name == "rates" and value is None):
                raise DeclarationError("controller", name, value=value, allowed=f"{kind.__name__}(...)")

    def session(self, robot: Robot, dt: float, *, max_age: float | None = None) -> Session:
        """Compile for a robot at a control period dt [s]; states older than max_age [s] are refused.

        Raises DeclarationError, ModelError or UnsupportedProblem for what does not fit, before the loop.
        """
        return Session(self, robot, dt, max_age=max_age)


@dataclass(frozen=True, slots=True, eq=False)
class Compiled:
    """A stack made ready for a robot: its program, a workspace, how to limit its time, how to come to rest.

    dropped: what of its prices the solver cannot do.
    """

    stack: Stack
    program: Program
    workspace: Workspace
    limit: Callable[[float], None] | None
    rest: Rest
    hard: frozenset[str]
    dropped: str


class Session:
    """A controller on one robot; keeps hold values, the last safe command and the solver's warm start.

    max_age [s]: states must tell their ``time`` on the clock of ``time.monotonic`` (or of ``step(..., now=)``) and be
    no older.  One thread at a time may step.
    """

    def __init__(self, controller: Controller, robot: Robot, dt: float, *, max_age: float | None = None) -> None:
        if not isinstance(dt, (int, float, np.floating)) or not 0.0 < dt < math.inf:
            raise DeclarationError("session", "bad control period", value=dt, unit="s", allowed="dt > 0")
        self.controller, self.robot, self.dt = controller, robot, float(dt)
        self.count = 0
        self._lock = threading.Lock()
        self._check = StateCheck(robot, controller.bounds, max_age)
        self._deadline = DEADLINE * self.dt if controller.deadline is None else controller.deadline
        self._holds: dict[str, Reference] = {}
        self._seen: dict[Stack, Compiled] = {}
        self._transition: Transition | None = None
        require_sound(robot)
        compiled = self._compile(controller.stack)
        rehearse(controller.formulation, compiled.stack, robot, self.dt)
        self._activate(compiled)
        self._limiter = rate_limiter(robot, controller.rates, self.program.kind, self.dt)
        self._x: Vec = np.zeros(self.program.problem.n)
        self._good: State | None = None
        self._status = Status.OPTIMAL
        self._held = 0
        self._named: tuple[Reference, ...] = ()
        self._recorder: Recorder | None = None
        torque = self.program.kind == "torque"
        self._joints: Index = np.arange(len(robot.joint_names)) if torque else robot.actuated

    def _compile(self, stack: Stack) -> Compiled:
        """Everything that a stack needs, from the cache where it was seen before."""
        try:
            known = self._seen.pop(stack, None)
        except TypeError:  # an element of the user's own with a field that has no hash
            return self._compiled(stack)
        known = known or self._compiled(stack)
        self._seen[stack] = known  # the latest last
        if len(self._seen) > KEPT:
            del self._seen[next(iter(self._seen))]
        return known

    def _compiled(self, stack: Stack) -> Compiled:
        whole = coupled(stack, self.robot)
        solver = self.controller.solver
        assert isinstance(solver, Solver)  # Controller has loaded it
        price, dropped = affordable(whole, as_price("controller", self.controller.price), solver)
        program = self.controller.formulation.compile(whole, self.robot, self.dt, price)
        solver.require(program.shape)
        workspace = solver.workspace(program.shape)
        limit = None if getattr(solver, "deadline", 0.0) is not None else getattr(workspace, "limit", None)
        if limit is not None and self._deadline == math.inf:
            limit(math.inf)
            limit = None
        hard = frozenset(element.name for element in whole.subject_to)
        rest = program.rest(self.robot, self.controller.braking)
        return Compiled(whole, program, workspace, limit, rest, hard, dropped)

    def _activate(self, compiled: Compiled) -> None:
        self.stack, self.program, self.workspace = compiled.stack, compiled.program, compiled.workspace
        self._limit, self._rest, self._hard = compiled.limit, compiled.rest, compiled.hard
        self.dropped = compiled.dropped
        self._current: dict[str, Reference] = {}
        self._given: list[Reference] = []
        self._velocity = self.program.kind == "velocity"
        self._direct: Direct | None = None
        self._latest: bytearray | None = None
        self._direct_known = False
        self._accountant: Accountant | None = None
        self._contacts = ContactWatch(compiled.stack, self.dt)
        self._limits = LimitWatch(compiled.program, self.robot, self.dt)

    @property
    def problem(self) -> Hierarchy:
        """The hierarchy of the latest tick: live, refilled by the next step; ``problem.copy()`` is not."""
        return self.program.problem

    def step(self, state: State, *references: Reference, now: float | None = None) -> Tick:
        """One tick: the command for a state, with references good for this tick only.

        Data never raises: what is wrong with it is told by status and notes.  now [s]: the time of this tick, that of
        ``time.monotonic`` for None.  Raises StaleState, UnknownReference, ConcurrentUse, ModelError (a state of
        another robot) or DeclarationError (a reference of another shape), which are errors of the program.
        """
        self._enter()
        try:
            self._named = references
            for reference in references:
                if getattr(reference, "load", None) is not None:
                    self._contacts.measure(reference.name, reference.load)  # type: ignore[arg-type]
            if self._direct is not None and not self._contacts.missing:
                tick = self._ordinary_tick(self._direct, state, references)
                if tick is not None:
                    if self._recorder is not None:
                        self._recorder.take(tick, references)
                    return tick
            return self._told(self._tick(state, references, now), references)
        except FloatingPointError:  # the caller asked NumPy to raise; here what is not finite is told by a status
            with np.errstate(all="ignore"):
                return self._told(self._tick(state, references, now), references)
        finally:
            self._lock.release()

    def _tick(self, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
        if self._transition is None:
            return self._step(state, references, now)
        return self._blended(self._transition, state, references, now)

    def _blended(
        self, transition: Transition, state: State, references: tuple[Reference, ...], now: float | None
    ) -> Tick:
        """A tick between two stacks: both are solved, their answers blended."""
        first, second = transition.pair
        for reference in references:
            name = getattr(reference, "name", "")
            if name not in self.stack and not transition.knows(name):
                self._current = self._current or {element.name: Reference(element.name) for element in self.stack}
                self._apply_references((reference,))  # raises for what is no reference, or for no element
        if not second._current:
            second._holds = surviving(first.stack, first._holds, second.stack)
        # each keeps the last x of its own: limits that stand around it (a window on acceleration) then bound how fast
        # its answer moves, not how far it may be from the blend
        second._contacts = self._contacts
        here = transition.here(state, references) if transition.released_rows else ()
        a = first._beside(state, (*references, *here), now)
        b = second._beside(state, references, now)
        self.count += 1
        if a.held or b.held:
            worst = b if b.held else a
            self._rest = second._rest  # of the contacts that the robot stands on now
            tick = self._held_tick(state, worst.solution, worst.notes, fit=worst.fit)
            tick.take_place_of(worst)
            return tick
        last = self._x
        waits = bearing(first.program, a.x, transition.released) if transition.released else ()
        unfinished = not (a.finished and b.finished)
        x = transition.blend(a.x, b.x, last, self._joints, wait=bool(waits), unfinished=unfinished)
        notes = waits or tuple(note for note in b.notes if note not in a.notes)
        notes = (*a.notes, *notes)
        if waits:  # the contact is still there: so are the dynamics of the first stack
            second, b = first, a
        if self._limiter is not None:
            x, notes = self._within_rates(x, notes, second)
        self._x, self._good, self._held = x, state, 0
        command = second.program.command
        if type(b) is OrdinaryTick and not notes:
            b = BlendedTick(b, x, command(x), command(last), transition.progress)
        else:
            b = b.general() if isinstance(b, OrdinaryTick) else b
            b.follow(x, command(x), command(last), notes, transition.progress)
        if transition.done:
            self._transition = None
            first._leave_direct()
            second._leave_direct()
            self._rest = second._rest
            self._holds, self._current, self._given = second._holds, second._current, second._given
        else:
            transition.advance()
        return b

    def _beside(self, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
        """A tick of one of two stacks, with the references that are its own."""
        self._named = mine = tuple(r for r in references if self.knows(r.name))
        if self._direct is not None and not self._contacts.missing:
            tick = self._ordinary_tick(self._direct, state, mine)
            if tick is not None:
                return tick
        return self._tick(state, mine, now)

    def knows(self, name: str) -> bool:
        """Whether a reference of that name is taken now."""
        return name in self.stack or (self._transition is not None and self._transition.knows(name))

    def _enter(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise ConcurrentUse("another thread is in this session; make a session a thread, each of its robot.copy()")

    def _ordinary_tick(self, direct: Direct, state: State, references: tuple[Reference, ...]) -> Tick | None:
        """A tick in one native call; None for what is out of the ordinary, which the general path tells."""
        start = perf_counter()
        if state.robot is not self.robot or direct.workspace is not self.workspace or not self._check.ordinary(state):
            return None
        if direct.fresh and self._limit is not None:
            self._limit(self._deadline)
        self.program.prepare(state)
        if self._velocity:
            state.commanded = self._x if self._latest is None else direct.x(self._latest)
        found = direct.step(state, references)
        if found is None:
            return None
        self.count += 1
        if isinstance(found, tuple):
            self._leave_direct()
            solution = self.workspace.answer(self.program.problem, found)  # type: ignore[attr-defined]
            return self._conclude(state, solution, (), start, start, start)
        before, self._latest = self._latest, found
        self._good, self._held = state, 0
        if self._status is not Status.OPTIMAL:
            self._log(Status.OPTIMAL, ())
        tick = OrdinaryTick(self, direct, state, found, self._x if before is None else before, start)
        if restless := self._limits.record(found, direct.marks):
            tick.note(restless_notes(restless))
        return tick

    def _told(self, tick: Tick, references: tuple[Reference, ...]) -> Tick:
        """The tick, recorded; a change of status is logged."""
        if tick.status is not self._status:
            self._log(tick.status, tick.notes)
        if self._recorder is not None:
            self._recorder.take(tick, references)
        return tick

    def record(
        self, ticks: int = 500, on: str | Callable[[Tick], bool] = "not optimal", to: str | Path = "."
    ) -> Recorder:
        """Keep the last ticks from now on, and write them to a file in the folder ``to`` when something happens.

        on: "not optimal", "not solved", "held", "noted", "never" (``Recorder.dump`` writes all the same), or a function
        of the tick.  The file is written by a thread, needs no robot to be read, and `hqp replay` solves it again.
        Raises DeclarationError for a number of ticks that is none, or an unknown name.
        """
        from hqp.recorder import Recorder

        self._recorder = Recorder(self, ticks, on, to)
        return self._recorder

    def _log(self, status: Status, notes: tuple[Note, ...]) -> None:
        self._status = status
        text = "; ".join(f"{note.element}: {note.detail}" for note in notes)
        LOG.log(logging.INFO if status.solved else logging.WARNING, "tick %d %s %s", self.count, status.name, text)

    def _leave_direct(self) -> None:
        """The general path takes over."""
        if self._direct is not None:
            self._direct.leave()
            if self._latest is not None:
                self._x, self._latest = self._direct.x(self._latest).copy(), None

    def _find_direct(self) -> None:
        """Ordinary ticks from now on, once hold values are known and an answer was usable."""
        self._direct_known = True
        if self._limiter is None and not self._check.ages:
            self._direct = self.program.direct(self.workspace)
            if self._direct is not None:
                self._direct.hold(self._holds)

    def _step(self, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
        start = perf_counter()
        self._leave_direct()
        self.count += 1
        if state.robot is not self.robot:
            raise ModelError(f"the session runs on {self.robot!r}, the state belongs to {state.robot!r}")
        if self._check.ages and now is None:
            now = monotonic()
        fault = self._check.fault(state, now)
        if fault:
            return self._held_tick(state, None, (Note("state", Status.INVALID_STATE, fault),), fit=False)
        program = self.program
        notes: tuple[Note, ...] = ()
        try:
            program.prepare(state)
            if not self._current:
                self._take_holds(state)
            prepared = perf_counter()
            state.commanded = self._x if self._velocity and self._good is not None else None
            if references or self._given:
                self._apply_references(references)
            program.fill(state, self._current, self._given)
            unusable = program.unusable()
            if unusable:
                notes = self._repair(state, unusable)
        except (DynamicsFailed, np.linalg.LinAlgError) as error:
            return self._held_tick(state, None, (Note("robot", Status.DYNAMICS_FAILED, str(error)),), fit=False)
        filled = perf_counter()
        if self._limit is not None and self._good is not None:  # the very first answer may take its time
            self._limit(max(self._deadline - (filled - start), 1e-6))
        solution = self.workspace.solve(program.problem)
        tick = self._conclude(state, solution, notes, start, prepared, filled)
        if not self._direct_known and self._good is not None:
            self._find_direct()
        return tick

    def _conclude(
        self,
        state: State,
        solution: Solution,
        notes: tuple[Note, ...],
        start: float,
        prepared: float,
        filled: float,
    ) -> Tick:
        """The command of a solution, or what is sent where it is not usable; the rest: when which part began."""
        program, solved = self.program, perf_counter()
        x, status = solution.x, solution.status
        if status is not Status.OPTIMAL:
            notes += self._culprits(solution)
            if not status.usable or not float(x.dot(x)) < math.inf:
                return self._held_tick(state, solution, notes, fit=True)
            if not status.solved and status is not Status.NOT_STRICT:
                x = self._best(x)
        elif not float(x.dot(x)) < math.inf:
            notes += (Note("solver", Status.NOT_CERTIFIED, "the answer is not finite"),)
            return self._held_tick(state, solution, notes, fit=True)
        held_back = None if solution.stage_points is None else self._held_back(solution)
        if restless := self._limits.look(solution.active):
            notes += restless_notes(restless)
        if self._contacts.missing:
            notes += tuple(Note(name, Status.CONTACT_LOST, why) for name, why in self._contacts.lost())
        if self._limiter is not None:
            x, notes = self._within_rates(x, notes, self)
        last, self._x, self._good, self._held = self._x, x.copy(), state, 0
        for note in notes:
            status = status if note.status.severity <= status.severity else note.status
        command = program.command(x)
        times = Times(prepared - start, filled - prepared, solved - filled, perf_counter() - solved)
        told: Notes = notes if held_back is None else lambda: (*notes, *held_back())
        return Tick(self, state, self._x, command, program.command(last), status, told, solution, times, 0)

    def _held_back(self, solution: Solution) -> Callable[[], tuple[Note, ...]] | None:
        """What makes the notes on elements that are short of what they were asked for: those with a reference, and
        those whose price is what holds them.  Numbers are taken now, texts are written when they are read."""
        accounts = self._accounts()
        w = np.concatenate(solution.residuals)
        account = accounts.account(self.count, w, guards=True)
        if account is None:
            return None
        named = frozenset(reference.name for reference in self._named)

        def notes() -> tuple[Note, ...]:
            return tuple(
                Note(held.element, Status.OPTIMAL, held.note(account.losses(held.element)))
                for held in accounts.held_back(account, w)
                if held.share > MOST or held.element in named
            )

        return notes

    def _take_holds(self, state: State) -> None:
        """Hold values of elements that have none yet, at the first step or after a change of stack."""
        for element in self.stack:
            if element.name not in self._holds:
                self._holds[element.name] = element.hold(state)
        self._current = {element.name: self._holds[element.name] for element in self.stack}

    def _apply_references(self, references: tuple[Reference, ...]) -> None:
        """Put this tick's references in place of the hold values; raises UnknownReference, DeclarationError."""
        current, holds = self._current, self._holds
        for old in self._given:
            current[old.name] = holds[old.name]
        self._given = []
        for reference in references:
            if not isinstance(reference, Reference):
                raise DeclarationError("step", "not a reference", value=reference, allowed="element.at(...)")
            name = reference.name
            if name not in current:
                near = ", ".join(closest(name, current) or list(current)[:3])
                raise UnknownReference(f"a reference for {name!r}, which the stack does not hold; closest: {near}")
            held = holds[name].value
            if reference.value is None:
                reference = replace(reference, value=held)
            elif held is not None and reference.value.shape != held.shape:
                given = reference.value.shape
                raise DeclarationError(name, f"value has shape {given}", allowed=f"shape {held.shape}")
            current[name] = reference
            self._given.append(reference)

    def _repair(self, state: State, unusable: tuple[str, ...]) -> tuple[Note, ...]:
        """Refill without what cannot be used: hold values for members of ``subject_to``, free rows for all others."""
        given = {reference.name for reference in self._given}
        for name, error in self.program.errors.items():
            if name in given and isinstance(error, DeclarationError) and self._holds[name].value is None:
                raise error  # a reference of the wrong length, which only the element could tell
        wrong = tuple(name for name in unusable if name in given and not self._current[name].finite)
        notes = []
        for name in wrong:
            self._current[name] = self._holds[name]
        self._given = [reference for reference in self._given if reference.name not in wrong]
        broken = unusable
        out = tuple(name for name in wrong if name not in self._hard)
        if wrong:
            self.program.fill(state, self._current, self._given)
            broken = self.program.unusable()
        for name in wrong:
            done = "left out of this tick" if name in out or name in broken else "its hold value was taken instead"
            notes.append(Note(name, Status.INVALID_REFERENCE, f"its reference is not finite: {done}"))
        for name in broken:
            if name not in wrong:
                reason = self.program.reason(name)
                notes.append(Note(name, Status.INVALID_ELEMENT, f"{reason}: left out of this tick"))
        left_out = dict.fromkeys((*out, *broken))
        if left_out:
            self.program.fill(state, self._current, self._given, tuple(left_out))
        return tuple(notes)

    def _held_tick(self, state: State, solution: Solution | None, notes: tuple[Note, ...], *, fit: bool) -> Tick:
        """No answer is usable: the command comes to rest.  fit: whether this state is one to start from."""
        start, self._held = perf_counter(), self._held + 1
        if fit or self._held == 1:
            self._rest.begin(state if fit else self._good, self._x, now=fit)
        if self._good is None and not fit:
            notes += (Note("session", notes[0].status, "no good state so far: the command is zero"),)
        x = self._rest.next()
        if self._limiter is not None:
            x, notes = self._within_rates(x, notes, self)
        last, self._x = self._x, x
        status = Status.worst(*(note.status for note in notes))
        times = Times(0.0, 0.0, 0.0, perf_counter() - start)
        command, before = self.program.command(x), self.program.command(last)
        return Tick(self, state, x, command, before, status, notes, solution, times, self._held, fit)

    def _best(self, x: Vec) -> Vec:
        """Of an unfinished answer and the last x, both clipped into today's box, the one whose levels are less off."""
        problem = self.problem
        candidates = [problem.boxed(x), problem.boxed(self._x)]
        found = [[float(np.sqrt(w @ w)) for w in problem.slacks(candidate)] for candidate in candidates]
        for new, old in zip(*found, strict=True):
            if abs(new - old) > VIOLATION_TOLERANCE * (1.0 + old):
                return candidates[0] if new < old else candidates[1]
        return candidates[0]

    def _within_rates(self, x: Vec, notes: tuple[Note, ...], rows: Session) -> tuple[Vec, tuple[Note, ...]]:
        """x, or the point towards it that the rate limits allow, and what of ``subject_to`` is off by that.

        rows: the session whose rows are those of this tick, itself or one of a transition.
        """
        assert self._limiter is not None
        command = self.program.command
        share, why = self._limiter.share(command(self._x), command(x))
        if share == 1.0:
            return x, notes
        x = self._x + share * (x - self._x)
        limited = (Note("rates", Status.OPTIMAL, why),)
        return x, notes + limited + rows._violations(rows.problem.slacks(x), " by the rate limit")

    def _violations(self, residuals: tuple[Vec, ...], why: str = "") -> tuple[Note, ...]:
        """Notes on the members of ``subject_to`` that are off."""
        notes, constraints = [], self.problem.constraints
        for name, place in self.program.places.items():
            if place.level < constraints:
                rows, w = self.problem.levels[place.level], np.abs(residuals[place.level][place.part])
                bound = np.minimum(np.abs(rows.lower[place.part]), np.abs(rows.upper[place.part]))
                if np.any(w > VIOLATION_TOLERANCE * (1.0 + bound)):
                    notes.append(Note(name, Status.CONSTRAINTS_VIOLATED, f"off by up to {w.max():.3g}{why}"))
        return tuple(notes)

    def _culprits(self, solution: Solution) -> tuple[Note, ...]:
        """Notes on the constraints that are violated, or on the solver where none is."""
        notes = self._violations(solution.residuals)
        if not notes or solution.status is not Status.CONSTRAINTS_VIOLATED:
            notes += (Note("solver", solution.status, solution.detail or solution.status.value),)
        return notes

    def change(self, stack: Stack, over: float = 0.0) -> None:
        """Switch to another stack, at once or within ``over`` seconds at least (hqp/transition.py).

        Hold values survive where class, frame, axes, observer and shape agree; all other elements take fresh ones in
        the next step, those that return as well.  A stack that was seen before is not compiled again.  In a
        transition references for either stack are taken, ``tick.transition`` tells how far it has come; another
        change may come before it ends.  Where x is a torque, a contact that is to be released and cannot be unloaded
        without cost to a task keeps the transition waiting, and a note names it.  Raises what ``Controller.session``
        raises, DeclarationError for ``over`` or where no contact would be left on the way, and then leaves the session
        as it was.
        """
        if not isinstance(over, (int, float)) or not 0.0 <= over < math.inf:
            raise DeclarationError("change", "bad duration", value=over, unit="s", allowed="over >= 0")
        self._enter()
        try:
            self._leave_direct()
            if self._transition is not None:
                for session in self._transition.pair:
                    session._leave_direct()
                    session._direct, session._direct_known = None, True
            path = self._path(stack, over)
            compiled = [self._compile(point.stack) for point in path]
            holds = surviving(self.stack, self._holds, compiled[-1].stack)
            sessions = [self._clone(), *(self._clone(item) for item in compiled[1:])] if over else []
            if len(sessions) == 2 and self._transition is None and sessions[0].program is not sessions[1].program:
                for session in sessions:  # each with rows and a solver of its own: ordinary ticks in one native call
                    session._direct_known = False
            self._activate(compiled[-1])
            self._holds = holds
            self._transition = Transition(sessions, path, over, self.dt, self.program.kind) if over else None
        finally:
            self._lock.release()

    def prepare(self, stack: Stack) -> None:
        """Compile a stack, and what a transition to it passes through, so that ``change`` finds it done.

        The session keeps the last few stacks that it has seen.  Raises what ``change`` raises.
        """
        self._enter()
        try:
            for point in self._path(stack, 1.0)[1:]:
                self._compile(point.stack)
        finally:
            self._lock.release()

    def _path(self, stack: Stack, over: float) -> list[Waypoint]:
        if not over:
            return [Waypoint(stack)]
        law = self.controller.formulation.contact_law if self.program.kind == "torque" else None
        return path_of(self.stack, stack, self.robot, law)

    def _clone(self, compiled: Compiled | None = None) -> Session:
        """The session as it runs now, or on another stack, to go on beside it; without rate limits of its own."""
        clone = object.__new__(Session)
        clone.__dict__.update(self.__dict__)
        clone._lock, clone._limiter, clone._deadline = threading.Lock(), None, 0.5 * self._deadline
        clone._direct, clone._direct_known = None, True  # side by side they go the general way
        clone._holds, clone._current, clone._given = dict(self._holds), dict(self._current), list(self._given)
        if compiled is not None:
            clone._transition = None
            clone._activate(compiled)
            clone._direct_known = True
        elif self._transition is not None and self._transition.depth >= DEEPEST:
            clone._transition = None  # so many changes at a time: the oldest ones end here
        return clone

    def explain(self, tick: Tick) -> Explanation:
        """The account of the latest tick; raises HqpError for an earlier one, whose rows are overwritten."""
        if tick._count != self.count or tick.solution is None:
            raise HqpError("explain() tells of the latest step with a solution; call it before the next step")
        program, v = self.program, tick.state.v
        row_names = {element.name: element.row_names(self.robot) for element in self.stack}
        units = {element.name: unit_of(element, program.kind) for element in self.stack}
        fast = set()
        for name, place in program.places.items():
            w = tick.solution.residuals[place.level][place.part] / place.element.weight
            if too_fast(program, name, w, v):
                fast.add(name)
        told = self._account(tick)
        shares = None if told is None else told.shares
        found = explain(self.problem, tick.solution, program.places, row_names, fast=fast, units=units, shares=shares)
        return replace(found, remarks=program.remarks(tick.state))

    def _accounts(self) -> Accountant:
        if self._accountant is None:
            self._accountant = Accountant(self.program, self.workspace, self.robot)
        return self._accountant

    def account(self, tick: Tick) -> TickAccount:
        """Who holds what back in the latest tick, in microseconds; raises HqpError for an earlier one."""
        if tick._count != self.count or tick.solution is None:
            raise HqpError("account() tells of the latest step with a solution; call it before the next step")
        found = self._account(tick)
        return of_explanation(self._accounts().layout, self.count, self.explain(tick)) if found is None else found

    def _account(self, tick: Tick) -> TickAccount | None:
        guards = tick.solution is not None and tick.solution.stage_points is not None
        return self._accounts().account(self.count, tick._slacks(), guards, tick.state.v)

    def conflict(self, tick: Tick) -> Conflict:
        """Which rows of ``subject_to`` exclude each other in the latest tick; raises HqpError for an earlier one."""
        if tick._count != self.count or tick.solution is None:
            raise HqpError("conflict() tells of the latest step with a solution; call it before the next step")
        from hqp.conflict import conflict

        program, problem = self.program, self.problem
        names = [[("", "")] * rows.m for rows in problem.levels]
        for name, place in program.places.items():
            rows = place.element.row_names(self.robot)
            unit = UNITS[place.element.quantity][program.kind]
            for i in range(place.part.stop - place.part.start):
                row = rows[i] if i < len(rows) else f"row {i}"
                title = row if name in DULL else f"{name}: {row}"
                names[place.level][place.part.start + i] = (title, unit)
        return conflict(problem, names)

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a Session holds live arrays of Pinocchio and of the kernel; pickle session.controller, the robot's name, "
            "dt and (q, v), and make a session of them, or pickle its ticks"
        )


def restless_notes(restless: Iterable[tuple[str, float]]) -> tuple[Note, ...]:
    """Notes on joints whose command alternates from limit to limit."""
    why = "its command alternates from limit to limit {:.0f} times a second: give levels a price, or a better target"
    return tuple(Note(name, Status.OPTIMAL, why.format(rate)) for name, rate in restless)


__all__ = ["Controller", "Note", "Session", "Tick", "Times"]
