"""Position of a point of a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Task, Unit
from hqp.declare.reference import Given, Reference
from hqp.declare.robot import Robot, State

from .fields import check_axes, check_frame, check_relative, indices, set_vector
from .relative import UPRIGHT, View, skew


@dataclass(frozen=True, kw_only=True)
class Position(Task):
    """Position of the point ``offset`` of a frame: e = p - p_ref, dp/dt = (J_v - [R offset]x J_omega) v.

    frame: whose point.  axes: the coordinates controlled, k letters of "xyz"; value and reference have as many
    numbers [m], in that order.  offset: the point in the frame's axes ``(3,)`` [m].  relative_to: frame in whose
    axes, and relative to whose origin, value, error and J are; heading: only its yaw turns the axes.
    Raises DeclarationError for fields, FrameNotFound for names on binding (Mistry 2008, eq. 13; Sentis 2012, eq. 54).
    """

    frame: str
    axes: str = "xyz"
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    relative_to: str | None = None
    heading: bool = False
    units: ClassVar[tuple[Unit, ...]] = ("m",)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)
        check_axes(self, self.axes)
        check_relative(self, self.relative_to, self.heading)
        set_vector(self, "offset")

    def rows(self, robot: Robot) -> int:
        """Number of axes; raises FrameNotFound."""
        robot.frame(self.frame)
        if self.relative_to is not None:
            robot.frame(self.relative_to)
        return len(self.axes)

    def value(self, state: State) -> Vec:
        """Position ``(k,)`` [m], in world axes or in those of ``relative_to``."""
        point: Vec = state.position(self.frame) + self._arm(state)
        if self.relative_to is not None:
            point = View(state, self.relative_to, self.heading).point(point)
        return point[indices(self.axes)]

    def jacobian(self, state: State) -> Mat:
        """J ``(k, nv)`` of the value."""
        arm = self._arm(state)
        J_frame = state.jacobian(self.frame)
        J = J_frame[:3] - skew(arm) @ J_frame[3:]
        if self.relative_to is not None:
            J = View(state, self.relative_to, self.heading).point_jacobian(state.position(self.frame) + arm, J)
        return J[indices(self.axes)]

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(k,)`` [m/s^2]."""
        drift = state.drift(self.frame)
        acceleration: Vec = drift[:3]
        if self.relative_to is not None or any(self.offset):
            arm, velocity = self._arm(state), state.velocity(self.frame)
            turning = skew(velocity[3:]) @ arm
            acceleration = acceleration + skew(drift[3:]) @ arm + skew(velocity[3:]) @ turning
            if self.relative_to is not None:
                view = View(state, self.relative_to, self.heading)
                point = state.position(self.frame) + arm
                acceleration = view.point_drift(point, velocity[:3] + turning, acceleration)
        return acceleration[indices(self.axes)]

    def _arm(self, state: State) -> Vec:
        arm: Vec = state.rotation(self.frame) @ np.array(self.offset)
        return arm

    def at(self, value: Given = None, *, velocity: Given = None, acceleration: Given = None) -> Reference:
        """Target ``(k,)`` [m] with velocity [m/s] and acceleration [m/s^2]; raises DeclarationError for shapes."""
        return self._at((len(self.axes),), value, velocity, acceleration)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes."""
        return tuple(self.axes)

    def plan(self, robot: Robot) -> plans.Point:
        """The native operation."""
        relative = plans.relative_frame(robot, self.relative_to, self.heading, UPRIGHT)
        own = plans.apart(plans.frame(robot, self.frame), relative)
        return plans.Point(*own, tuple(indices(self.axes)), self.offset)
