"""Closures of loops: two frames of the robot that share a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Constraint, Task
from hqp.declare.reference import Given, Reference
from hqp.declare.robot import Robot, State

from .fields import check_frame
from .relative import UPRIGHT, View


@dataclass(frozen=True, kw_only=True)
class _Closure(Task, Constraint):
    """Rows of a frame in ``relative_to``, which both exist on the robot."""

    frame: str
    relative_to: str
    closed: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)
        check_frame(self, "relative_to", self.relative_to)
        if self.relative_to == self.frame:
            raise self.invalid("relative_to", self.relative_to, f"a frame other than {self.frame!r}")
        if not isinstance(self.closed, bool):
            raise self.invalid("closed", self.closed, "True or False")

    def default_name(self) -> str:
        """Both frames."""
        return f"{self.frame}_{self.relative_to}"

    @property
    def declares_hold(self) -> bool:
        """True if the origins coincide by declaration."""
        return self.closed

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
    position at the first tick is held, with ``closed`` that of the other origin, whatever the first state; ``at`` gives
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
