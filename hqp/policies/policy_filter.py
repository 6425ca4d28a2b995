"""A filter behind a policy: its joint targets pass unchanged unless a limit or a distance is active."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from hqp import _session
from hqp.arrays import Index, Mat, Vec
from hqp.declare.element import Element
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Level, Stack
from hqp.errors import DeclarationError, ModelError
from hqp.loop.controller import Controller
from hqp.loop.file import write
from hqp.loop.session import Session, Tick
from hqp.policies.braking import APPROACH, default_limits
from hqp.policies.servo import Gains, Servos
from hqp.programs.formulation import Velocity
from hqp.tasks import (
    CollisionAvoidance,
    JointCoupling,
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

KINDS: tuple[Command, ...] = get_args(Command)

LARGEST = 1e6
"""Largest command that is a number, at a joint without a limit [rad, rad/s, N m]."""

IMPACT = 100.0
"""Largest force on a free base for its mass, moment by an arm of 1 m [m/s^2]."""

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
        dynamics = self.command != "velocities"
        limits: tuple[JointLimits, ...]
        if self.limits is None:
            limits = default_limits(robot, dynamics, dynamics and not self.free(robot))
        else:
            limits = (self.limits,)
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

    def tree(self, robot: Robot, dt: float) -> dict[str, Any]:
        """Parts of the native filter, over the arrays of this robot.

        Raises DeclarationError for a robot with a joint that native kinematics lack.
        """
        if robot.tree_joints is None:
            raise DeclarationError(
                "PolicyFilter", f"{robot.name} has a screw joint", allowed="joints of native kinematics"
            )
        servos, own, forces = self.servos(robot, dt), robot.actuated, self.command != "velocities"
        columns, stiffening = self.lacking(robot, dt).inertias(robot)
        top = servos.effort if forces else robot.velocity_limit[own]
        limited = forces & np.isfinite(servos.effort)  # commands of any size, whose torque is limited
        wrench = np.full(columns.size - own.size, IMPACT * robot.mass)
        passive, transmitted = coupled(robot)
        return {
            "kind": KINDS.index(self.command), "dt": dt, "kept": KEPT, "columns": columns.tolist(),
            "kp": servos.kp.tolist(), "kd": servos.kd.tolist(), "effort": servos.effort.tolist(),
            "largest": np.where(limited, math.inf, LARGEST).tolist(),
            "rounding": (ROUNDING * (1.0 + np.where(np.isfinite(top), top, 1.0))).tolist(),
            "stiffening": stiffening.tolist(),
            "passive": passive.tolist(), "transmitted": transmitted.ravel().tolist(),
            "most": np.append(wrench, np.minimum(servos.effort, UNLIMITED)).tolist(),
            "model": {
                "nq": robot.nq, "nv": robot.nv, "joints": robot.tree_joints, "bodies": robot.bodies,
                "twists": robot.joint_twists, "inertias": robot.inertias, "rotors": robot.rotors.tolist(),
                "gravity": robot.gravity.tolist(),
            },
        }  # fmt: skip

    def session(
        self, robot: Robot, dt: float, *, deadline: float | None = None, max_age: float | None = None
    ) -> PolicyFilterSession:
        """Compile for a robot at a control period dt [s]; deadline, max_age: see ``Controller``.

        Raises DeclarationError, ModelError for invalid declarations, before the loop.
        """
        session = self.controller(robot, dt, deadline=deadline).session(robot, dt, max_age=max_age, stuck=False)
        return PolicyFilterSession(self, session)


def coupled(robot: Robot) -> tuple[Index, Mat]:
    """Coordinates of joints without a motor ``(p,)``, and G ``(p, n)``: their rates are G times those of the motors'.

    G of joints that no coupling of the robot's file determines is zero.
    """
    rows = [one.jacobian(robot.past(robot.home)) for one in robot.couplings if isinstance(one, JointCoupling)]
    C = np.vstack([np.zeros((0, robot.nv)), *rows])
    passive = np.setdiff1d(np.arange(6 if robot.floating else 0, robot.nv), robot.actuated)
    return passive, -np.linalg.pinv(C[:, passive]) @ C[:, robot.actuated]


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
        self._twin = session.robot.copy()  # native kinematics write its arrays
        self._native = _session.Filter(declared.tree(self._twin, session.dt))
        self._forces = declared.command != "velocities"
        self._still = np.zeros(self.robot.actuated.size)

    def tick(self, q: Vec, v: Vec, command: ArrayLike) -> FilteredTick:
        """One tick: measured q ``(nq,)`` and v ``(nv,)``, the policy's command ``(n,)``.  Data never raises.

        Raises ModelError, DeclarationError for shapes.
        """
        return self._stepped(q, v, None, command, None)

    def step(self, state: State, command: ArrayLike, *, now: float | None = None) -> FilteredTick:
        """One tick of a state, which carries its time if there is a ``max_age``; see ``tick``, ``Session.step``."""
        if state.robot is not self.robot:
            raise ModelError(f"the state belongs to {state.robot!r}, the filter runs on {self.robot!r}")
        return self._stepped(state.q, state.v, state.time, command, now)

    def _stepped(self, q: Vec, v: Vec, time: float | None, command: ArrayLike, now: float | None) -> FilteredTick:
        native, requested = self._native, np.array(command, dtype=np.float64)
        try:
            native.begin(requested, q, v)
        except (TypeError, ValueError):
            given = self.robot.state(q, v)  # raises for shapes
            if requested.shape != self._still.shape:
                raise DeclarationError(
                    "policy", "shape of the command", value=requested.shape, allowed=str(self._still.shape)
                ) from None
            q, v = given.q, given.v
            native.begin(requested, q, v)
        state, free = self.robot.state(native.middle, v, time), native.free.copy()
        if self._forces:
            lacking = Reference("lacking", native.lacking.copy())
            tick = self.session.step(state, Reference("policy", free), lacking, now=now)
        else:
            tick = self.session.step(state, Reference("policy", self._still, free), now=now)
        sent = np.empty(self._still.size)
        limited: dict[str, float] = {}
        if native.end(tick.command, tick.status.solved, sent):
            names, change = self.robot.joint_names, (sent - requested).tolist()
            limited = {names[i]: change[i] for i in native.limited.nonzero()[0].tolist()}
        return FilteredTick(sent, requested, limited, tick)

    @property
    def lacking(self) -> Vec:
        """Estimate of the torques that the model lacks, after the wrench on a free base ``(k,)`` [N m, N]."""
        return self._native.lacking.copy()

    def reset(self) -> None:
        """Discard earlier commands and estimates, but not the state of the stack's session."""
        self._native.reset()

    def export(self, path: str | Path, *, key: bytes | None = None) -> None:
        """Write filter and stack to a file: for C++ without Python (``FilterSession``) and for ``PolicyFilters.load``.

        key: see ``Session.export``, with its errors.
        """
        write(self.session, path, key=key, more=self.parts())

    def parts(self) -> dict[str, Any]:
        """Parts of a file besides the stack."""
        return {"filter": self.declared.tree(self.robot.copy(), self.session.dt)}


__all__ = ["FilteredTick", "PolicyFilter", "PolicyFilterSession"]
