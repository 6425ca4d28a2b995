"""An edge of a frame that stays where it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Constraint, Task
from hqp.declare.reference import Given, Reference
from hqp.declare.robot import Robot, State

from . import axes
from .fields import check_frame, set_normal, with_normal


@dataclass(frozen=True, kw_only=True)
class EdgeContact(Task, Constraint):
    """An edge of a frame stays put, free to turn about itself: five rows, those of two of its points.

    axis: the edge's direction in the frame's axes, through its origin: "x", "y", "z" or ``(3,)``.  Rows: J_v in world
    axes, then B^T R^T J_omega, B ``(3, 2)`` an orthonormal complement of the axis a in the frame.  e = ``[p - p_0, B^T
    R^T (a_0 x R a)]`` [m, rad] for small angles, for any rotation about the edge.  Position and direction at the first
    tick ``(6,)`` are held.  Raises DeclarationError for fields, FrameNotFound on binding (Mistry 2008, condition 3).
    """

    is_contact: ClassVar[bool] = True
    on_ground: ClassVar[bool] = True

    frame: str
    axis: str | tuple[float, float, float]
    normal: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_normal(self)
        check_frame(self, "frame", self.frame)
        axes.check_axis(self, self.axis)

    def _axes(self) -> tuple[Vec, Mat]:
        """Unit axis ``(3,)`` and its complement B ``(3, 2)`` in the frame's axes."""
        return axes.with_complement(self.axis)

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
        return axes.force_basis(self._axes()[1])

    def _complement(self, state: State) -> Mat:
        return state.rotation(self.frame) @ self._axes()[1]

    def at(
        self, value: Given = None, *, velocity: Given = None, acceleration: Given = None, normal: Given = None
    ) -> Reference:
        """Position and unit direction to keep ``(6,)``, the ground's motion ``(5,)``, and its normal ``(3,)``.

        Raises DeclarationError.
        """
        found = axes.line_reference(self, value, velocity, acceleration)
        return found if normal is None else with_normal(found, normal)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes, then the two tilts across the edge."""
        return axes.ROW_NAMES

    def plan(self, robot: Robot) -> plans.Edge:
        """The native operation."""
        axis, B = self._axes()
        edge, first, other = ((float(x), float(y), float(z)) for x, y, z in (axis, B[:, 0], B[:, 1]))
        return plans.Edge(plans.frame(robot, self.frame), edge, first, other)
