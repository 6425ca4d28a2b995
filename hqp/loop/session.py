"""The control loop: a controller makes sessions, a session takes a state each tick and returns a command."""

from __future__ import annotations

import logging
import math
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from threading import get_ident
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.declare.law import Law
from hqp.declare.price import Price
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack, require_stack
from hqp.errors import DeclarationError, ModelWarning
from hqp.explanation.counters import Counters
from hqp.explanation.notes import Note
from hqp.loop.checks import adrift, overconstrained, rehearse, require_sound
from hqp.loop.compiled import Compiler
from hqp.loop.controller import DEADLINE, Controller
from hqp.loop.document import guards
from hqp.loop.guards import Turn, alone, doubts, require
from hqp.loop.line import Guards, Line
from hqp.loop.presence import Presence
from hqp.loop.stuck import StuckWatch
from hqp.loop.tick import Tick, Times
from hqp.loop.transition import change
from hqp.numbers import number
from hqp.problem import Hierarchy, Status
from hqp.programs.envelope import require_compiled
from hqp.programs.formulation import Formulation, Program
from hqp.solvers.base import Workspace

if TYPE_CHECKING:
    from hqp.explanation.account import TickAccount
    from hqp.explanation.conflict import Conflict
    from hqp.explanation.words import Explanation
    from hqp.recorder import Recorder
    from hqp.sequence import Sequence

LOG = logging.getLogger("hqp.session")
"""Changes of status: from good to bad as warnings, back as information."""
LOG.addHandler(logging.NullHandler())


class Session:
    """A controller on one robot; keeps hold values, the last safe command and the solver's warm start.

    max_age [s]: refuse states without a ``time`` on the clock of ``time.monotonic`` (or of ``step(..., now=)``), older
    ones, and those more than 1 ms ahead.  stuck: search for stuck tasks, see ``Tick.way_out``.  One thread at a time
    may step, change the stack or explain a tick: a second one gets an error.
    """

    def __init__(
        self, controller: Controller, robot: Robot, dt: float, *, max_age: float | None = None, stuck: bool = True
    ) -> None:
        if not hasattr(robot, "joint_names"):
            raise DeclarationError("session", "not a robot", value=robot, allowed="hqp.robots.load(...)")
        require_compiled()
        self.controller, self.robot, self.dt = controller, robot, float(dt)
        self._seen = False
        self._turn: Turn = {}
        self.deadline = DEADLINE * self.dt if controller.deadline is None else controller.deadline
        self._guards = guards(robot, controller.bounds, controller.braking, self.dt, self.deadline, max_age)
        self._compiler = Compiler(controller, robot, self.dt, self._guards)
        require_sound(robot)
        compiled = self._compiler.compile(controller.stack)
        rehearse(controller.formulation, compiled.stack, robot, self.dt)
        _ = robot.tree_joints  # read off the model once, here and not in the first tick
        remarks = [("base", adrift(compiled.stack, robot)), ("contacts", overconstrained(compiled.stack, robot))]
        remarks += [(element.name, element.remark(robot)) for element in compiled.stack]
        first = self.remarks = tuple(Note(name, Status.OPTIMAL, text) for name, text in remarks if text)
        """Notes on the stack and the robot, in the first tick too; ``Controller.session`` warns of them."""
        if compiled.dropped:
            LOG.warning("%s", compiled.dropped)
            first += (Note("session", Status.OPTIMAL, compiled.dropped),)
        self.line = Line(
            Guards(
                robot=robot,
                dt=self.dt,
                ages=max_age is not None,
                turn=self._turn,
                first=first,
            ),
            compiled,
        )
        """The stack at work."""
        self._stuck = stuck
        self._watch = self._watching()
        self.ending: Callable[[], bool] | None = None
        """Ends the motion under way if there is one, and returns true; its owner calls ``stop(..., at_once=True)`` at
        its end."""
        self.stopping = ""
        """The reason of a stop that waits for that end, "" for none."""
        self._status = Status.OPTIMAL
        self._recorder: Recorder | None = None

    def _watching(self) -> StuckWatch:
        return StuckWatch(self.stack, self.dt, one_second, self._stuck)

    @property
    def stack(self) -> Stack:
        """The stack, with the elements that the controller adds."""
        return self.line.stack

    @property
    def program(self) -> Program:
        """The compiled stack."""
        return self.line.program

    @property
    def workspace(self) -> Workspace:
        """The solver at work on it."""
        return self.line.workspace

    @property
    def dropped(self) -> str:
        """Prices that the solver and limits that the robot does not support, in words."""
        return self.line.compiled.dropped

    @property
    def count(self) -> int:
        """Ticks so far."""
        return self.line.guards.count

    @property
    def counters(self) -> Counters:
        """Ticks, late and held ones, rejected data and longest times so far; any thread may read them."""
        return self.line.counters

    @property
    def heartbeat(self) -> int:
        """The number of ticks that have ended: it rises with every tick of any status.

        Any thread may read it.  A watchdog outside that sees the same value for longer than a few periods knows that
        the loop has stopped, and acts without the session: the session cannot.
        """
        return int(self.line.native.heartbeat)

    @property
    def problem(self) -> Hierarchy:
        """The hierarchy of the latest tick: live, refilled by the next step; ``problem.copy()`` is not."""
        return self.program.problem

    @property
    def hold_values(self) -> dict[str, Vec | Mat]:
        """Copies of the hold values of elements without a reference, by name; empty before the first step."""
        return self.line.hold_values

    def step(self, state: State, *references: Reference, now: float | None = None, phase: str | None = None) -> Tick:
        """Compute the command for a state, with references for this tick only.

        Data never raises: status and notes report its faults.  now [s]: the time of this tick, that of
        ``time.monotonic`` for None.  phase: name of the tick's phase; it selects levels and elements with a ``when``.
        Raises StaleState, UnknownReference, ConcurrentUse, ModelError (a state of another robot) or DeclarationError
        (a reference of another shape, a phase that is not there, a time that is no number), which are errors of the
        program.
        """
        try:
            now = now if now is None else float(now)
        except (TypeError, ValueError, OverflowError):
            raise DeclarationError("step", "bad now", value=now, unit="s", allowed="a number or None") from None
        return self._stepped(state, references, now, phase)

    def begin(self, *, command: ArrayLike, state: State | None = None) -> None:
        """Start from the command that the robot is sent now; call it before the first step, or after another source
        of commands had the robot.

        command ``(n_actuated,)`` [rad/s, rad/s^2, N m], in robot.joint_names order: rate limits, braking, and at
        velocity level the window of ``JointLimits(acceleration=)`` start from it.  state: the robot's present one, from
        which it brakes if the first state of the loop is not valid.  Without ``begin`` rates start from zero, at torque
        level from the torque that holds the robot, with a note in the first tick.  Raises DeclarationError for an
        invalid command or state, ModelError for a state of another robot.
        """
        sent = numbers("begin", "command", command, (len(self.robot.joint_names),))
        if state is not None:
            self.line.require(state, "begin")
            if not state.valid:
                raise DeclarationError("begin", f"the state is not valid: {state.fault}", allowed="a valid state")
        alone(self._turn, self, lambda: self._begun(sent, state))

    def _begun(self, command: Vec, state: State | None) -> None:
        try:
            self.line.begin(command, state)
        except ValueError as error:
            raise DeclarationError("begin", str(error), allowed="finite numbers and a valid state") from None

    def stop(self, reason: str = "stop", *, at_once: bool = False) -> None:
        """Bring the robot to rest by ``controller.braking`` from the next step on, and hold it until ``resume``.

        Ticks have the status STOPPED and a note with the reason; their references are not used, and a change of stack
        waits.  If ``ending`` must end a motion first (a Walker's walk), the stop begins at its end, and ``stopping`` is
        the reason until then; at_once: do not wait.  Any thread may call it.
        """
        self.stopping, waits = str(reason), False
        try:
            waits = not at_once and self.ending is not None and self.ending()
        finally:
            if not waits:
                self.line.native.stop(self.stopping)
                self.stopping = ""

    def resume(self) -> None:
        """End a stop: the next step solves again, from the command at rest.  Any thread may call it."""
        self.stopping = ""
        self.line.native.resume()

    @property
    def stopped(self) -> str:
        """The reason of the stop, "" while the session runs."""
        return self.line.native.stopped

    def _look(self, given: Any) -> None:
        """Warn of an implausible first state; the tick uses it unchanged."""
        self._seen = True
        for doubt in doubts(self.robot, getattr(given, "q", given)):
            warnings.warn(f"the first state of {self.robot.name}: {doubt}", ModelWarning, stacklevel=4)

    def tick(self, q: Vec, v: Vec | None = None, targets: Mapping[str, ArrayLike] | None = None) -> Tick:
        """Run a tick of arrays: ``step(robot.state(q, v), hand.at(value), ...)`` in fewer calls.

        q ``(nq,)``, v ``(nv,)``, zero for None: the state.  targets: arguments of ``at`` by the element's name.
        States of the robot that were made before become stale.  Raises the errors of ``step``, ``Robot.state``, ``at``.
        """
        return self._stepped(None, (), None, None, (q, v, {} if targets is None else targets))

    def _stepped(
        self,
        state: Any,
        references: tuple[Reference, ...],
        now: float | None,
        phase: str | None,
        arrays: tuple[Any, Any, Any] | None = None,
    ) -> Tick:
        """A tick of a state, or of arrays: q, v and targets."""
        turn, me = self._turn, get_ident()
        if turn:
            require(turn, self)
        try:  # as ``alone``, without its calls
            if turn.setdefault(None, me) != me:
                require(turn, self)
            line, tick = self.line, None
            line.guards.count += 1
            if not self._seen:
                self._look(state if arrays is None else arrays[0])
            if phase != line.guards.phase:
                if phase is not None and phase not in line.presence.known:
                    line.require_phase(phase)
                line.guards.phase = phase
            if arrays is not None:
                q, v, targets = arrays
                if self._recorder is None:
                    tick = line.tick(q, v, targets)
                if tick is None:
                    state = self.robot.state(q, v)
                    references = tuple([self._aimed(name, value) for name, value in targets.items()])
            if tick is None:
                tick = line.step(state, references, now)
                for reference in references:
                    if reference.remarks:
                        notes = [Note(reference.name, Status.OPTIMAL, remark) for remark in reference.remarks]
                        tick.add(tuple(notes))
            if line.guards.count >= self._watch.due:
                self._watch.look(line, tick)
            if tick.status is not self._status:
                self._log(tick)
            if self._recorder is not None:
                self._recorder.take(tick, references)
            return tick
        finally:
            if turn.get(None) == me:
                turn.clear()

    def _aimed(self, name: str, value: object) -> Reference:
        element: Any = self.line.find(name)
        return Reference(name) if element is None else element.at(value)

    def __contains__(self, name: str) -> bool:
        return name in self.line

    def too_large(self, state: State) -> str:
        """Describe the number of a valid state beyond ``controller.bounds``; "" if there is none."""
        return self.line.native.too_large(state.q, state.v, state.angles)

    def acceleration(self, torques: Vec) -> Vec:
        """Accelerations under these torques by the dynamics of the latest tick ``(nv,)``, at torque level only."""
        found = np.empty(self.robot.nv)
        self.line.native.acceleration(torques, found)
        return found

    def weigh(self, heavier: float) -> None:
        """Multiply the masses of the robot's links by this from the next tick on, at torque level; loads stay.

        Raises DeclarationError for a number that is not positive.
        """
        self.line.native.weigh(number("session", "heavier", heavier, 0.0, strict=True))

    def record(
        self, ticks: int = 500, on: str | Callable[[Tick], bool] = "not optimal", to: str | Path = "."
    ) -> Recorder:
        """Keep the last ticks from now on, and write them to a file in the folder ``to`` at each event.

        on: the event: "not optimal", "not solved", "held", "noted", "never" (``Recorder.dump`` still writes), or a
        function of the tick.  A thread writes the file; reading it needs no robot, and `hqp replay` solves it again.
        Raises DeclarationError for an invalid number of ticks or an unknown name.
        """
        from hqp.recorder import Recorder

        self._recorder = Recorder(self, ticks, on, to)
        return self._recorder

    def _log(self, tick: Tick) -> None:
        """Log a change of status."""
        self._status = status = tick.status
        with np.errstate(all="ignore"):
            text = "; ".join(f"{note.element}: {note.detail}" for note in tick.notes)
        LOG.log(logging.INFO if status.solved else logging.WARNING, "tick %d %s %s", self.count, status.name, text)

    def change(self, stack: Stack, over: float = 0.0) -> None:
        """Switch to another stack, at once or within ``over`` seconds at least (hqp/cpp/session/transition.hpp).

        Elements keep their hold values if class, frame, axes, observer and shape agree; all others, also returning
        ones, take new values in the next step.  A known stack is not compiled again.  During a transition the session
        accepts references for both stacks, ``tick.transition`` is its progress, and another change may begin.  At
        torque level the transition waits for a contact that cannot be unloaded without cost to a task, and a note
        names it; contacts with measured loads (``Reference.loaded``) switch without that.  Raises the errors of
        ``Controller.session``, and DeclarationError for ``over`` or if a stack on the way has no contact; the session
        is then unchanged.
        """
        require_stack("session", stack)
        alone(self._turn, self, lambda: self._changed(stack, over))

    def _changed(self, stack: Stack, over: float) -> None:
        line, kept = self.line, dict(vars(self.line))
        try:
            self.line = change(line, self._compiler, stack, over)
        except BaseException:  # an interrupt, too
            vars(line).update(kept)
            self.line = line
            raise
        self._watch = self._watching()

    def prepare(self, stack: Stack) -> None:
        """Compile a stack and the stacks on the way to it, before ``change`` needs them.

        The session keeps the latest few stacks.  Raises the errors of ``change``.
        """
        require_stack("session", stack)
        alone(self._turn, self, lambda: self._prepared(stack))

    def _prepared(self, stack: Stack) -> None:
        for point in self._compiler.way(self.line.compiled, stack)[1:]:
            self._compiler.compile(point.stack)

    @property
    def presence(self) -> Presence:
        """Phases of the stack at work, and the elements that are out in each."""
        return self.line.presence

    def obey(self, laws: Mapping[str, Law]) -> None:
        """Use these laws by element name from the next tick on, and the declared ones for all others.

        An element of the declared stack that is not at work takes its law when it is back.  Raises DeclarationError
        for an element of neither stack, and for laws as ``Sequence.run``.
        """
        if not isinstance(laws, Mapping):
            raise DeclarationError("session", "bad laws", value=laws, allowed="laws by name of a task, {} for none")
        names = {element.name for element in self.stack}
        for name, law in laws.items():
            if name in names:
                self.program.assembly.require_law(name, law)
            else:
                self.declared.find(name)
        if laws != self.line.guards.laws:  # else they go on from tick to tick
            self.line.guards.laws = dict(laws)

    @property
    def declared(self) -> Stack:
        """The stack of the controller."""
        return self.controller.stack

    def compiler(self, robot: Robot) -> Compiler:
        """Compiler of the session's stacks for another robot of the kind."""
        return Compiler(self.controller, robot, self.dt, self._guards)

    def export(
        self,
        path: str | Path,
        sequence: Sequence | None = None,
        *,
        key: bytes | None = None,
        stacks: Mapping[str, Stack] | None = None,
    ) -> None:
        """Write the session as it was declared to a file: for C++ without Python, and for ``hqp.load``.

        sequence: the file gets its phases and laws, not its events.  key: signs the file (HMAC-SHA-256), so that
        ``hqp.load`` with the same key refuses files that were changed or come from elsewhere.  stacks: by name; a
        session of the file changes to them by ``change(name, over)``, and back by ``change("", over)``.  Hold values,
        the warm start and references stay behind: a session of the file begins as a new one does.  Raises
        DeclarationError for a bad key or name, and for an element or a solver without native code, by its name
        (docs/plan_file.md), and the errors of ``Sequence.run`` and of ``change``.
        """
        from hqp.loop.file import write

        write(self, path, sequence, key, stacks)

    def explain(self, tick: Tick) -> Explanation:
        """Explain the residuals of the latest tick; raises HqpError for an earlier one, whose rows are overwritten."""
        return self.line.explain(tick)

    def account(self, tick: Tick) -> TickAccount:
        """Account of the elements that hold others back, for the latest tick; raises HqpError for an earlier one."""
        return self.line.account(tick)

    def conflict(self, tick: Tick) -> Conflict:
        """Rows of ``subject_to`` that exclude each other in the latest tick; raises HqpError for an earlier one."""
        return self.line.conflict(tick)

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a Session cannot be pickled: it holds live arrays of Pinocchio and of the solver. Pickle "
            "session.controller, the robot's name, dt and (q, v) and make a new session of them, or pickle its ticks"
        )


def one_second(stack: Stack, robot: Robot, formulation: Formulation, price: Price) -> Session:
    """Make a session for steps of one second without a deadline, for a search of configurations."""
    return Session(Controller(stack, formulation, deadline=math.inf, price=price), robot, 1.0, stuck=False)


__all__ = ["Controller", "Note", "Session", "Tick", "Times"]
