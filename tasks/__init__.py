"""Tasks and constraints, ready to be put into a stack."""

from __future__ import annotations

if __name__ != "hqp.tasks":
    raise ImportError("a second copy of the tasks would have second classes; write `import hqp.tasks`")

from .balance import Balance
from .ball_limits import BallLimits
from .closures import Ball, Hinge
from .collision import CollisionAvoidance
from .com import Com
from .compliance import Admittance, Impedance
from .cone import Cone
from .contact import FixedContact, PointContact
from .coupling import JointCoupling
from .directions import AlignAxis, Distance, LookAt
from .edge import EdgeContact
from .frame_speed import FrameVelocityLimits
from .friction import CenterOfPressure, ForceLimits, FrictionCone, UnilateralContact
from .frozen import Frozen
from .holding_torque import HoldingTorque
from .limits import JointLimits
from .load_share import LoadShare
from .loads import ExternalWrench, JointLoad, NominalTorque, Payload
from .manipulability import Manipulability
from .motion import BaseVelocityLimits, Damping, JointVelocity, LowAcceleration, Momentum
from .motors import TorqueLimits, TorqueSpeedLimits
from .orientation import Orientation
from .pose import Pose
from .position import Position
from .posture import Posture
from .prescribed import PrescribedMotion
from .support_polygon import SupportPolygon
from .targets import ContactForce, JointTorque
from .weld import Weld
from .wheel import OmniWheelContact, WheelContact
from .within import Within

__all__ = [
    "Admittance",
    "AlignAxis",
    "Balance",
    "Ball",
    "BallLimits",
    "BaseVelocityLimits",
    "CenterOfPressure",
    "CollisionAvoidance",
    "Com",
    "Cone",
    "ContactForce",
    "Damping",
    "Distance",
    "EdgeContact",
    "ExternalWrench",
    "FixedContact",
    "ForceLimits",
    "FrameVelocityLimits",
    "FrictionCone",
    "Frozen",
    "Hinge",
    "HoldingTorque",
    "Impedance",
    "JointCoupling",
    "JointLimits",
    "JointLoad",
    "JointTorque",
    "JointVelocity",
    "LoadShare",
    "LookAt",
    "LowAcceleration",
    "Manipulability",
    "Momentum",
    "NominalTorque",
    "OmniWheelContact",
    "Orientation",
    "Payload",
    "PointContact",
    "Pose",
    "Position",
    "Posture",
    "PrescribedMotion",
    "SupportPolygon",
    "TorqueLimits",
    "TorqueSpeedLimits",
    "UnilateralContact",
    "Weld",
    "WheelContact",
    "Within",
]
