"""A session from a plan file, without a robot model and without Pinocchio."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import monotonic

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Vec
from hqp.declare.fingerprint import fingerprint
from hqp.declare.reference import numbers
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, HqpError, UnknownReference, closest
from hqp.explanation.counters import Counters
from hqp.explanation.notes import STATUSES, Note, of_native
from hqp.kinds import file_bytes
from hqp.loop.file import key_bytes
from hqp.problem import Status

VALUE, VELOCITY, ACCELERATION, NORMAL, LOAD, HOLD = range(6)

Target = ArrayLike | tuple[ArrayLike, ...]
"""A value, or a value with its velocity and acceleration."""


@dataclass(frozen=True, slots=True)
class LoadedTick:
    """Result of one step: command ``(n_actuated,)``, a part of the answer x, ||w|| of every level.

    held: number of ticks since the last usable answer, during which the command comes to rest.  transition: progress
    of a change of stack, 1 if none is under way.
    """

    command: Vec
    x: Vec
    residuals: Vec
    status: Status
    notes: tuple[Note, ...]
    held: int
    transition: float = 1.0


class LoadedSession:
    """The native session of a plan.  One thread at a time.

    names: elements that take a reference.  stacks: names of the stacks for ``change``.  fingerprint:
    ``hqp.fingerprint`` of the plan's robot.  key: secret of the signature, see ``load``.
    """

    def __init__(self, file: bytes, key: bytes | None = None) -> None:
        from hqp import _session as native

        secret = key_bytes(key)
        try:
            self._native = native.Session(file, secret)
        except (native.PlanError, ValueError) as error:
            raise HqpError(str(error)) from None
        self.robot, self.dt = self._native.robot, self._native.dt
        self.fingerprint = self._native.fingerprint
        self.nq, self.nv = self._native.nq, self._native.nv
        self.joint_names, self.names = tuple(self._native.joint_names), tuple(self._native.names)
        self.stacks = tuple(self._native.stacks)
        self._index = {name: k for k, name in enumerate(self.names)}
        self._sizes = self._native.sizes

    @property
    def home(self) -> Vec:
        """Home configuration of the robot's model ``(nq,)``."""
        return np.array(self._native.home)

    @property
    def counters(self) -> Counters:
        """Ticks, late and held ones, rejected data and longest times so far; any thread may read them."""
        return Counters(*self._native.counters)

    @property
    def heartbeat(self) -> int:
        """Number of ticks that have ended, see ``Session.heartbeat``."""
        return int(self._native.heartbeat)

    def step(
        self,
        q: Vec,
        v: Vec | None = None,
        targets: Mapping[str, Target] | None = None,
        phase: str | None = None,
        *,
        time: float | None = None,
        now: float | None = None,
    ) -> LoadedTick:
        """One tick for q ``(nq,)`` and v ``(nv,)``, zero for None; targets and the phase hold for this tick only.

        A target is the value of the element's reference, such as ``hand.at(p).value``, or a tuple of value, velocity
        and acceleration.  time: time of the state [s], needed by plans of a session with ``max_age``.  now: time of
        this tick [s], ``time.monotonic()`` for None.  Data never raises.  Raises UnknownReference, or DeclarationError
        for a wrong shape or an unknown phase.
        """
        try:
            self._native.phase(phase or "")
        except ValueError as error:
            raise DeclarationError("phase", str(error), value=phase) from None
        for name, target in (targets or {}).items():
            parts: Sequence[ArrayLike] = target if isinstance(target, tuple) else (target,)
            for what, part in zip((VALUE, VELOCITY, ACCELERATION), parts, strict=False):
                self._set(name, what, part)
        command, x, residuals = (np.empty(size) for size in self._sizes)
        at, speed = (np.ascontiguousarray(a, dtype=np.float64) for a in (q, np.zeros(self.nv) if v is None else v))
        if now is None:
            now = monotonic()
        try:
            status, held, notes, levels = self._native.step(at, speed, command, x, residuals, time, now)
        except (TypeError, ValueError):
            shapes = f"q {at.shape}, v {speed.shape}"
            allowed = f"q ({self.nq},), v ({self.nv},)"
            raise DeclarationError("step", "wrong shape of q or v", value=shapes, allowed=allowed) from None
        kept = residuals[:levels]
        return LoadedTick(command, x, kept, STATUSES[status], of_native(notes), held, self._native.transition)

    def change(self, stack: str, over: float = 0.0) -> None:
        """Switch to the stack of that name, "" for the first one, at once or within ``over`` seconds at least.

        As ``Session.change``, with the same numbers.  Raises DeclarationError for a name that the plan does not have
        (``Session.export(..., stacks=)``), or a bad duration.
        """
        try:
            self._native.change(stack, over)
        except ValueError as error:
            raise DeclarationError("change", str(error), value=(stack, over)) from None

    def begin(self, command: ArrayLike, q: Vec | None = None, v: Vec | None = None) -> None:
        """Start from the command ``(n_actuated,)`` that the robot is sent now; see ``Session.begin``.

        q ``(nq,)`` and v ``(nv,)``, zero for None: the state of the robot, unknown if q is None.  Raises
        DeclarationError for a wrong shape and for a command or a state that is not valid.
        """
        sent = numbers("begin", "command", command, self._sizes[:1])
        at = None if q is None else numbers("begin", "q", q, (self.nq,))
        speed = None if q is None else numbers("begin", "v", np.zeros(self.nv) if v is None else v, (self.nv,))
        try:
            self._native.begin(sent, at, speed)
        except ValueError as error:
            raise DeclarationError("begin", str(error), allowed="finite numbers and a valid state") from None

    def stop(self, reason: str = "stop") -> None:
        """Bring the robot to rest from the next step on, and hold it until ``resume``; see ``Session.stop``."""
        self._native.stop(str(reason))

    def resume(self) -> None:
        """End a stop."""
        self._native.resume()

    @property
    def stopped(self) -> str:
        """The reason of the stop, "" while the session runs."""
        return self._native.stopped

    def on(self, name: str, present: bool) -> None:
        """Activate or deactivate an element in the next step; DeclarationError for a contact at torque level."""
        self._known(name)
        try:
            self._native.say(self._index[name], present)
        except ValueError as error:
            raise DeclarationError(name, str(error).removeprefix(f"{name}: "), value=present) from None

    def hold(self, name: str, value: ArrayLike) -> None:
        """Set the hold value of an element, used from now on without a target."""
        self._set(name, HOLD, value)

    def held(self, name: str) -> Vec:
        """Hold value of an element, flat; zeros before the first step."""
        self._known(name)
        return np.array(self._native.held(self._index[name]))

    def load(self, name: str, newtons: float) -> None:
        """Set the measured load of a contact [N]."""
        self._set(name, LOAD, [newtons])

    def normal(self, name: str, normal: ArrayLike) -> None:
        """Set the ground's normal ``(3,)`` under a wheel for the next step."""
        self._set(name, NORMAL, normal)

    def _known(self, name: str) -> None:
        if name not in self._index:
            near = ", ".join(closest(name, self.names) or self.names[:3])
            raise UnknownReference(f"the plan has no element {name!r}; closest: {near}")

    def _set(self, name: str, what: int, value: ArrayLike) -> None:
        self._known(name)
        numbers = np.ascontiguousarray(value, dtype=np.float64).reshape(-1)
        try:
            self._native.set_reference(self._index[name], what, numbers)
        except ValueError as error:
            raise DeclarationError(name, str(error).removeprefix(f"{name}: "), value=np.shape(value)) from None

    def advance(self, q: Vec, v: Vec, dt: float | None = None) -> Vec:
        """Integrate the configuration ``(nq,)`` with v for dt, the period for None."""
        out = np.empty(self.nq)
        self._native.integrate(np.ascontiguousarray(q), np.ascontiguousarray(v), self.dt if dt is None else dt, out)
        return out

    def reset(self) -> None:
        """Discard warm start, hold values and last command.  A stop stays."""
        self._native.reset()


def load(path: str | os.PathLike[str], *, key: bytes | None = None, robot: Robot | None = None) -> LoadedSession:
    """Load a session from a file of ``Session.export``.

    key: secret of the signature; with it, refuse a file with another signature and a changed file.  robot: the robot
    to control; refuse a plan of another one, by joint names, limits and masses.  Raises HqpError for these, for a
    damaged file and for one of another version.
    """
    session = LoadedSession(file_bytes("load", path), key)
    if robot is not None and session.fingerprint != (own := fingerprint(robot)):
        raise HqpError(
            f"the plan was written for another robot: it has fingerprint {session.fingerprint[:12]} ({session.robot}), "
            f"this one {own[:12]} ({robot.name}); their joint names, limits or masses differ: export the plan anew"
        )
    return session
