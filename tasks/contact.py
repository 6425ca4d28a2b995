"""Contacts that stay where they are: a face, a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.element import Block, Constraint, Plan, Task, Writer
from hqp.reference import Reference
from hqp.robot import Robot, State

from .fields import check_frame, target
from .live import live_view
from .pose import _FramePose


@dataclass(frozen=True, kw_only=True)
class FixedContact(_FramePose, Constraint):
    """A face of a frame stays put: J v = 0, six rows, position first, J = [J_v; J_omega] (Mistry 2008, eqs. 8, 12).

    e = [p - p_0, log(R R_0^T)] [m, rad]: fed back, so that integration does not let the contact drift.  The pose
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
        data = {"axes": [0, 1, 2], "offset": (0.0, 0.0, 0.0)}
        out.plan = Plan("point", {**live_view(robot, self.frame), **data}, (3,))
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
