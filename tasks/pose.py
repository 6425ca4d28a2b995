"""Pose of a frame: position and orientation together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Task, Unit
from hqp.declare.reference import Reference, numbers, target
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError

from .fields import check_frame, check_relative, make_reference
from .relative import UPRIGHT, View
from .rotations import as_rotation, is_pose

PoseLike: TypeAlias = "ArrayLike | tuple[ArrayLike, ArrayLike]"
_BOTTOM = [0.0, 0.0, 0.0, 1.0]


@dataclass(frozen=True, kw_only=True)
class _FramePose(Task):
    """The six rows of a frame's pose in world axes, position first; a contact holds them, a pose task moves them."""

    frame: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)

    @property
    def rotation_rows(self) -> int:
        """3, after the position."""
        return 3

    def rows(self, robot: Robot) -> int:
        """6; raises FrameNotFound."""
        robot.frame(self.frame)
        return 6

    def value(self, state: State) -> Mat:
        """Homogeneous matrix ``(4, 4)`` of the frame."""
        return state.pose(self.frame)

    def error(self, state: State, reference: Mat) -> Vec:
        """[p - p_ref, log(R R_ref^T)] ``(6,)`` [m, rad]."""
        pose = self.value(state)
        turn = state.robot.log3(pose[:3, :3] @ reference[:3, :3].T)
        return np.concatenate((pose[:3, 3] - reference[:3, 3], turn))

    def jacobian(self, state: State) -> Mat:
        """J ``(6, nv)``, linear first."""
        return state.jacobian(self.frame)

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(6,)`` [m/s^2, rad/s^2]."""
        return state.drift(self.frame)

    def at(
        self,
        value: PoseLike | None = None,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Reference:
        """Pose to have, a ``(4, 4)`` or (position, rotation), with velocity and acceleration ``(6,)``, linear first.

        A rotation is a matrix ``(3, 3)`` or a quaternion xyzw.  Raises DeclarationError for anything else.
        """
        if velocity is None and acceleration is None and isinstance(value, np.ndarray) and is_pose(value):
            return target(self.name, value.copy())
        remarks: list[str] = []
        pose = None if value is None else as_pose(self.name, value, remarks)
        return make_reference(self.name, 6, pose, velocity, acceleration, remarks)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes, then those of rotation."""
        return ("x", "y", "z", "rx", "ry", "rz")

    def plan(self, robot: Robot) -> plans.Pose:
        """The native operation."""
        return plans.Pose(plans.frame(robot, self.frame), None)


@dataclass(frozen=True, kw_only=True)
class Pose(_FramePose):
    """Pose of a frame, six rows, position first: e = ``[p - p_ref, log(R R_ref^T)]`` [m, rad], J = [J_v; J_omega].

    frame: whose pose.  relative_to: frame in whose axes, and relative to whose origin, value, error and J are.
    The value is a homogeneous matrix ``(4, 4)``.  Raises DeclarationError for fields, FrameNotFound on binding
    (Mistry 2008, eq. 13).
    """

    relative_to: str | None = None
    units: ClassVar[tuple[Unit, ...]] = ("m", "rad")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_relative(self, self.relative_to)

    def rows(self, robot: Robot) -> int:
        """6; raises FrameNotFound."""
        if self.relative_to is not None:
            robot.frame(self.relative_to)
        return super().rows(robot)

    def value(self, state: State) -> Mat:
        """Homogeneous matrix ``(4, 4)`` of the frame, in the world or in ``relative_to``."""
        if self.relative_to is None:
            return super().value(state)
        view = View(state, self.relative_to)
        return homogeneous(view.point(state.position(self.frame)), view.rotation.T @ state.rotation(self.frame))

    def jacobian(self, state: State) -> Mat:
        """J ``(6, nv)``, linear first."""
        J = super().jacobian(state)
        if self.relative_to is None:
            return J
        view = View(state, self.relative_to)
        return np.vstack((view.point_jacobian(state.position(self.frame), J[:3]), view.turn_jacobian(J[3:])))

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(6,)`` [m/s^2, rad/s^2]."""
        drift = super().drift(state)
        if self.relative_to is None:
            return drift
        view, velocity = View(state, self.relative_to), state.velocity(self.frame)
        linear = view.point_drift(state.position(self.frame), velocity[:3], drift[:3])
        return np.concatenate((linear, view.turn_drift(velocity[3:], drift[3:])))

    def plan(self, robot: Robot) -> plans.Pose:
        """The native operation."""
        relative = plans.relative_frame(robot, self.relative_to, False, UPRIGHT)
        return plans.Pose(*plans.apart(plans.frame(robot, self.frame), relative))


def homogeneous(position: Vec, rotation: Mat) -> Mat:
    """``(4, 4)`` of a position ``(3,)`` and a rotation ``(3, 3)``."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def as_pose(element: str, value: Any, remarks: list[str] | None = None) -> Mat:
    """A homogeneous matrix ``(4, 4)`` from one or from (position, rotation); raises DeclarationError.

    remarks: see ``as_rotation``.
    """
    if isinstance(value, (tuple, list)) and len(value) == 2:
        return homogeneous(numbers(element, "position", value[0], (3,)), as_rotation(element, value[1], remarks))
    pose = numbers(element, "pose, unless (position, rotation),", value, (4, 4))
    if is_pose(pose):
        return pose
    if pose[3].tolist() != _BOTTOM and np.isfinite(pose).all():
        raise DeclarationError(element, "last row of a pose", value=pose[3].tolist(), allowed=str(_BOTTOM))
    as_rotation(element, pose[:3, :3])
    return pose
