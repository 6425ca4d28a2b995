"""A filter behind a policy: its joint targets pass unchanged unless a limit or a distance is active."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mask, Vec
from hqp.declare.element import Element
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Level, Stack
from hqp.errors import DeclarationError
from hqp.loop.controller import Controller
from hqp.loop.session import Session, Tick
from hqp.policies.braking import default_limits
from hqp.policies.servo import Gains, Servos, within
from hqp.programs.formulation import Velocity
from hqp.tasks import CollisionAvoidance, JointLimits, JointTorque, JointVelocity, PrescribedMotion, TorqueLimits
from hqp.torque import Torque

Command = Literal["positions", "velocities", "torques"]

FASTEST = 1e6
"""Largest velocity of a policy that is not replaced [rad/s]."""

UNLIMITED = 1e3
"""Largest remaining torque of a joint without an effort limit, or with a larger one [N m]."""

BLEND = 0.1
"""Share of a new estimate of the remaining torque in a tick."""

SLOWING = 0.1
"""Time constant in which torques lead joints back to the braking motion [s]."""


@dataclass(frozen=True, kw_only=True)
class PolicyFilter:
    """The policy's command is the lowest level, limits and distances are constraints above it:

        min |x - v+(command)|    subject to limits, distances, the measured motion of a floating base,

    x the velocity of the actuated joints at the end of the period, v+ the one by the command (``Servos``;
    for torques kp = kd = 0).  The change of the command moves v+ to x; it is zero if no constraint binds.

    limits: JointLimits; by default without an acceleration window, which no policy keeps, and with the deceleration
    that each motor can provide (``default_limits``).  collision: a CollisionAvoidance, or None.  kp [N m/rad], kd
    [N m s/rad]: gains of the servos that take position targets, a number, one for each actuated joint or by name.
    command: kind of the policy's and the sent command, "positions" [rad], "velocities" [rad/s] or "torques" [N m].
    coupled: for torques of a robot whose base is fixed, take the whole dynamics and the motors' limits in place of one
    inertia for each joint: min |tau - command| subject to the same, so that limits hold if a joint pulls others along;
    it knows no forces from outside.
    Raises DeclarationError for fields.
    """

    limits: JointLimits | None = None
    collision: CollisionAvoidance | None = None
    kp: Gains | None = None
    kd: Gains | None = None
    command: Command = "positions"
    coupled: bool = False

    def __post_init__(self) -> None:
        if self.limits is not None and not isinstance(self.limits, JointLimits):
            raise DeclarationError("PolicyFilter", "limits", value=self.limits, allowed="JointLimits(...) or None")
        if self.collision is not None and not isinstance(self.collision, CollisionAvoidance):
            raise DeclarationError(
                "PolicyFilter", "collision", value=self.collision, allowed="CollisionAvoidance(...) or None"
            )
        if self.command not in ("positions", "velocities", "torques"):
            raise DeclarationError(
                "PolicyFilter", "command", value=self.command, allowed='"positions", "velocities" or "torques"'
            )
        if self.coupled and self.command != "torques":
            raise DeclarationError("PolicyFilter", "coupled", value=self.coupled, allowed='True for "torques" alone')
        if (self.kp is None or self.kd is None) and self.command == "positions":
            raise DeclarationError(
                "PolicyFilter", "kp and kd", value=(self.kp, self.kd), allowed="the gains of the servos, for positions"
            )

    def controller(self, robot: Robot, *, deadline: float | None = None) -> Controller:
        """The stack as a controller, for a file or a batch; its lowest element is ``policy``."""
        if self.coupled and robot.floating:
            allowed = f"False on {robot.name}, whose feet bear forces that it does not know"
            raise DeclarationError("PolicyFilter", "coupled", value=self.coupled, allowed=allowed)
        motors = JointTorque(joints=robot.joint_names, name="policy")
        policy = motors if self.coupled else JointVelocity(joints=robot.joint_names, name="policy")
        base = [PrescribedMotion(name="base")] if robot.floating else []
        apart = [] if self.collision is None else [self.collision]
        limited = [
            name for name, most in zip(robot.joint_names, robot.effort_limit[robot.actuated], strict=True) if most > 0.0
        ]
        effort = [TorqueLimits(joints=limited)] if self.coupled and limited else []
        limits = default_limits(robot, self.coupled) if self.limits is None else (self.limits,)
        subject_to: list[Element] = [*base, *limits, *effort, *apart]
        stack = Stack(Level(policy, price=0), subject_to=subject_to)
        return Controller(stack, Torque(holding=None) if self.coupled else Velocity(), deadline=deadline, price=0)

    def servos(self, robot: Robot, dt: float) -> Servos:
        """The servos of the actuated joints; unit gains for commands without servos."""
        kp, kd = (1.0, 0.0) if self.kp is None or self.kd is None else (self.kp, self.kd)
        return Servos.of("PolicyFilter", robot, robot.actuated, kp, kd, dt)

    def session(
        self, robot: Robot, dt: float, *, deadline: float | None = None, max_age: float | None = None
    ) -> PolicyFilterSession:
        """Compile for a robot at a control period dt [s]; deadline, max_age: see ``Controller``.

        Raises DeclarationError, ModelError for invalid declarations, before the loop.
        """
        session = self.controller(robot, deadline=deadline).session(robot, dt, max_age=max_age, stuck=False)
        return PolicyFilterSession(self, session, self.servos(robot, dt))


def known(numbers: Vec) -> Vec:
    """The numbers, zero for those that are not finite."""
    return np.where(np.isfinite(numbers), numbers, 0.0)


class Prediction:
    """Commands of one robot ``(n,)`` or of many ``(count, n)``, before and behind the stack."""

    def __init__(self, declared: PolicyFilter, servos: Servos) -> None:
        self._kind, self._coupled, self.servos = declared.command, declared.coupled, servos
        self.reset()

    def reset(self) -> None:
        """Discard earlier commands and estimates."""
        self._last: Vec | None = None
        self._before: Vec | None = None
        self._rest: Vec | float = 0.0
        self._path: Vec | float = 0.0
        self._rate: Vec | float = 0.0

    def begin(self, command: ArrayLike, q: Vec, v: Vec) -> tuple[Vec, Vec]:
        """(command within the effort limits, velocity by it), from joint positions and velocities; if coupled, the
        command twice.

        Replace invalid numbers (NaN, infinite) by the last ones sent; in the first tick, by ones that hold the joint.
        """
        given = np.asarray(command, dtype=np.float64)
        if given.shape != q.shape:
            raise DeclarationError("policy", "shape of the command", value=given.shape, allowed=str(q.shape))
        self._observe(q, v)
        if self._last is None:
            self._path = known(q)
            self._last = known(q) if self._kind == "positions" else np.zeros(q.shape)
        finite = np.isfinite(given)
        if not finite.all():
            given = np.where(finite, given, self._last)
        servos = self.servos
        if self._kind == "velocities":
            given = within(given, -FASTEST, FASTEST)
            return given, given
        q, v = known(q), known(v)
        if self._kind == "torques":
            given = within(given, -servos.effort, servos.effort)
            if self._coupled:
                return given, given
            return given, v + servos.dt * (given + self._rest) / servos.inertia
        given = servos.within_effort(given, q, v)
        return given, servos.velocity(given, q, v, self._rest)

    def end(self, command: Vec, free: Vec, x: Vec, q: Vec, v: Vec, solved: Any = True) -> Vec:
        """Command for the velocity x in place of ``free``; if the tick is not solved, for the braking velocity x.

        Then tau = I ((x - x-) / dt + 2 (x - v) / T + (p - q) / T^2) - d within the effort limits: x- is the x before,
        p its integral from the last solved tick on, T = 0.1 s.  Without q and v servos aim at p, with the torque -d,
        and torques lack the middle terms.  If coupled, x and ``free`` are torques, and an x that is not solved is sent.
        """
        servos, measured = self.servos, np.isfinite(q) & np.isfinite(v)
        usual = bool(measured.all() and (solved if isinstance(solved, bool) else solved.all()))
        if not usual:
            q, v, solved = known(q), known(v), np.asarray(solved)[..., None]
        if self._kind == "velocities":
            sent = command + (x - free)
        elif self._coupled:
            sent = within(command + (x - free), -servos.effort, servos.effort)
        elif self._kind == "torques":
            sent = within(command + (x - free) * servos.inertia / servos.dt, -servos.effort, servos.effort)
        else:
            sent = servos.within_effort(servos.shifted(command, x - free), q, v)
        assert self._last is not None
        if usual:  # the same numbers in fewer operations
            self._before, path = v.copy(), q
        else:
            sent = np.where(solved, sent, self._slowed(x, q, v, measured))
            self._before = np.where(measured, v, math.nan)
            path = np.where(measured & solved, q, self._path)
        finite = np.isfinite(sent)
        self._last = sent if finite.all() else np.where(finite, sent, self._last)
        self._path, self._rate = path + servos.dt * x, x
        return self._last.copy()

    def _slowed(self, x: Vec, q: Vec, v: Vec, measured: Mask) -> Vec:
        """Command of joints on their way to rest."""
        servos, p, T = self.servos, self._path, max(SLOWING, 2.0 * self.servos.dt)
        if self._kind == "velocities" or self._coupled:
            return x
        back = np.where(measured, 2.0 * (x - v) / T + (p - q) / T**2, 0.0)
        change = (x - self._rate) / servos.dt + back
        tau = within(servos.inertia * change - self._rest, -servos.effort, servos.effort)
        if self._kind == "torques":
            return np.asarray(tau)
        return np.where(measured, servos.target(tau, q, x), p + (servos.kd * x - self._rest) / servos.kp)

    def _observe(self, q: Vec, v: Vec) -> None:
        """Estimate d, the torque that the servos' model lacks: gravity, contacts, other joints."""
        if self._before is None or self._coupled or self._kind == "velocities":
            return
        servos, v_then = self.servos, self._before
        assert self._last is not None
        own = self._last if self._kind == "torques" else servos.kp * (self._last - q) - servos.kd * v
        found = servos.inertia * (v - v_then) / servos.dt - own
        most = np.minimum(servos.effort, UNLIMITED)
        found = np.where(np.isfinite(found), within(found, -most, most), self._rest)
        self._rest = self._rest + BLEND * (found - self._rest)


@dataclass(frozen=True, eq=False)
class FilteredTick:
    """Command to send, ``(n,)`` in the order of ``robot.joint_names``; requested: the policy's command, NaN if invalid.

    limited: change of the command by joint (sent - requested, NaN for an invalid command).  tick: the stack's tick,
    whose ``explain()`` names limits and pairs.
    """

    command: Vec
    requested: Vec
    limited: dict[str, float]
    tick: Tick


class PolicyFilterSession:
    """Filter of one robot; ``session`` is that of its stack."""

    def __init__(self, declared: PolicyFilter, session: Session, servos: Servos) -> None:
        self.declared, self.session, self.robot = declared, session, session.robot
        self._prediction = Prediction(declared, servos)
        own = self._own = self.robot.actuated
        self._still = np.zeros(own.size)
        top = self.robot.velocity_limit[own]
        top = self._prediction.servos.effort if declared.coupled else top
        self._speed = 1e-9 * (1.0 + np.where(np.isfinite(top), top, 1.0))

    def tick(self, q: Vec, v: Vec, command: ArrayLike) -> FilteredTick:
        """One tick: measured q ``(nq,)`` and v ``(nv,)``, the policy's command ``(n,)``.  Data never raises.

        Raises DeclarationError for shapes.
        """
        return self.step(self.robot.state(q, v), command)

    def step(self, state: State, command: ArrayLike, *, now: float | None = None) -> FilteredTick:
        """One tick of a state, which carries its time if there is a ``max_age``; see ``tick``, ``Session.step``."""
        own, requested = self._own, np.array(command, dtype=np.float64)
        q, v = state.angles[own], state.v[own]
        taken, free = self._prediction.begin(requested, q, v)
        coupled = self.declared.coupled
        reference = Reference("policy", free) if coupled else Reference("policy", self._still, free)
        tick = self.session.step(state, reference, now=now)
        x, solved = tick.command if coupled else tick.x[own], tick.status.solved
        sent = self._prediction.end(taken, free, x, q, v, solved)
        changed = (np.abs(x - free) > self._speed) | (taken != requested)
        if not solved:
            changed[:] = True
        limited: dict[str, float] = {}
        if changed.any():
            names = self.robot.joint_names
            limited = {names[i]: float(sent[i] - requested[i]) for i in changed.nonzero()[0].tolist()}
        return FilteredTick(sent, requested, limited, tick)

    def reset(self) -> None:
        """Discard earlier commands and estimates, but not the state of the stack's session."""
        self._prediction.reset()


__all__ = ["FilteredTick", "PolicyFilter", "PolicyFilterSession", "Prediction"]
