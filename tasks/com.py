"""Centre of mass of the robot or of a part of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Task, Unit
from hqp.declare.reference import Given, Reference
from hqp.declare.robot import Robot, State

from .fields import check_axes, check_relative, indices
from .relative import UPRIGHT, View


@dataclass(frozen=True, kw_only=True)
class Com(Task):
    """Centre of mass c: e = c - c_ref, J = sum m_i J_i / sum m_i over the bodies meant.

    axes: the coordinates controlled, k letters of "xyz"; value and reference have as many numbers [m].
    subtree: name of a joint; the bodies it carries, divided by their own mass (not the robot's), the whole robot by
    default.  relative_to: frame in whose axes, and relative to whose origin, value, error and J are; heading: only
    its yaw turns the axes.  Raises DeclarationError for fields, JointNotFound or FrameNotFound on binding
    (Mistry 2008, eqs. 5, 6, 12; Sentis 2012, eqs. 45, 46, whose mass is that of the sum's own bodies).
    """

    axes: str = "xyz"
    subtree: str | None = None
    relative_to: str | None = None
    heading: bool = False
    units: ClassVar[tuple[Unit, ...]] = ("m",)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_axes(self, self.axes)
        check_relative(self, self.relative_to, self.heading)
        if self.subtree is not None and (not isinstance(self.subtree, str) or not self.subtree):
            raise self.invalid("subtree", self.subtree, "the name of a joint, or None for the whole robot")

    def rows(self, robot: Robot) -> int:
        """Number of axes; raises JointNotFound, FrameNotFound."""
        self._part(robot)
        if self.relative_to is not None:
            robot.frame(self.relative_to)
        return len(self.axes)

    def _part(self, robot: Robot) -> int:
        return 0 if self.subtree is None else robot.subtree(self.subtree)

    def value(self, state: State) -> Vec:
        """Centre of mass ``(k,)`` [m], in world axes or in those of ``relative_to``."""
        centre = state.com(self._part(state.robot))
        if self.relative_to is not None:
            centre = View(state, self.relative_to, self.heading).point(centre)
        return centre[indices(self.axes)]

    def jacobian(self, state: State) -> Mat:
        """J ``(k, nv)`` of the value."""
        part = self._part(state.robot)
        J = state.com_jacobian(part)
        if self.relative_to is not None:
            J = J.copy()
            J = View(state, self.relative_to, self.heading).point_jacobian(state.com(part), J)
        return J[indices(self.axes)]

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(k,)`` [m/s^2]."""
        part = self._part(state.robot)
        if self.relative_to is None:
            return state.com_drift(part)[indices(self.axes)]
        view, velocity = View(state, self.relative_to, self.heading), state.com_velocity(part)
        return view.point_drift(state.com(part), velocity, state.com_drift(part))[indices(self.axes)]

    def at(self, value: Given = None, *, velocity: Given = None, acceleration: Given = None) -> Reference:
        """Target ``(k,)`` [m] with velocity [m/s] and acceleration [m/s^2]; raises DeclarationError for shapes."""
        return self._at((len(self.axes),), value, velocity, acceleration)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes."""
        return tuple(self.axes)

    def plan(self, robot: Robot) -> plans.Com:
        """The native operation."""
        relative = plans.relative_frame(robot, self.relative_to, self.heading, UPRIGHT)
        return plans.Com(relative, self._part(robot), tuple(indices(self.axes)))
