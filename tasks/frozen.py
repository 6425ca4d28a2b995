"""Joints that take no part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hqp.angles import all_wrapped
from hqp.arrays import Index, Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Inequality
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State

from .fields import joint_columns, set_names, set_number


@dataclass(frozen=True, kw_only=True)
class Frozen(Inequality):
    """Joints that stay where they were at the first tick: their columns go out of the problem as fixed variables,

        x_j = v_j + clip(-rate e - v_j, -a dt, a dt),    where x is an acceleration
        x_j = clip(-rate^2 e - 2 rate v_j, -a, a),       e = q_j - q_0,

    so that one that moves comes to rest at most at the deceleration a, and at rest in its place x_j = 0 exactly.  v is
    the velocity that was sent last, or that of the state.  Members of ``subject_to`` are bounds on x with joint limits.

    joints: joints of one axis, or groups of them.  rate [1/s].  acceleration [rad/s^2 or m/s^2]: a.
    Raises DeclarationError for fields and joints of several axes, JointNotFound on binding.
    """

    steered: ClassVar[bool] = True

    joints: str | Sequence[str]
    rate: float = 20.0
    acceleration: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")
        if self.joints is None:
            raise self.invalid("joints", None, "names of joints or groups")
        set_number(self, "rate", 0.0, strict=True)
        set_number(self, "acceleration", 0.0, strict=True)

    def rows(self, robot: Robot) -> int:
        """Number of joints k; raises JointNotFound, DeclarationError."""
        return self.selection(robot).size

    def selection(self, robot: Robot) -> Index:
        """Tangent coordinates of the joints ``(k,)``; raises JointNotFound, DeclarationError."""
        columns = joint_columns(self, robot, self.joints)
        if robot.positions(columns) is None:
            raise self.invalid("joints", self.joints, "joints of one axis")
        return columns

    def hold(self, state: State) -> Reference:
        """Joint positions ``(k,)`` [rad or m]."""
        return Reference(self.name, state.angles[self.selection(state.robot)])

    def jacobian(self, state: State, places: Vec | None = None) -> Mat:
        """A row of the identity for each joint, ``(k, nv)``."""
        return np.eye(state.robot.nv)[self.selection(state.robot)]

    def bounds(self, state: State, places: Vec | None = None) -> tuple[Vec, Vec]:
        """(-e, -e): the only way left is that to where they were."""
        e = self._off(state, places)
        return -e, -e

    def _off(self, state: State, places: Any) -> Vec:
        picked = self.selection(state.robot)
        e = state.angles[picked] - (state.angles[picked] if places is None else places)
        turning = np.isin(picked, state.robot.continuous)
        return np.where(turning, all_wrapped(e), e)

    def step_bounds(self, state: State, dt: float, order: int, places: Vec | None = None) -> tuple[Vec, Vec]:
        """(x_j, x_j) ``(k,)``."""
        picked, e = self.selection(state.robot), self._off(state, places)
        v = (state.v if state.commanded is None else state.commanded)[picked]
        if order == 1:
            most = self.acceleration * dt
            x = v + np.clip(-self.rate * e - v, -most, most)
        else:
            x = np.clip(-self.rate * self.rate * e - 2.0 * self.rate * v, -self.acceleration, self.acceleration)
        return x, x

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The joints."""
        return tuple(robot.joint_name(int(c)) for c in self.selection(robot))

    def plan(self, robot: Robot) -> plans.Frozen | None:
        """The native operation."""
        joints = plans.Joints.of(robot, self.selection(robot))
        return None if joints is None else plans.Frozen(joints, self.rate, self.acceleration)
