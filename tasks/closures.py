"""Closures of loops: two frames of the robot that share a point, or a point and an axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Constraint, Task
from hqp.declare.reference import Given, Reference
from hqp.declare.robot import Robot, State

from . import axes
from .fields import check_frame
from .relative import UPRIGHT, View
from .two_frames import _TwoFrames


@dataclass(frozen=True, kw_only=True)
class _Closure(_TwoFrames, Task, Constraint):
    """Rows of a frame in ``relative_to``, which both exist on the robot."""

    frame: str
    relative_to: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)

    def _bind(self, robot: Robot) -> None:
        robot.frame(self.frame)
        robot.frame(self.relative_to)

    def _frames(self, robot: Robot) -> tuple[plans.Frame, plans.RelativeFrame | None]:
        relative = plans.relative_frame(robot, self.relative_to, False, UPRIGHT)
        return plans.apart(plans.frame(robot, self.frame), relative)


@dataclass(frozen=True, kw_only=True)
class Ball(_Closure):
    """A point that two frames share, as a ball joint between them: e = R_o^T (p - p_o) - p_ref ``(3,)`` [m].

    frame, relative_to: the two frames; p is the origin of the first, p_o and R_o are origin and axes of the other.  The
    position at the first tick is held, or that of the other origin with ``closed``, for any first state; ``at`` gives
    another one ``(3,)``.  J = R_o^T (J_p - J_o + [p - p_o]x J_omega_o), three rows.  For torques it acts by a force
    ``(3,)`` [N] on ``frame`` at its origin and by its opposite on the other frame, in the axes of ``relative_to``.
    Raises DeclarationError for fields, FrameNotFound on binding.
    """

    def rows(self, robot: Robot) -> int:
        """3; raises FrameNotFound."""
        self._bind(robot)
        return 3

    def value(self, state: State) -> Vec:
        """Position of the frame in ``relative_to`` ``(3,)`` [m]."""
        return View(state, self.relative_to).point(state.position(self.frame))

    def hold(self, state: State) -> Reference:
        """Its place, or with ``closed`` zero."""
        return Reference(self.name, np.zeros(3)) if self.closed else super().hold(state)

    def jacobian(self, state: State) -> Mat:
        """J ``(3, nv)``."""
        J = state.jacobian(self.frame)[:3]
        return View(state, self.relative_to).point_jacobian(state.position(self.frame), J)

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(3,)`` [m/s^2]."""
        view, place = View(state, self.relative_to), state.position(self.frame)
        return view.point_drift(place, state.velocity(self.frame)[:3], state.drift(self.frame)[:3])

    def at(self, value: Given = None, *, velocity: Given = None, acceleration: Given = None) -> Reference:
        """Position to keep ``(3,)`` [m] with its rates; raises DeclarationError for shapes."""
        return self._at((3,), value, velocity, acceleration)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes."""
        return ("x", "y", "z")

    def plan(self, robot: Robot) -> plans.Point:
        """The native operation."""
        return plans.Point(*self._frames(robot), (0, 1, 2))


@dataclass(frozen=True, kw_only=True)
class Hinge(_Closure):
    """A point and an axis that two frames share, as a hinge between them: a ``Ball`` and two rows of tilt.

    axis: a of the hinge in the axes of ``relative_to``, "x", "y", "z" or ``(3,)``, through the frame's origin.  With B
    ``(3, 2)`` its orthonormal complement and d the axis in the frame's axes, e = ``[R_o^T (p - p_o) - p_ref, B^T (a x
    R_o^T R d)]`` [m, rad] for small tilts and any angle about the axis, J = ``[J_ball; B^T R_o^T (J_omega -
    J_omega_o)]``.  p_ref and d ``(6,)`` are those of the first tick, with ``closed`` zero and a, or those of ``at``.
    For torques it acts by a wrench ``(6,)`` [N, N m] without a moment about the axis, see ``Ball``.  Raises
    DeclarationError for fields, FrameNotFound on binding.
    """

    axis: str | tuple[float, float, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        axes.check_axis(self, self.axis)

    def _axes(self) -> tuple[Vec, Mat]:
        return axes.with_complement(self.axis)

    def rows(self, robot: Robot) -> int:
        """5; raises FrameNotFound."""
        self._bind(robot)
        return 5

    def value(self, state: State) -> Vec:
        """Position of the frame in ``relative_to`` [m] and direction of the axis in the frame, ``(6,)``."""
        view = View(state, self.relative_to)
        along = state.rotation(self.frame).T @ view.rotation @ self._axes()[0]
        return np.concatenate((view.point(state.position(self.frame)), along))

    def hold(self, state: State) -> Reference:
        """Its place and direction, or with ``closed`` zero and the axis."""
        if not self.closed:
            return super().hold(state)
        return Reference(self.name, np.concatenate((np.zeros(3), self._axes()[0])))

    def error(self, state: State, reference: Vec) -> Vec:
        """[R_o^T (p - p_o) - p_ref, B^T (a x R_o^T R d)] ``(5,)`` [m, rad]."""
        view, (axis, B) = View(state, self.relative_to), self._axes()
        tilt = np.cross(axis, view.rotation.T @ state.rotation(self.frame) @ reference[3:])
        return np.concatenate((view.point(state.position(self.frame)) - reference[:3], B.T @ tilt))

    def jacobian(self, state: State) -> Mat:
        """J ``(5, nv)``."""
        view, J, B = View(state, self.relative_to), state.jacobian(self.frame), self._axes()[1]
        return np.vstack((view.point_jacobian(state.position(self.frame), J[:3]), B.T @ view.turn_jacobian(J[3:])))

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(5,)`` [m/s^2, rad/s^2]."""
        view, B = View(state, self.relative_to), self._axes()[1]
        velocity, drift = state.velocity(self.frame), state.drift(self.frame)
        linear = view.point_drift(state.position(self.frame), velocity[:3], drift[:3])
        return np.concatenate((linear, B.T @ view.turn_drift(velocity[3:], drift[3:])))

    def force_basis(self) -> Mat:
        """Wrench ``(6, 5)`` in the axes of ``relative_to`` of the forces that act along the rows."""
        return axes.force_basis(self._axes()[1])

    def at(self, value: Given = None, *, velocity: Given = None, acceleration: Given = None) -> Reference:
        """Position and unit direction to keep ``(6,)``, with their rates ``(5,)``; raises DeclarationError."""
        return axes.line_reference(self, value, velocity, acceleration)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes, then the two tilts across the hinge."""
        return axes.ROW_NAMES

    def plan(self, robot: Robot) -> plans.Hinge:
        """The native operation."""
        axis, B = self._axes()
        hinge, first, other = ((float(x), float(y), float(z)) for x, y, z in (axis, B[:, 0], B[:, 1]))
        return plans.Hinge(*self._frames(robot), hinge, first, other)
