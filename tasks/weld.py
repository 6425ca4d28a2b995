"""Two frames that are one: closed loops, objects held by two hands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.declare.element import Constraint
from hqp.declare.reference import Reference
from hqp.declare.robot import State

from .pose import Pose


@dataclass(frozen=True, kw_only=True)
class Weld(Pose, Constraint):
    """A frame that keeps its place in another one: e = ``[p - p_ref, log(R R_ref^T)]`` [m, rad], J of a relative Pose.

    frame, relative_to: the two frames; the pose of one in the other at the first tick is held, with ``closed`` the
    identity, or the value of ``at``, a homogeneous matrix ``(4, 4)``.  In ``subject_to`` it binds; for torques it acts
    by a wrench ``(6,)`` [N, N m] on ``frame`` at its origin, and by its opposite on the other frame, in the axes of
    ``relative_to``: ``tick.contact_forces`` has it, ``ForceLimits`` and ``ContactForce`` bind it, and ``law``, else the
    ``loop_law`` of ``Torque``, feeds the error back.  Raises DeclarationError without ``relative_to`` or if the frames
    are the same, FrameNotFound on binding.
    """

    closed: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.relative_to is None:
            raise self.invalid("relative_to", None, "the name of the other frame")
        if self.relative_to == self.frame:
            raise self.invalid("relative_to", self.relative_to, f"a frame other than {self.frame!r}")
        if not isinstance(self.closed, bool):
            raise self.invalid("closed", self.closed, "True or False")

    def default_name(self) -> str:
        """Both frames."""
        return f"{self.frame}_{self.relative_to}"

    @property
    def declares_hold(self) -> bool:
        """True if the frames coincide by declaration."""
        return self.closed

    def hold(self, state: State) -> Reference:
        """Its pose in the other frame, or with ``closed`` the identity."""
        return Reference(self.name, np.eye(4)) if self.closed else super().hold(state)
