"""Tasks and constraints, ready to be put into a stack."""

from __future__ import annotations

if __name__ != "hqp.tasks":
    raise ImportError("a second copy of the tasks would have second classes; write `import hqp.tasks`")

from .collision import CollisionAvoidance
from .com import Com
from .contact import FixedContact, PointContact
from .coupling import JointCoupling
from .edge import EdgeContact
from .friction import CenterOfPressure, FrictionCone, UnilateralContact
from .limits import JointLimits, TorqueLimits
from .orientation import Orientation
from .pose import Pose
from .position import Position
from .posture import Posture
from .targets import ContactForce, JointTorque
from .wheel import OmniWheelContact, WheelContact

__all__ = [
    "CenterOfPressure",
    "CollisionAvoidance",
    "Com",
    "ContactForce",
    "EdgeContact",
    "FixedContact",
    "FrictionCone",
    "JointCoupling",
    "JointLimits",
    "JointTorque",
    "OmniWheelContact",
    "Orientation",
    "PointContact",
    "Pose",
    "Position",
    "Posture",
    "TorqueLimits",
    "UnilateralContact",
    "WheelContact",
]
