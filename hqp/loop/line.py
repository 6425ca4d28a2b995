"""A compiled stack at work: its rows and its solver, what it was asked for, and what it answered last."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from threading import get_ident
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare.element import Element
from hqp.declare.law import Law
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.explanation.notes import Note
from hqp.explanation.questions import Teller
from hqp.loop.compiled import Compiled
from hqp.loop.contact_watch import assumed
from hqp.loop.guards import StateCheck, rate_limiter
from hqp.loop.outgoing import GRADUAL
from hqp.loop.presence import Presence
from hqp.loop.references import References
from hqp.loop.stepping import step
from hqp.loop.stuck import StuckWatch
from hqp.loop.tick import Tick
from hqp.loop.transition.changing import blended
from hqp.loop.turn import Turn, alone
from hqp.problem import Hierarchy
from hqp.programs.envelope import native
from hqp.solvers.base import turn

if TYPE_CHECKING:
    from hqp._session import Budget, ContactWatch, Outgoing, RateLimiter
    from hqp.explanation.account import TickAccount
    from hqp.explanation.conflict import Conflict
    from hqp.explanation.words import Explanation
    from hqp.loop.transition.blend import Transition
    from hqp.loop.transition.easing import Easing
    from hqp.programs.direct import Direct

T = TypeVar("T")


@dataclass(slots=True, eq=False)
class Guards:
    """What the lines of a session share.  joints: of x, those of the motors.  first: notes of the first tick.
    count: ticks so far."""

    robot: Robot
    dt: float
    check: StateCheck
    gradual: RateLimiter
    joints: Index | slice
    turn: Turn
    first: tuple[Note, ...]
    stuck: bool = True
    """Whether tasks that are stuck are looked for."""
    count: int = 0
    phase: str | None = None
    """The phase of the latest tick."""
    laws: Mapping[str, Law] | None = None
    """Of elements by name in the phase of a sequence, None where there is none."""

    @classmethod
    def of(
        cls, robot: Robot, dt: float, check: StateCheck, kind: str, turn: Turn, first: tuple[Note, ...], stuck: bool
    ) -> Guards:
        """Those of sessions of one kind of x."""
        joints: Index = np.arange(len(robot.joint_names)) if kind == "torque" else robot.actuated
        gradual = rate_limiter(robot, GRADUAL, kind, dt, "transition")
        assert gradual is not None
        behind = bool(joints.size and np.all(np.diff(joints) == 1))
        part = slice(int(joints[0]), int(joints[-1]) + 1) if behind else joints
        return cls(robot, dt, check, gradual, part, turn, first, stuck)


class Line:
    """One stack, compiled and at work; in a change of stack two of them side by side, within one that blends them.

    x: the answer that was sent last, read-only.  good: the state of the latest usable answer, or the
    record that has it.  held: for how many ticks
    the command has been coming to rest.  named: the references of the latest tick, or the names of its targets.
    latest, latest_count: its record where it was one native call, of ``direct``, and its number; earlier: the record
    before.  outgoing: what is sent of answers.  direct_known: whether a native loop has been looked for.  ease: what
    eases rows before the solver.  transition: the lines that are blended into this one.
    """

    def __init__(
        self,
        guards: Guards,
        compiled: Compiled,
        budget: Budget,
        limiter: RateLimiter | None,
        holds: Mapping[str, Reference] | None = None,
    ) -> None:
        self.guards, self.robot, self.dt, self.check = guards, guards.robot, guards.dt, guards.check
        self.budget, self.limiter = budget, limiter
        self.transition: Transition | None = None
        self.x: Vec = np.zeros(compiled.program.problem.n)
        self.x.setflags(write=False)
        self.good: State | tuple[Direct, bytearray] | None = None
        self.held = 0
        self.named: tuple[Reference, ...] | tuple[str, ...] = ()
        self.stack, self.program, self.workspace = compiled.stack, compiled.program, compiled.workspace
        self.limit, self.rest, self.hard = compiled.limit, compiled.rest, compiled.hard
        self.compiled, self.references = compiled, References(holds or {})
        self.outgoing: Outgoing = native.Outgoing(compiled.outgoing)
        self.velocity = self.program.kind == "velocity"
        self.direct: Direct | None = None
        self.direct_known = False
        self.latest: bytearray | None = None
        self.earlier: bytearray | None = None
        self.latest_count = 0
        self.ease: Easing | None = None
        self.teller = Teller(compiled.stack, compiled.program, compiled.workspace, self.robot, self.dt)
        self.contacts: ContactWatch = native.ContactWatch([e.name for e in self.stack if assumed(e)], self.dt)
        self.presence = Presence(compiled.stack, compiled.program)
        self.limits = compiled.watched.watch(self.dt)
        self.stuck = StuckWatch(compiled.stack, self.dt, self.guards.stuck)

    @property
    def problem(self) -> Hierarchy:
        """The hierarchy of the latest tick: live, refilled by the next step."""
        return self.program.problem

    @property
    def before(self) -> tuple[Vec, bool, int]:
        """What this tick follows: the x that was sent last, whether an answer was usable; and its number."""
        return self.x, self.good is not None, self.guards.count

    @property
    def hold_values(self) -> dict[str, Vec | Mat]:
        """Copies of what elements without a reference are held at, by name; empty before the first step."""
        self.take_renewed()
        held = self.references.holds
        return {name: np.array(reference.value) for name, reference in held.items() if reference.value is not None}

    @property
    def names(self) -> list[str]:
        """Elements that the latest tick has references for."""
        return [each if isinstance(each, str) else each.name for each in self.named]

    @property
    def last_references(self) -> tuple[Reference, ...]:
        """Those of the latest tick."""
        given = tuple(each for each in self.named if isinstance(each, Reference))
        aimed = [each for each in self.named if isinstance(each, str)]
        return given if self.direct is None else (*given, *self.direct.targets(aimed))

    @property
    def last_good(self) -> State | None:
        """The state of the latest usable answer; it is not the robot's current one."""
        if not isinstance(self.good, tuple):
            return self.good
        direct, record = self.good
        return self.robot.past(*direct.state(record))

    def __contains__(self, name: str) -> bool:
        return name in self.stack or (self.transition is not None and name in self.transition)

    def find(self, name: str) -> Element | None:
        """The element of that name, in a change of stack that of either stack."""
        found = next((element for element in self.stack if element.name == name), None)
        if found is None and self.transition is not None:
            return next(filter(None, (line.find(name) for line in self.transition.pair)), None)
        return found

    def step(self, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
        """A tick, whatever comes in."""
        self.named = references
        if self.transition is None:
            return step(self, state, references, now)
        return blended(self, self.transition, state, references, now)

    def require_phase(self, phase: str) -> None:
        """Raise DeclarationError for a phase that neither this stack nor, in a change, another one names."""
        pair = () if self.transition is None else self.transition.pair
        if not any(phase in line.presence.phases for line in (self, *pair)):
            self.presence.require(phase)

    def attend(self, out: frozenset[str], state: State, direct: Direct | None) -> None:
        """These elements are out of this tick, and all others in: those that come back take fresh hold values.

        direct: where the tick is to be one native call, which takes those that it can.  If it raises, the next tick
        begins anew, from the elements that were in before.
        """
        before = self.presence.now
        try:
            self._attend(out, state, direct)
        except BaseException:
            self.presence.now = before
            raise

    def _attend(self, out: frozenset[str], state: State, direct: Direct | None) -> None:
        back = self.presence.back(out)
        self.presence.now = out
        turn(self.workspace, self.presence.marks(out))  # the solver goes on where it ended when it was last so
        self.contacts.judge(out)
        others = () if direct is None else direct.others(back)
        if direct is None or self.references.without or (others and not self.renewed(others, state)):
            direct = None
            self.leave_direct()
            self.renewed(back, state)
        if self.program.out is not out:
            self.program.go_without(out)
        if direct is not None:
            direct.renew(back, others)
        elif self.references.without:
            self.direct, self.direct_known = None, False
        elif self.direct is not None:
            self.direct.hold(self.references.holds)

    def renewed(self, names: Iterable[str], state: State) -> bool:
        """Whether all elements have a hold value, after these have taken fresh ones."""
        for name in names if self.references.current else ():
            self.references.renew(self.presence.member(name), state)
        return not self.references.without

    def send(self, x: Vec, state: State | None = None) -> Vec:
        """Take x for what is sent, read-only from now on; the x that was sent before.  state: of a usable answer."""
        x.setflags(write=False)
        last, self.x = self.x, x
        if state is not None:
            self.good, self.held = state, 0
        return last

    def leave_direct(self) -> None:
        """The general path takes over."""
        if self.direct is not None:
            self.take_renewed()
            self.direct.leave()
            if self.latest is not None:
                if self.earlier is not None:
                    self.outgoing.solved(self.direct.x(self.earlier), self.latest_count - 1)
                x = self.direct.x(self.latest).copy()
                self.outgoing.solved(x, self.latest_count)
                self.send(x)
                self.latest = self.earlier = None

    def take_renewed(self) -> None:
        """Hold values that native ticks took."""
        if self.direct is not None:
            self.references.put(self.direct.renewed())

    def find_direct(self) -> None:
        """Ordinary ticks from now on, once hold values are known and an answer was usable."""
        if self.references.without:
            return
        self.direct_known = True
        if self.limiter is None and not self.check.ages:
            self.direct = self.compiled.direct()
            if self.direct is not None:
                self.direct.hold(self.references.holds)
                if self.ease is not None:
                    self.direct.before_solving(self.ease)

    def stay_general(self) -> None:
        """No native calls from now on."""
        self.stop_easing()
        self.direct, self.direct_known = None, True

    def stop_easing(self) -> None:
        """The native loop asks for all of every task again."""
        if self.direct is not None and self.ease is not None:
            self.direct.before_solving(None)

    def successor(self, compiled: Compiled, holds: Mapping[str, Reference]) -> Line:
        """The line of another stack that goes on where this one is."""
        found = Line(self.guards, compiled, self.budget, self.limiter, holds)
        found.x, found.good, found.held, found.named = self.x, self.good, self.held, self.named
        return found

    def stand_aside(self) -> Line:
        """This line, from now on beside the one that blends it in: on the general path, without rate limits."""
        self.limiter, self.budget = None, native.Budget(0.5 * self.budget.deadline)
        self.direct, self.direct_known = None, True
        return self

    def take_over(self, other: Line) -> None:
        """Go on with what a line of the same stack has made ready."""
        self.rest, self.references, self.limits = other.rest, other.references, other.limits
        if self.limiter is None:
            self.direct, self.direct_known = other.direct, other.direct is not None
        self.transition = None  # last: an interrupt before it leaves a transition that is done

    def explain(self, tick: Tick) -> Explanation:
        """The account of the latest tick."""
        return self._asked(self.teller.explain, tick)

    def account(self, tick: Tick) -> TickAccount:
        """Which element holds which back in the latest tick."""
        return self._asked(self.teller.account, tick)

    def conflict(self, tick: Tick) -> Conflict:
        """Which rows of ``subject_to`` exclude each other in the latest tick."""
        return self._asked(self.teller.conflict, tick)

    def _asked(self, what: Callable[[int, Tick], T], tick: Tick) -> T:
        """What is told of the rows of a tick, while no other thread writes them; a step may ask, too."""
        turn = self.guards.turn
        if turn.get(None) == get_ident():
            return what(self.guards.count, tick)
        return alone(turn, self, lambda: what(self.guards.count, tick))
