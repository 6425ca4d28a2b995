"""Pose of a frame: position and orientation together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.element import Block, Plan, Task, Writer
from hqp.errors import DeclarationError
from hqp.reference import Reference, numbers
from hqp.robot import Robot, State

from .fields import check_frame, check_observer, make_reference, target
from .live import Observer, live_view, moment_row
from .relative import View
from .rotations import as_rotation

PoseLike: TypeAlias = "ArrayLike | tuple[ArrayLike, ArrayLike]"
_BOTTOM = [0.0, 0.0, 0.0, 1.0]


@dataclass(frozen=True, kw_only=True)
class _FramePose(Task):
    """The six rows of a frame's pose in world axes, position first; a contact holds them, a pose task moves them."""

    frame: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)

    def rows(self, robot: Robot) -> int:
        """6; raises FrameNotFound."""
        robot.frame(self.frame)
        return 6

    def value(self, state: State) -> Mat:
        """Homogeneous matrix ``(4, 4)`` of the frame."""
        return homogeneous(state.position(self.frame), state.rotation(self.frame))

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
        pose = None if value is None else as_pose(self.name, value)
        return make_reference(self.name, 6, pose, velocity, acceleration)

    def bind(self, robot: Robot, out: Block) -> Writer:
        """Fill the twist rows [e, p x e] and [0, e] of the world axes e."""
        index = robot.frame(self.frame)
        position, rotation = robot.placement(index)
        out.plan = Plan("pose", live_view(robot, self.frame), (4, 4))
        twist = out.use_twist(robot.support(index))
        twist[:] = np.eye(6)
        flat, error, drift, second = twist.reshape(-1), out.error, out.drift, out.order == 2
        angular_error, log3 = error[3:], robot.log3

        def write(state: State, reference: Reference) -> None:
            state.kinematics()
            x, y, z = position.tolist()
            flat[4] = z
            flat[5] = -y
            flat[9] = -z
            flat[11] = x
            flat[15] = y
            flat[16] = -x
            pose = target(reference)
            (_, _, _, a), (_, _, _, b), (_, _, _, c), _ = pose.tolist()
            error[0] = x - a
            error[1] = y - b
            error[2] = z - c
            angular_error[:] = log3(rotation @ pose[:3, :3].T)
            if second:
                drift[:] = state.drift(self.frame)

        return write


@dataclass(frozen=True, kw_only=True)
class Pose(_FramePose):
    """Pose of a frame, six rows, position first: e = [p - p_ref, log(R R_ref^T)] [m, rad], J = [J_v; J_omega].

    frame: whose pose.  relative_to: frame in whose axes, and relative to whose origin, value, error and J are.
    The value is a homogeneous matrix ``(4, 4)``.  Raises DeclarationError for fields, FrameNotFound on binding
    (Mistry 2008, eq. 13).
    """

    relative_to: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_observer(self, self.relative_to)

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

    def bind(self, robot: Robot, out: Block) -> Writer:
        """Fill the twist rows [u, p x u] and [0, u] of the axes u."""
        if self.relative_to is None:
            return super().bind(robot, out)
        out.plan = Plan("pose", live_view(robot, self.frame, self.relative_to), (4, 4))
        observer = Observer(robot, self.relative_to)
        index = robot.frame(self.frame)
        position, rotation = robot.placement(index)
        twist = out.use_twist(robot.support(index) - observer.support)
        flat, angular, error, drift, second = twist[:3].reshape(-1), twist[3:, 3:], out.error, out.drift, out.order == 2
        angular_error, log3 = error[3:], robot.log3

        def write(state: State, reference: Reference) -> None:
            state.kinematics()
            observer.look()
            p, (x, y, z), back = position.tolist(), observer.position, observer.rotation.T
            x, y, z = p[0] - x, p[1] - y, p[2] - z
            pose = target(reference)
            goal = pose.tolist()
            for i, u in enumerate(observer.axes):
                moment_row(flat, 6 * i, u, p)
                error[i] = u[0] * x + u[1] * y + u[2] * z - goal[i][3]
            angular[:] = back
            angular_error[:] = log3(back @ rotation @ pose[:3, :3].T)
            if second:
                velocity, acceleration = state.velocity(self.frame).tolist(), state.drift(self.frame).tolist()
                drift[:3] = observer.point_drift(state, p, velocity[:3], acceleration[:3])
                drift[3:] = observer.turn_drift(state, velocity[3:], acceleration[3:])

        return write


def homogeneous(position: Vec, rotation: Mat) -> Mat:
    """``(4, 4)`` of a position ``(3,)`` and a rotation ``(3, 3)``."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def as_pose(element: str, value: Any) -> Mat:
    """A homogeneous matrix ``(4, 4)`` from one or from (position, rotation); raises DeclarationError."""
    if isinstance(value, (tuple, list)) and len(value) == 2:
        return homogeneous(numbers(element, "position", value[0], (3,)), as_rotation(element, value[1]))
    pose = numbers(element, "pose, unless (position, rotation),", value, (4, 4))
    if pose[3].tolist() != _BOTTOM and np.isfinite(pose).all():
        raise DeclarationError(element, "last row of a pose", value=pose[3].tolist(), allowed=str(_BOTTOM))
    as_rotation(element, pose[:3, :3])
    return pose
