"""Contacts that stay where they are: a face, a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Constraint, Task
from hqp.declare.reference import Given, Reference
from hqp.declare.robot import Robot, State

from .fields import check_frame
from .pose import _FramePose


@dataclass(frozen=True, kw_only=True)
class FixedContact(_FramePose, Constraint):
    """A face of a frame stays put: J v = 0, six rows, position first, J = [J_v; J_omega] (Mistry 2008, eqs. 8, 12).

    e = ``[p - p_0, log(R R_0^T)]`` [m, rad]: fed back, so that integration does not let the contact drift.  The pose
    at the first tick, a homogeneous matrix ``(4, 4)``, is held; ``at`` gives another, and the ground's motion if it
    moves.  Raises DeclarationError for fields, FrameNotFound on binding.
    """

    is_contact: ClassVar[bool] = True


@dataclass(frozen=True, kw_only=True)
class PointContact(Task, Constraint):
    """The origin of a frame stays put, its rotation is free: J_v v = 0, three rows, e = p - p_0 [m].

    The position at the first tick ``(3,)`` is held.  Raises DeclarationError for fields, FrameNotFound on binding
    (Mistry 2008, eqs. 8, 9, condition 3).
    """

    is_contact: ClassVar[bool] = True

    frame: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)

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

    def at(self, value: Given = None, *, velocity: Given = None, acceleration: Given = None) -> Reference:
        """Place to keep ``(3,)`` [m], and the ground's motion if it moves; raises DeclarationError for shapes."""
        return self._at((3,), value, velocity, acceleration)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes."""
        return ("x", "y", "z")

    def plan(self, robot: Robot) -> plans.Point:
        """The native operation."""
        return plans.Point(plans.frame(robot, self.frame), None, (0, 1, 2))
