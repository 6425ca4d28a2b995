"""Tasks and constraints, ready to be put into a stack."""

from __future__ import annotations

if __name__ != "hqp.tasks":
    raise ImportError("a second copy of the tasks would have second classes; write `import hqp.tasks`")

from .com import Com
from .contact import EdgeContact, FixedContact, PointContact
from .limits import JointLimits, TorqueLimits
from .orientation import Orientation
from .pose import Pose
from .position import Position
from .posture import Posture

__all__ = [
    "Com",
    "EdgeContact",
    "FixedContact",
    "JointLimits",
    "Orientation",
    "PointContact",
    "Pose",
    "Position",
    "Posture",
    "TorqueLimits",
]
