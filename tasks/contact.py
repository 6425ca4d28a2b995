"""Contacts that stay where they are: a face, a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Constraint, Task
from hqp.declare.reference import Given, Reference
from hqp.declare.robot import Robot, State

from .fields import check_frame, set_normal, with_normal
from .pose import PoseLike, _FramePose


@dataclass(frozen=True, kw_only=True)
class FixedContact(_FramePose, Constraint):
    """A face of a frame stays put: J v = 0, six rows, position first, J = [J_v; J_omega] (Mistry 2008, eqs. 8, 12).

    e = ``[p - p_0, log(R R_0^T)]`` [m, rad]: fed back, so that integration does not let the contact drift.  The pose
    at the first tick, a homogeneous matrix ``(4, 4)``, is held; ``at`` gives another, and the ground's motion if it
    moves.  normal: see PointContact.  Raises DeclarationError for fields, FrameNotFound on binding.
    """

    is_contact: ClassVar[bool] = True
    on_ground: ClassVar[bool] = True

    normal: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_normal(self)

    def at(
        self,
        value: PoseLike | None = None,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        normal: ArrayLike | None = None,
    ) -> Reference:
        """Pose to keep, a ``(4, 4)`` or (position, rotation), the ground's motion ``(6,)`` if it moves, and its normal.

        Raises DeclarationError for shapes and a zero normal.
        """
        found = super().at(value, velocity=velocity, acceleration=acceleration)
        return found if normal is None else with_normal(found, normal)


@dataclass(frozen=True, kw_only=True)
class PointContact(Task, Constraint):
    """The origin of a frame stays put, its rotation is free: J_v v = 0, three rows, e = p - p_0 [m].

    The position at the first tick ``(3,)`` is held.  normal: the surface's, in world axes ``(3,)``, vertical for None;
    ``at`` gives that of a tick.  It is the z axis of the contact's force, the frame's x axis projected on the surface
    its x axis.  Raises DeclarationError for fields, FrameNotFound on binding (Mistry 2008, eqs. 8, 9, condition 3).
    """

    is_contact: ClassVar[bool] = True
    on_ground: ClassVar[bool] = True

    frame: str
    normal: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)
        set_normal(self)

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
        self, value: Given = None, *, velocity: Given = None, acceleration: Given = None, normal: Given = None
    ) -> Reference:
        """Place to keep ``(3,)`` [m], the ground's motion if it moves, and its normal ``(3,)`` in world axes.

        Raises DeclarationError for shapes and a zero normal.
        """
        found = self._at((3,), value, velocity, acceleration)
        return found if normal is None else with_normal(found, normal)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes."""
        return ("x", "y", "z")

    def plan(self, robot: Robot) -> plans.Point:
        """The native operation."""
        return plans.Point(plans.frame(robot, self.frame), None, (0, 1, 2))
