"""Two frames that are one: closed loops, objects held by two hands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.declare.element import Constraint
from hqp.declare.reference import Reference
from hqp.declare.robot import State

from .pose import Pose
from .two_frames import _TwoFrames


@dataclass(frozen=True, kw_only=True)
class Weld(_TwoFrames, Pose, Constraint):
    """A frame that keeps its place in another one: e = ``[p - p_ref, log(R R_ref^T)]`` [m, rad], J of a relative Pose.

    frame, relative_to: the two frames; the pose of one in the other at the first tick is held, with ``closed`` the
    identity, or the value of ``at``, a homogeneous matrix ``(4, 4)``.  In ``subject_to`` it binds; for torques it acts
    by a wrench ``(6,)`` [N, N m] on ``frame`` at its origin, and by its opposite on the other frame, in the axes of
    ``relative_to``: ``tick.contact_forces`` has it, ``ForceLimits`` and ``ContactForce`` bind it, and ``law``, else the
    ``loop_law`` of ``Torque``, feeds the error back.  Raises DeclarationError without ``relative_to`` or if the frames
    are the same, FrameNotFound on binding.
    """

    def hold(self, state: State) -> Reference:
        """Its pose in the other frame, or with ``closed`` the identity."""
        return Reference(self.name, np.eye(4)) if self.closed else super().hold(state)
