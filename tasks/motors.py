"""Limits of motors: torque limits, constant or dependent on the joint speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Inequality, Quantity
from hqp.declare.robot import Robot, State

from .fields import motor_positions, set_names, set_number


@dataclass(frozen=True, kw_only=True)
class _MotorLimits(Inequality):
    """Bounds on the torques of motors, rows that each pick one of the actuated efforts."""

    quantity: ClassVar[Quantity] = "effort"

    joints: str | Sequence[str] | None = None
    scale: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")
        set_number(self, "scale", 0.0, strict=True)

    def rows(self, robot: Robot) -> int:
        """Number of motors k; raises JointNotFound."""
        return self.selection(robot).size

    def selection(self, robot: Robot) -> Index:
        """Positions of the motors among ``robot.actuated``, ``(k,)``; raises JointNotFound, DeclarationError."""
        return motor_positions(self, robot, self.joints)

    def jacobian(self, state: State) -> Mat:
        """A row of the identity on x = tau for each motor, ``(k, n_actuated)``."""
        return np.eye(state.robot.actuated.size)[self.selection(state.robot)]

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The joints."""
        return tuple(robot.joint_names[i] for i in self.selection(robot))


@dataclass(frozen=True, kw_only=True)
class TorqueLimits(_MotorLimits):
    """Motor limits: -scale tau_max <= tau <= scale tau_max, rows that each pick one of the actuated efforts.

    joints: actuated joints or groups of them, all by default.  scale: fraction of the robot's limits that may be
    used.  Raises DeclarationError for fields and for a joint without a motor, JointNotFound on binding.
    """

    def bounds(self, state: State) -> tuple[Vec, Vec]:
        """The motors' limits, ``(k,)`` each [N m]."""
        robot = state.robot
        limit = self.scale * robot.effort_limit[robot.actuated][self.selection(robot)]
        return -limit, limit

    def plan(self, robot: Robot) -> plans.Constant:
        """The limits, which never change."""
        limit = self.scale * robot.effort_limit[robot.actuated][self.selection(robot)]
        return plans.Constant(-limit, limit)


@dataclass(frozen=True, kw_only=True)
class TorqueSpeedLimits(_MotorLimits):
    """The torque-speed line of motors: in the direction of motion |tau| falls from the stall torque to nothing,

        s tau <= scale tau_max min(1, (w_0 - |v|) / (w_0 - w_c)),  at least 0,    s tau >= -scale tau_max,  s = sign v,

    w_c = corner w_0: up to w_c all of the torque is there, at the no-load speed w_0 nothing is; braking has all of it.

    joints: actuated joints or groups, all by default.  scale: share of the robot's effort limits tau_max [N m].
    corner: from 0 (a motor without a current limit), below 1.  no_load [rad/s or m/s]: w_0, the robot's speed limits
    for None; a joint without one keeps its torque at any speed.  Use it in place of ``TorqueLimits``.
    Raises DeclarationError for fields and for a joint without a motor, JointNotFound on binding.
    """

    corner: float = 0.5
    no_load: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "corner", 0.0, below=1.0)
        if self.no_load is not None:
            set_number(self, "no_load", 0.0, strict=True)

    def bounds(self, state: State) -> tuple[Vec, Vec]:
        """(lower, upper) of the torques ``(k,)`` [N m]."""
        robot, motors = state.robot, self.selection(state.robot)
        columns = robot.actuated[motors]
        most, v = self.scale * robot.effort_limit[columns], robot.actuation[motors] @ state.v
        fastest = robot.velocity_limit[columns] if self.no_load is None else np.full(columns.size, self.no_load)
        with np.errstate(invalid="ignore"):
            share = np.clip((fastest - np.abs(v)) / (fastest * (1.0 - self.corner)), 0.0, 1.0)
            driven = np.where(np.isinf(fastest), most, np.where(share > 0.0, most, 0.0) * share)
        return np.where(v < 0.0, -driven, -most), np.where(v > 0.0, driven, most)
