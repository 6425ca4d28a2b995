"""Posture: the angles of all joints, of named ones or of a group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hqp.angles import all_wrapped
from hqp.arrays import Index, Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Task, Unit
from hqp.declare.reference import Given, Reference, numbers
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError

from .fields import joint_columns, make_reference, set_names


@dataclass(frozen=True, kw_only=True)
class Posture(Task):
    """Joint positions: e = q_j - q_ref ``(k,)`` [rad or m], each row of J one coordinate of the velocity.

    A joint of several axes has the vector that leads there from its zero in one second, a ball its rotation vector;
    e is the one that leads from the reference to where it is, e = log(R_ref^T R) of a ball in its own axes, so that
    x = -gain e takes it there on the shortest way, from any side of the ball.

    joints: names of joints or of ``robot.groups``, in that order, or one such name; all single-axis joints by
    default.  Errors of continuous joints are wrapped to (-pi, pi].  Raises DeclarationError for fields,
    JointNotFound on binding (Mistry 2008, below eq. 16; Sentis 2012, eq. 56).
    """

    joints: str | Sequence[str] | None = None
    units: ClassVar[tuple[Unit, ...]] = ("rad",)

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")

    def rows(self, robot: Robot) -> int:
        """Number of joints k; raises JointNotFound."""
        return self.selection(robot).size

    def selection(self, robot: Robot) -> Index:
        """Tangent coordinates of the joints ``(k,)``; raises JointNotFound, DeclarationError for one named twice."""
        return joint_columns(self, robot, self.joints)

    def value(self, state: State) -> Vec:
        """Joint positions ``(k,)`` [rad or m]."""
        return state.angles[self.selection(state.robot)]

    def error(self, state: State, reference: Vec) -> Vec:
        """Positions minus their reference ``(k,)``, wrapped where a joint is continuous."""
        value = self.value(state)
        if reference.shape != value.shape:  # at() could not know the number of joints
            raise DeclarationError(self.name, f"value has shape {reference.shape}", allowed=f"shape {value.shape}")
        robot, picked = state.robot, self.selection(state.robot)
        if robot.positions(picked) is None:
            angles = state.angles.copy()
            angles[picked] = reference
            return robot.difference(robot.configuration(angles), state.q)[picked]
        error: Vec = value - reference
        turns = _turning(state.robot, self.selection(state.robot))
        error[turns] = all_wrapped(error[turns])
        return error

    def jacobian(self, state: State) -> Mat:
        """A row of the identity for each joint, ``(k, nv)``."""
        return np.eye(state.robot.nv)[self.selection(state.robot)]

    def drift(self, state: State) -> Vec:
        """Zero, ``(k,)``."""
        return np.zeros(self.rows(state.robot))

    def at(self, value: Given = None, *, velocity: Given = None, acceleration: Given = None) -> Reference:
        """Target ``(k,)`` [rad or m] with velocity and acceleration, all of one length; raises DeclarationError.

        k is the robot's where ``joints`` names groups or nothing: a misfit shows when the robot is known.
        """
        size = next((np.size(x) for x in (value, velocity, acceleration) if x is not None), 0)
        array = None if value is None else numbers(self.name, "value", value, (size,))
        return make_reference(self.name, size, array, velocity, acceleration)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The joints."""
        return tuple(robot.joint_name(int(c)) for c in self.selection(robot))

    def plan(self, robot: Robot) -> plans.Joints | None:
        """The native operation; none for joints of several axes."""
        return plans.Joints.of(robot, self.selection(robot))


def _turning(robot: Robot, picked: Index) -> Index:
    """Positions in ``picked`` of continuous joints."""
    return np.flatnonzero(np.isin(picked, robot.continuous))
