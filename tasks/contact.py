"""Contacts that stay where they are: a face, a point, an edge."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.element import Block, Constraint, Plan, Task, Writer
from hqp.reference import Reference, numbers
from hqp.robot import Robot, State

from .fields import check_frame, make_reference, set_vector, target
from .live import cross, live_frame, moment_row, turned
from .pose import PoseLike, as_pose, bind_world_pose, homogeneous, pose_error
from .relative import skew

_WORLD_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class _FrameContact(Task, Constraint):
    """What contacts of a frame with the ground share."""

    is_contact: ClassVar[bool] = True

    frame: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)


@dataclass(frozen=True, kw_only=True)
class FixedContact(_FrameContact):
    """A face of a frame stays put: J v = 0, six rows, position first, J = [J_v; J_omega] (Mistry 2008, eqs. 8, 12).

    e = [p - p_0, log(R R_0^T)] [m, rad]: fed back, so that integration does not let the contact drift.  The pose
    at the first tick, a homogeneous matrix ``(4, 4)``, is held.  Raises DeclarationError for fields, FrameNotFound
    on binding.
    """

    def rows(self, robot: Robot) -> int:
        """6; raises FrameNotFound."""
        robot.frame(self.frame)
        return 6

    def value(self, state: State) -> Mat:
        """Homogeneous matrix ``(4, 4)`` of the frame in the world."""
        return homogeneous(state.position(self.frame), state.rotation(self.frame))

    def error(self, state: State, reference: Mat) -> Vec:
        """[p - p_0, log(R R_0^T)] ``(6,)`` [m, rad]."""
        return pose_error(state.robot, self.value(state), reference)

    def jacobian(self, state: State) -> Mat:
        """J ``(6, nv)``, linear first, world axes."""
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
        """Pose to keep, a ``(4, 4)`` or (position, rotation), and the ground's motion ``(6,)`` if it moves.

        A rotation is a matrix ``(3, 3)`` or a quaternion xyzw.  Raises DeclarationError for anything else.
        """
        pose = None if value is None else as_pose(self.name, value)
        return make_reference(self.name, 6, pose, velocity, acceleration)

    def bind(self, robot: Robot, out: Block) -> Writer:
        """Fill twist rows in world axes."""
        return bind_world_pose(self, robot, self.frame, out)


@dataclass(frozen=True, kw_only=True)
class PointContact(_FrameContact):
    """The origin of a frame stays put, its rotation is free: J_v v = 0, three rows, e = p - p_0 [m].

    The position at the first tick ``(3,)`` is held.  Raises DeclarationError for fields, FrameNotFound on binding
    (Mistry 2008, eqs. 8, 9, condition 3).
    """

    def rows(self, robot: Robot) -> int:
        """3; raises FrameNotFound."""
        robot.frame(self.frame)
        return 3

    def value(self, state: State) -> Vec:
        """Position ``(3,)`` of the frame in the world [m]."""
        return state.position(self.frame)

    def jacobian(self, state: State) -> Mat:
        """J_v ``(3, nv)``, world axes."""
        return state.jacobian(self.frame)[:3]

    def drift(self, state: State) -> Vec:
        """dJ_v/dt v ``(3,)`` [m/s^2]."""
        return state.drift(self.frame)[:3]

    def at(
        self,
        value: ArrayLike | None = None,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Reference:
        """Place to keep ``(3,)`` [m], and the ground's motion if it moves; raises DeclarationError for shapes."""
        return self._at((3,), value, velocity, acceleration)

    def bind(self, robot: Robot, out: Block) -> Writer:
        """Fill twist rows in world axes."""
        index = robot.frame(self.frame)
        position, _ = robot.placement(index)
        data = {**live_frame(robot, self.frame), "axes": [0, 1, 2], "offset": (0.0, 0.0, 0.0)}
        out.plan = Plan("point", data, (3,))
        twist = out.use_twist(robot.support(index))
        twist[:] = np.eye(3, 6)
        flat, error, second = twist.reshape(-1), out.error, out.order == 2

        def write(state: State, reference: Reference) -> None:
            state.kinematics()
            x, y, z = position.tolist()
            flat[4] = z
            flat[5] = -y
            flat[9] = -z
            flat[11] = x
            flat[15] = y
            flat[16] = -x
            a, b, c = target(reference).tolist()
            error[0] = x - a
            error[1] = y - b
            error[2] = z - c
            if second:
                out.drift[:] = self.drift(state)

        return write


@dataclass(frozen=True, kw_only=True)
class EdgeContact(_FrameContact):
    """An edge of a frame stays put, free to turn about itself: five rows, what two of its points would give.

    axis: the edge's direction in the frame's axes, through its origin: "x", "y", "z" or ``(3,)``.  Rows: J_v in
    world axes, then B^T R^T J_omega, B ``(3, 2)`` an orthonormal complement of the axis a in the frame.
    e = [p - p_0, B^T R^T (a_0 x R a)] [m, rad] for small angles, whatever the rotation about the edge.  Position
    and direction at the first tick ``(6,)`` are held.
    Raises DeclarationError for fields, FrameNotFound on binding (Mistry 2008, condition 3).
    """

    axis: str | tuple[float, float, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.axis, str):
            if self.axis not in ("x", "y", "z"):
                raise self.bad("axis", self.axis, '"x", "y", "z" or three numbers')
            return
        set_vector(self, "axis")
        if not any(self.axis):
            raise self.bad("axis", self.axis, "a vector that is not zero")

    def _axes(self) -> tuple[Vec, Mat]:
        """Unit axis ``(3,)`` and its complement B ``(3, 2)`` in the frame's axes."""
        given = np.eye(3)["xyz".index(self.axis)] if isinstance(self.axis, str) else np.array(self.axis)
        axis: Vec = given / math.hypot(*given)
        across = skew(axis)
        first: Vec = across[int(np.argmin(np.abs(axis)))]
        first = first / math.hypot(*first)
        return axis, np.column_stack((first, across @ first))

    def rows(self, robot: Robot) -> int:
        """5; raises FrameNotFound."""
        robot.frame(self.frame)
        return 5

    def value(self, state: State) -> Vec:
        """Position [m] and direction of the edge in the world, ``(6,)``."""
        return np.concatenate((state.position(self.frame), state.rotation(self.frame) @ self._axes()[0]))

    def error(self, state: State, reference: Vec) -> Vec:
        """[p - p_0, B^T R^T (a_0 x a)] ``(5,)`` [m, rad]."""
        value = self.value(state)
        tilt = np.cross(reference[3:], value[3:])
        return np.concatenate((value[:3] - reference[:3], self._complement(state).T @ tilt))

    def jacobian(self, state: State) -> Mat:
        """J ``(5, nv)``."""
        J = state.jacobian(self.frame)
        return np.vstack((J[:3], self._complement(state).T @ J[3:]))

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(5,)`` [m/s^2, rad/s^2]."""
        drift = state.drift(self.frame)
        return np.concatenate((drift[:3], self._complement(state).T @ drift[3:]))

    def force_basis(self) -> Mat:
        """Wrench ``(6, 5)`` in the frame's axes of the forces that act along the rows."""
        basis = np.zeros((6, 5))
        basis[:3, :3], basis[3:, 3:] = np.eye(3), self._axes()[1]
        return basis

    def _complement(self, state: State) -> Mat:
        return state.rotation(self.frame) @ self._axes()[1]

    def at(
        self,
        value: ArrayLike | None = None,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Reference:
        """Position and unit direction to keep ``(6,)``, and the ground's motion ``(5,)``; raises DeclarationError."""
        line = None if value is None else numbers(self.name, "position and direction", value, (6,))
        square = 1.0 if line is None else float(line[3:] @ line[3:])
        if line is not None and math.isfinite(square) and abs(square - 1.0) > 1e-6:
            raise self.bad("direction", line[3:], "a unit vector")
        return make_reference(self.name, 5, line, velocity, acceleration)

    def bind(self, robot: Robot, out: Block) -> Writer:
        """Fill twist rows: [e, p x e] in world axes, [0, b] across the edge."""
        index = robot.frame(self.frame)
        position, rotation = robot.placement(index)
        axis, B = self._axes()
        edge, first, other = axis.tolist(), B[:, 0].tolist(), B[:, 1].tolist()
        twist = out.use_twist(robot.support(index))
        flat, error, drift, second = twist.reshape(-1), out.error, out.drift, out.order == 2

        def write(state: State, reference: Reference) -> None:
            state.kinematics()
            p, rows, line = position.tolist(), rotation.tolist(), target(reference).tolist()
            for i, u in enumerate(_WORLD_AXES):
                moment_row(flat, 6 * i, u, p)
                error[i] = p[i] - line[i]
            tx, ty, tz = cross(line[3:], turned(rows, edge))
            flat[21:24] = x, y, z = turned(rows, first)
            flat[27:30] = a, b, c = turned(rows, other)
            error[3] = x * tx + y * ty + z * tz
            error[4] = a * tx + b * ty + c * tz
            if second:
                acceleration = state.drift(self.frame)
                drift[:3] = acceleration[:3]
                tx, ty, tz = acceleration[3:].tolist()
                drift[3] = x * tx + y * ty + z * tz
                drift[4] = a * tx + b * ty + c * tz

        return write
