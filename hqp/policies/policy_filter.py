"""A filter behind a policy: its joint targets pass unchanged unless a limit or a distance is active."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mask, Vec
from hqp.declare.element import Element
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Level, Stack
from hqp.errors import DeclarationError
from hqp.estimation.rotations import exponential
from hqp.loop.controller import Controller
from hqp.loop.session import Session, Tick
from hqp.policies.braking import APPROACH, default_limits
from hqp.policies.servo import Gains, Servos, within
from hqp.programs.formulation import Velocity
from hqp.tasks import (
    CollisionAvoidance,
    JointLimits,
    JointLoad,
    JointVelocity,
    NominalTorque,
    PrescribedMotion,
    TorqueLimits,
)
from hqp.torque import Torque
from hqp.torque.holding import within_holding

Command = Literal["positions", "velocities", "torques"]

Measured = State | Sequence[State]
"""State of one robot, or of each of several."""

LARGEST = 1e6
"""Largest command that is a number, at a joint without a limit [rad, rad/s, N m]."""

IMPACT, GRAVITY = 10.0, 9.81
"""Largest force on a free base in weights, moment by an arm of 1 m; gravity [m/s^2]."""

UNLIMITED = 1e3
"""Largest torque that the model may lack at a joint without an effort limit, or with a larger one [N m]."""

HOLDING = 0.8
"""Largest share of a motor's torque that holds its joint: G1's waist cannot hold the trunk in all of its range."""

KEPT = 0.9
"""Both poles, in a tick, of the estimate of the torque that the model lacks and of its rate."""

ROUNDING = 1e-9
"""Share of a limit by which a command changes without a constraint at it."""


@dataclass(frozen=True, kw_only=True)
class PolicyFilter:
    """Limits and distances are constraints above the policy's command, which they change as contacts would:

        min (tau - tau*)^T (A + D)^-1 (tau - tau*)    subject to limits, torque limits, distances,
        (A + D) qdd + b + g = tau + d,    tau* = kp (q* - q - dt v) - kd v,    D = dt kd + dt^2 kp:

    an implicit step of servos that hold the target q* through the period; the sent target is q* + (tau - tau*) / kp.
    For torques kp = kd = 0.  d, the torques that the model lacks (contacts, friction, loads), is estimated from
    measured velocities, and so is the wrench on a floating base, which moves freely under it.  The stack computes its
    rows in the middle of the period.  By Gauss's principle of least constraint a joint at its limit changes its own
    command alone.  For velocities min |x - v*| subject to the same without torques, the base as measured.

    limits: JointLimits; by default without an acceleration window, which no policy keeps, and with the deceleration
    that each motor can provide (``default_limits``).  collision: a CollisionAvoidance, or None; for positions and
    torques ``approach`` is 150 / s unless it has one.  kp [N m/rad], kd [N m s/rad]: gains of the servos that take
    position targets, a number, one for each actuated joint or by name.
    command: kind of the policy's and the sent command, "positions" [rad], "velocities" [rad/s] or "torques" [N m].
    held: true for a floating base on a stand: torques do not change its measured motion.
    Raises DeclarationError for fields.
    """

    limits: JointLimits | None = None
    collision: CollisionAvoidance | None = None
    kp: Gains | None = None
    kd: Gains | None = None
    command: Command = "positions"
    held: bool = False

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
        if not isinstance(self.held, bool):
            raise DeclarationError("PolicyFilter", "held", value=self.held, allowed="True or False")
        if (self.kp is None or self.kd is None) and self.command == "positions":
            raise DeclarationError(
                "PolicyFilter", "kp and kd", value=(self.kp, self.kd), allowed="the gains of the servos, for positions"
            )

    def controller(self, robot: Robot, dt: float, *, deadline: float | None = None) -> Controller:
        """The stack as a controller, for a file or a batch.

        Its element ``policy`` takes v*, or tau*; ``lacking`` the load d of positions and torques.
        """
        names, servos = robot.joint_names, self.servos(robot, dt)
        base: list[Element] = [PrescribedMotion(name="base")] if robot.floating and not self.free(robot) else []
        apart: list[Element] = [] if self.collision is None else [self.collision]
        limits = default_limits(robot, self.command != "velocities") if self.limits is None else (self.limits,)
        if self.command == "velocities":
            level = Level(JointVelocity(joints=names, name="policy"), price=0)
            stack = Stack(level, subject_to=[*base, *limits, *apart])
            return Controller(stack, Velocity(), deadline=deadline, price=0)
        limited = [name for name, most in zip(names, servos.effort, strict=True) if most < math.inf]
        if self.collision is not None and self.collision.approach is None:
            apart = [replace(self.collision, approach=APPROACH)]
        forces: list[Element] = [
            *([TorqueLimits(joints=limited)] if limited else []),
            self.lacking(robot, dt),
            NominalTorque(name="policy"),
        ]
        stack, _ = within_holding(Stack(subject_to=[*base, *limits, *forces, *apart]), robot, HOLDING)
        return Controller(stack, Torque(holding=None), deadline=deadline, price=0)

    def free(self, robot: Robot) -> bool:
        """True if the robot's base moves under the torques."""
        return robot.floating and not self.held and self.command != "velocities"

    def lacking(self, robot: Robot, dt: float) -> JointLoad:
        """The load d, with D of the servos."""
        inertia = self.servos(robot, dt).stiffening.tolist()
        return JointLoad(joints=robot.joint_names, inertia=inertia, base=self.free(robot), name="lacking")

    def servos(self, robot: Robot, dt: float) -> Servos:
        """The servos of the actuated joints, with gains of zero for commands without servos."""
        kp, kd = (self.kp, self.kd) if self.command == "positions" else (None, None)
        return Servos.of("PolicyFilter", robot, robot.actuated, kp, kd, dt)

    def session(
        self, robot: Robot, dt: float, *, deadline: float | None = None, max_age: float | None = None
    ) -> PolicyFilterSession:
        """Compile for a robot at a control period dt [s]; deadline, max_age: see ``Controller``.

        Raises DeclarationError, ModelError for invalid declarations, before the loop.
        """
        session = self.controller(robot, dt, deadline=deadline).session(robot, dt, max_age=max_age, stuck=False)
        return PolicyFilterSession(self, session)


def known(numbers: Vec) -> Vec:
    """The numbers, zero for those that are not finite."""
    return np.where(np.isfinite(numbers), numbers, 0.0)


class Prediction:
    """Commands of one robot ``(n,)``, or of as many ``(count, n)`` as there are states, before and behind the stack."""

    def __init__(self, declared: PolicyFilter, robot: Robot, dt: float) -> None:
        self._kind, self._dt = declared.command, dt
        self.servos, self._own = declared.servos(robot, dt), robot.actuated
        self._forces = declared.command != "velocities"
        top = self.servos.effort if self._forces else robot.velocity_limit[self._own]
        self._rounding = ROUNDING * (1.0 + np.where(np.isfinite(top), top, 1.0))
        self._limited = self._forces & np.isfinite(self.servos.effort)
        self._largest = np.where(self._limited, np.minimum(self.servos.effort, LARGEST), LARGEST)
        self._columns, self._stiffening = declared.lacking(robot, dt).inertias(robot)
        self._first = self._columns.size - self._own.size  # of the joints, after the wrench on a free base
        weight = GRAVITY * robot.copy().state(robot.home).mass_matrix()[0, 0]
        self._most = np.append(np.full(self._first, IMPACT * weight), np.minimum(self.servos.effort, UNLIMITED))
        self._share: Vec | float = 1.0 / self.servos.kp if self._kind == "positions" else 1.0
        self.reset()

    def reset(self) -> None:
        """Discard earlier commands and estimates."""
        self._last: Vec | None = None
        self._before: tuple[Measured, Vec] | None = None
        self._rate: Vec | float = 0.0
        self.lacking: Vec = np.zeros(self._columns.size)
        """d, the torques that the model lacks, after the wrench on a free base [N m, N]."""

    def begin(self, command: ArrayLike, state: Measured) -> tuple[Vec, Vec, Vec]:
        """(command within the effort limits, torque or velocity by it, load of the joints).

        Replace invalid numbers (NaN, infinite, beyond 1e6 without a limit) by the last ones sent; in the first tick, by
        ones that hold the joint.
        """
        servos, (angles, speeds) = self.servos, self._joints(state)
        given = np.asarray(command, dtype=np.float64)
        if given.shape != angles.shape:
            raise DeclarationError("policy", "shape of the command", value=given.shape, allowed=str(angles.shape))
        measured = np.isfinite(angles) & np.isfinite(speeds)
        self._measured: Mask | Literal[True] = True if measured.all() else measured
        if self._measured is not True:
            angles, speeds = known(angles), known(speeds)
        if self._last is None:
            self._place, self.lacking = angles, np.zeros((*angles.shape[:-1], self._columns.size))
            self._last = angles if self._kind == "positions" else np.zeros(angles.shape)
            self._held = self.lacking
        valid = np.abs(given) <= self._largest  # not if NaN
        if not valid.all():
            given = np.where(valid | (np.isfinite(given) & self._limited), given, self._last)
        self._now = state, angles, speeds
        if self._kind == "velocities":
            return given, given, self.lacking
        self._estimate(state)
        if self._kind == "torques":
            given = within(given, -servos.effort, servos.effort)
            return given, given, self.lacking
        given = servos.within_effort(given, angles, speeds)
        return given, servos.torque(given, angles + self._dt * speeds, speeds), self.lacking

    def middle(self, state: Measured) -> Vec:
        """Configurations ``(nq,)``, ``(count, nq)`` in the middle of the period, at which the stack computes its rows.

        For velocities, and for an invalid state, the measured one.
        """
        if isinstance(state, Sequence):
            return np.array([self.middle(one) for one in state])
        if not self._forces or not state.valid:
            return state.q
        return state.robot.integrate(state.q, state.v, 0.5 * self._dt)

    def end(self, command: Vec, free: Vec, x: Vec, solved: bool | Mask = True) -> tuple[Vec, Mask]:
        """(command, joints that it limits), for the torque or velocity x in place of ``free``, after ``begin``.

        Without a solved answer x brings the joints to rest; servos aim at their place in the last solved tick.
        """
        (state, angles, speeds), servos, measured = self._now, self.servos, self._measured
        change = x - free
        changed = np.abs(change) > self._rounding
        sent = command + np.where(changed, change, 0.0) * self._share
        good: Mask = np.asarray(solved, dtype=bool)[..., None]
        if not good.all():
            changed = changed | ~good
            rest = x
            if self._kind == "torques":  # x holds the joints with an older d
                rest = x + (self._held - self.lacking)[..., self._first :]
            elif self._kind == "positions":
                rest = self._place + x / servos.kp
            sent = np.where(good, sent, rest)
        if measured is True and solved is True:
            self._place, self._held = angles, self.lacking
        else:
            self._place = np.where(good & measured, angles, self._place)
            self._held = np.where(good, self.lacking, self._held)
        if self._kind == "torques":
            sent = within(sent, -servos.effort, servos.effort)
        elif self._forces:
            at = angles if measured is True else np.where(measured, angles, self._place)
            sent = servos.within_effort(sent, at, speeds)
        assert self._last is not None
        finite = np.isfinite(sent)
        self._last = sent if finite.all() else np.where(finite, sent, self._last)
        if self._forces:
            tau = (
                self._last if self._kind == "torques" else servos.torque(self._last, angles + self._dt * speeds, speeds)
            )
            self._before = state, tau
        return self._last.copy(), changed

    def _joints(self, state: Measured) -> tuple[Vec, Vec]:
        """Positions and speeds of the actuated joints."""
        if isinstance(state, Sequence):
            both = [self._joints(one) for one in state]
            return np.array([angles for angles, _ in both]), np.array([speeds for _, speeds in both])
        return state.angles[self._own], state.v[self._own]

    def _estimate(self, state: Measured) -> None:
        """Estimate d and its change in a tick from the motion of the last period, without lag behind a ramp.

        The acceleration of a held base is part of it.
        """
        if self._before is None:
            return
        before, tau = self._before
        found = self._torques(before, state)
        found[..., self._first :] -= tau
        if not np.isfinite(found).all():
            found = np.where(np.isfinite(found), found, self.lacking)
        error = within(found, -self._most, self._most) - self.lacking
        both = np.empty((*error.shape[:-1], 2, error.shape[-1]))
        rate, lacking = both[..., 0, :], both[..., 1, :]
        rate[:] = self._rate + (1.0 - KEPT) ** 2 * error
        lacking[:] = within(self.lacking + (1.0 - KEPT**2) * error + rate, -self._most, self._most)
        if self._first:
            self._carry(state, both)
        self._rate, self.lacking = rate, lacking

    def _torques(self, before: Measured, state: Measured) -> Vec:
        """Torques of the model between two states, in the middle of the period."""
        if isinstance(before, Sequence):
            assert isinstance(state, Sequence)
            return np.array([self._torques(one, other) for one, other in zip(before, state, strict=True)])
        assert not isinstance(state, Sequence)
        every, v = np.zeros(state.v.size), 0.5 * (before.v + state.v)
        a = (state.v[self._columns] - before.v[self._columns]) * (1.0 / self._dt)
        every[self._columns] = a
        q = state.robot.integrate(before.q, v, 0.5 * self._dt)
        return state.robot.inverse_dynamics(q, v, every)[self._columns] + self._stiffening * a

    def _carry(self, state: Measured, torques: Vec) -> None:
        """Carry torques ``(2, k)`` on by a period: the wrench on a free base keeps its direction in the world."""
        if isinstance(state, Sequence):
            for one, own in zip(state, torques, strict=True):
                self._carry(one, own)
            return
        turn = self._dt * state.v[3:6]
        if turn @ turn < math.inf:  # not if NaN
            torques[:, :6] = (torques[:, :6].reshape(4, 3) @ exponential(turn)).reshape(2, 6)


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

    def __init__(self, declared: PolicyFilter, session: Session) -> None:
        self.declared, self.session, self.robot = declared, session, session.robot
        self._prediction = Prediction(declared, self.robot, session.dt)
        self._own = self.robot.actuated
        self._still = np.zeros(self._own.size)

    def tick(self, q: Vec, v: Vec, command: ArrayLike) -> FilteredTick:
        """One tick: measured q ``(nq,)`` and v ``(nv,)``, the policy's command ``(n,)``.  Data never raises.

        Raises DeclarationError for shapes.
        """
        return self.step(self.robot.state(q, v), command)

    def step(self, state: State, command: ArrayLike, *, now: float | None = None) -> FilteredTick:
        """One tick of a state, which carries its time if there is a ``max_age``; see ``tick``, ``Session.step``."""
        requested = np.array(command, dtype=np.float64)
        taken, free, load = self._prediction.begin(requested, state)
        if self.declared.command == "velocities":
            tick = self.session.step(state, Reference("policy", self._still, free), now=now)
            x = tick.x[self._own]
        else:
            state = self.robot.state(self._prediction.middle(state), state.v, state.time)
            tick = self.session.step(state, Reference("policy", free), Reference("lacking", load), now=now)
            x = tick.command
        sent, changed = self._prediction.end(taken, free, x, tick.status.solved)
        changed |= taken != requested
        limited: dict[str, float] = {}
        if changed.any():
            names = self.robot.joint_names
            limited = {names[i]: float(sent[i] - requested[i]) for i in changed.nonzero()[0].tolist()}
        return FilteredTick(sent, requested, limited, tick)

    @property
    def lacking(self) -> Vec:
        """Estimate of the torques that the model lacks, after the wrench on a free base ``(k,)`` [N m, N]."""
        return self._prediction.lacking.copy()

    def reset(self) -> None:
        """Discard earlier commands and estimates, but not the state of the stack's session."""
        self._prediction.reset()


__all__ = ["FilteredTick", "PolicyFilter", "PolicyFilterSession", "Prediction"]
