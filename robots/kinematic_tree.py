"""A robot's joints and frames as native forward kinematics takes them (cpp/dynamics/kinematics.hpp)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

if TYPE_CHECKING:
    from hqp.declare.robot import Placed, TreeJoint

TURNING, CONTINUOUS, SLIDING, BALL, FREE, PLANAR, TRANSLATING = range(7)
WHOLE = {
    "JointModelSpherical": BALL,
    "JointModelFreeFlyer": FREE,
    "JointModelPlanar": PLANAR,
    "JointModelTranslation": TRANSLATING,
}


def joints(model: Any, bodies: Sequence[Any]) -> tuple[TreeJoint, ...] | None:
    """One for each body but the world; None if a joint is a screw, whose turn and slide are one coordinate."""
    found = []
    for i in range(1, model.njoints):
        joint, name = model.joints[i], model.joints[i].shortname()
        kind, axis = WHOLE.get(name), np.array([0.0, 0.0, 1.0])
        if kind is None:
            if joint.nv != 1 or name == "JointModelComposite":
                return None
            twist = unit_twist(joint)
            if np.any(twist.linear != 0.0) and np.any(np.abs(twist.angular) > 1e-12):
                return None  # a screw
            turns = bool(np.any(np.abs(twist.angular) > 1e-12))
            kind = (CONTINUOUS if joint.nq == 2 else TURNING) if turns else SLIDING
            axis = twist.angular if turns else twist.linear
        placed = _placed(int(model.parents[i]), model.jointPlacements[i], bodies[i][5])
        found.append((kind, int(joint.idx_q), int(joint.idx_v), tuple(axis.tolist()), placed))
    return tuple(found)


def unit_twist(joint: Any) -> Any:
    """Twist of the body of a joint of one coordinate at unit speed, in the joint's axes at its zero: its axis.

    In a model of its own: Pinocchio 2.7 gives single joints no data, and data of the whole model takes nv^3 numbers.
    """
    alone = pin.Model()
    alone.addJoint(0, joint, pin.SE3.Identity(), "joint")
    data = alone.createData()
    pin.forwardKinematics(alone, data, pin.neutral(alone), np.ones(1))
    return data.v[1].copy()


def frames(model: Any, views: Mapping[int, Any]) -> tuple[Placed, ...]:
    """The frames with live views of their placements, by index."""
    every = model.frames
    return tuple(_placed(int(every[i].parentJoint), every[i].placement, v) for i, v in views.items())


def _placed(parent: int, placement: Any, views: Any) -> Placed:
    rotation = placement.rotation.flatten(order="F")
    return parent, tuple(placement.translation.tolist()), tuple(rotation.tolist()), views
