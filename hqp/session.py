"""The control loop: a controller makes sessions, a session takes a state each tick and returns a command."""

from __future__ import annotations

import logging
import math
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import get_ident
from typing import TYPE_CHECKING, NoReturn, TypeVar

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.controller import DEADLINE, Controller
from hqp.errors import DeclarationError, ModelWarning, StaleState
from hqp.explanation.questions import Teller
from hqp.loop.budget import Budget
from hqp.loop.compiled import Compiled, Compiler
from hqp.loop.contact_watch import ContactWatch
from hqp.loop.direct import Direct
from hqp.loop.held_base import adrift
from hqp.loop.late import Trend
from hqp.loop.ordinary import ordinary_tick
from hqp.loop.outgoing import GRADUAL
from hqp.loop.references import References
from hqp.loop.restless import LimitWatch
from hqp.loop.safety import RateLimiter, StateCheck, rate_limiter
from hqp.loop.soundness import rehearse, require_sound
from hqp.loop.stepping import step
from hqp.loop.turn import Turn, alone, require
from hqp.problem import Hierarchy, Status
from hqp.reference import Reference
from hqp.robot import Robot, State
from hqp.stack import Stack
from hqp.tick import Note, Tick, Times
from hqp.transition.blend import Transition
from hqp.transition.changing import blended, change, path
from hqp.transition.easing import Easing

if TYPE_CHECKING:
    from hqp.explanation.account import TickAccount
    from hqp.explanation.conflict import Conflict
    from hqp.explanation.words import Explanation
    from hqp.recorder import Recorder

T = TypeVar("T")

LOG = logging.getLogger("hqp.session")
"""Changes of status: from good to bad as warnings, back as information."""
LOG.addHandler(logging.NullHandler())


class Session:
    """A controller on one robot; keeps hold values, the last safe command and the solver's warm start.

    max_age [s]: states must tell their ``time`` on the clock of ``time.monotonic`` (or of ``step(..., now=)``), be no
    older, and at most 1 ms ahead of it.  One thread at a time may step, change the stack or ask about a tick: another
    one is refused.
    """

    def __init__(self, controller: Controller, robot: Robot, dt: float, *, max_age: float | None = None) -> None:
        if not isinstance(dt, (int, float, np.floating)) or not 0.0 < dt < math.inf:
            raise DeclarationError("session", "bad control period", value=dt, unit="s", allowed="dt > 0")
        self.controller, self.robot, self.dt = controller, robot, float(dt)
        self.count = 0
        self._turn: Turn = {}
        self._check = StateCheck(robot, controller.bounds, max_age)
        self._budget = Budget(DEADLINE * self.dt if controller.deadline is None else controller.deadline)
        self._compiler = Compiler(controller, robot, self.dt, self._budget.deadline)
        self._transition: Transition | None = None
        require_sound(robot)
        compiled = self._compiler.compile(controller.stack)
        rehearse(controller.formulation, compiled.stack, robot, self.dt)
        _ = robot.tree_joints  # read off the model once, here and not in the first tick
        self._first: tuple[Note, ...] = ()
        if told := adrift(compiled.stack, robot):
            warnings.warn(told, ModelWarning, stacklevel=3)
            self._first = (Note("base", Status.OPTIMAL, told),)
        if compiled.dropped:
            LOG.warning("%s", compiled.dropped)
        self._activate(compiled, References({}))
        self._limiter = rate_limiter(robot, controller.rates, self.program.kind, self.dt)
        self._gradual = RateLimiter(robot, getattr(GRADUAL, self.program.kind), self.dt)
        self._x: Vec = np.zeros(self.program.problem.n)
        self._x.setflags(write=False)
        self._good: State | None = None
        self._status = Status.OPTIMAL
        self._held = 0
        self._named: tuple[Reference, ...] = ()
        self._recorder: Recorder | None = None
        torque = self.program.kind == "torque"
        joints: Index = np.arange(len(robot.joint_names)) if torque else robot.actuated
        behind = bool(joints.size and np.all(np.diff(joints) == 1))
        self._joints = slice(int(joints[0]), int(joints[-1]) + 1) if behind else joints

    def _activate(self, compiled: Compiled, references: References) -> None:
        self.stack, self.program, self.workspace = compiled.stack, compiled.program, compiled.workspace
        self._limit, self._rest, self._hard = compiled.limit, compiled.rest, compiled.hard
        self.dropped, self._compiled = compiled.dropped, compiled
        self._references = references
        self._velocity = self.program.kind == "velocity"
        self._direct: Direct | None = None
        self._latest: bytearray | None = None
        self._earlier: bytearray | None = None
        self._trend = Trend()
        self._direct_known = False
        self._ease: Easing | None = None
        self._teller = Teller(compiled.stack, compiled.program, compiled.workspace, self.robot)
        self._contacts = ContactWatch(compiled.stack, self.dt)
        self._limits = LimitWatch(compiled.watched, self.dt)

    @property
    def problem(self) -> Hierarchy:
        """The hierarchy of the latest tick: live, refilled by the next step; ``problem.copy()`` is not."""
        return self.program.problem

    @property
    def hold_values(self) -> dict[str, Vec | Mat]:
        """Copies of what elements without a reference are held at, by name; empty before the first step."""
        held = self._references.holds
        return {name: np.array(reference.value) for name, reference in held.items() if reference.value is not None}

    def step(self, state: State, *references: Reference, now: float | None = None) -> Tick:
        """One tick: the command for a state, with references good for this tick only.

        Data never raises: what is wrong with it is told by status and notes.  now [s]: the time of this tick, that of
        ``time.monotonic`` for None.  Raises StaleState, UnknownReference, ConcurrentUse, ModelError (a state of
        another robot) or DeclarationError (a reference of another shape), which are errors of the program.
        """
        turn, me = self._turn, get_ident()
        if turn:
            require(turn, self)
        try:  # as ``alone``, without its calls
            if turn.setdefault(None, me) != me:
                require(turn, self)
            self._named = references
            for reference in references:
                if getattr(reference, "load", None) is not None:
                    self._contacts.measure(reference.name, reference.load)  # type: ignore[arg-type]
            if self._direct is not None and not self._contacts.missing:
                tick = ordinary_tick(self, self._direct, state, references)
                if tick is not None:
                    if self._recorder is not None:
                        self._recorder.take(tick, references)
                    return tick
            return self._told(self._tick(state, references, now), references)
        except FloatingPointError:  # the caller asked NumPy to raise; here what is not finite is told by a status
            with np.errstate(all="ignore"):
                return self._told(self._tick(state, references, now), references)
        finally:
            if turn.get(None) == me:
                turn.clear()

    def _tick(self, state: State, references: tuple[Reference, ...], now: float | None) -> Tick:
        if self._transition is None:
            return step(self, state, references, now)
        return blended(self, self._transition, state, references, now)

    def __contains__(self, name: str) -> bool:
        return name in self.stack or (self._transition is not None and name in self._transition)

    def _asked(self, what: Callable[[int, Tick], T], tick: Tick) -> T:
        """What is told of the rows of a tick, while no other thread writes them; a step may ask, too."""
        if self._turn.get(None) == get_ident():
            return what(self.count, tick)
        return alone(self._turn, self, lambda: what(self.count, tick))

    def _told(self, tick: Tick, references: tuple[Reference, ...]) -> Tick:
        """The tick, recorded; a change of status is logged."""
        if tick.status is not self._status:
            self._log(tick.status, tick.notes)
        if self._recorder is not None:
            self._recorder.take(tick, references)
        return tick

    def too_large(self, state: State) -> str:
        """Which number of a valid state is beyond ``controller.bounds``, in words; "" for none."""
        return self._check.too_large(state)

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

    def _send(self, x: Vec) -> Vec:
        """Take x for what is sent, read-only from now on; the x that was sent before."""
        x.setflags(write=False)
        last, self._x = self._x, x
        return last

    def _leave_direct(self) -> None:
        """The general path takes over."""
        if self._direct is not None:
            self._direct.leave()
            if self._latest is not None:
                if self._earlier is not None:
                    self._trend.take(self._direct.x(self._earlier), self.count - 1)
                x = self._direct.x(self._latest).copy()
                self._trend.take(x, self.count)
                self._send(x)
                self._latest = self._earlier = None

    def _find_direct(self) -> None:
        """Ordinary ticks from now on, once hold values are known and an answer was usable."""
        if self._references.without:
            return
        self._direct_known = True
        if self._limiter is None and not self._check.ages:
            self._direct = self._compiled.direct()
            if self._direct is not None:
                self._direct.hold(self._references.holds)
                if self._ease is not None:
                    self._direct.before_solving(self._ease)

    def change(self, stack: Stack, over: float = 0.0) -> None:
        """Switch to another stack, at once or within ``over`` seconds at least (hqp/transition/blend.py).

        Hold values survive where class, frame, axes, observer and shape agree; all other elements take fresh ones in
        the next step, those that return as well.  A stack that was seen before is not compiled again.  In a
        transition references for either stack are taken, ``tick.transition`` tells how far it has come; another
        change may come before it ends.  Where x is a torque, a contact that is to be released and cannot be unloaded
        without cost to a task keeps the transition waiting, and a note names it.  Raises what ``Controller.session``
        raises, DeclarationError for ``over`` or where no contact would be left on the way, and then leaves the session
        as it was.
        """
        alone(self._turn, self, lambda: self._changed(stack, over))

    def _changed(self, stack: Stack, over: float) -> None:
        kept = dict(self.__dict__)
        try:
            change(self, stack, over)
        except BaseException:  # an interrupt, too
            self.__dict__.update(kept)
            raise

    def prepare(self, stack: Stack) -> None:
        """Compile a stack, and what a transition to it passes through, so that ``change`` finds it done.

        The session keeps the last few stacks that it has seen.  Raises what ``change`` raises.
        """
        alone(self._turn, self, lambda: self._prepared(stack))

    def _prepared(self, stack: Stack) -> None:
        for point in path(self, stack, 1.0)[1:]:
            compiled = self._compiler.compile(point.stack)
            with suppress(StaleState):  # no state is at hand: the native loop is made at the change
                compiled.direct()

    def explain(self, tick: Tick) -> Explanation:
        """The account of the latest tick; raises HqpError for an earlier one, whose rows are overwritten."""
        return self._asked(self._teller.explain, tick)

    def account(self, tick: Tick) -> TickAccount:
        """Which element holds which back in the latest tick, in microseconds; raises HqpError for an earlier one."""
        return self._asked(self._teller.account, tick)

    def conflict(self, tick: Tick) -> Conflict:
        """Which rows of ``subject_to`` exclude each other in the latest tick; raises HqpError for an earlier one."""
        return self._asked(self._teller.conflict, tick)

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a Session holds live arrays of Pinocchio and of the kernel; pickle session.controller, the robot's name, "
            "dt and (q, v), and make a session of them, or pickle its ticks"
        )


__all__ = ["Controller", "Note", "Session", "Tick", "Times"]
