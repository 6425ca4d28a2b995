"""Targets for torques and contact forces: resolve internal forces, unload a foot, push on the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Index, Mat, Vec
from hqp.declare.element import Element, Quantity
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot

from .fields import motor_positions, set_names

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
"""Components of a wrench in the contact frame, in order."""


@dataclass(frozen=True, kw_only=True)
class JointTorque(Element):
    """Torques of motors: tau_j = tau_ref ``(k,)`` [N m], zero by default; in a last level, the least torque.

    joints: actuated joints or groups of them, all by default.  Raises DeclarationError for fields and for a joint
    without a motor, JointNotFound on binding.
    """

    quantity: ClassVar[Quantity] = "effort"

    joints: str | Sequence[str] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")

    def rows(self, robot: Robot) -> int:
        """Number of motors k; raises JointNotFound."""
        return self.selection(robot).size

    def selection(self, robot: Robot) -> Index:
        """Positions of the motors among ``robot.actuated``, ``(k,)``; raises JointNotFound, DeclarationError."""
        return motor_positions(self, robot, self.joints)

    def at(self, value: ArrayLike) -> Reference:
        """Torques to have ``(k,)`` [N m]; raises DeclarationError for a value that is not a vector."""
        return Reference(self.name, numbers(self.name, "value", value, (np.size(value),)))

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The joints."""
        return tuple(robot.joint_names[i] for i in self.selection(robot))


@dataclass(frozen=True, kw_only=True)
class ContactForce(Element):
    """Force of the ground on the robot at one contact: f_c = f_ref ``(k,)`` [N, N m], zero by default.

    contact: name of a contact in ``subject_to``.  components: components of the force (fx, fy, fz) or wrench (and mx,
    my, mz) in the contact frame, z along the ground normal; for a wheel x along the rolling direction, y lateral.  With
    ("fx", "fy", "mx", "my", "mz") at zero in a last level forces are vertical and centred; all six in an early level
    unload a foot before it is released.  Raises DeclarationError for fields.
    """

    quantity: ClassVar[Quantity] = "force"

    contact: str
    components: Sequence[str] = ("fx", "fy", "fz")

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.components
        if (
            not isinstance(given, (tuple, set, frozenset))
            or not given
            or len(set(given)) < len(given)
            or not {*map(str, given)} <= set(COMPONENTS)
        ):
            raise self.invalid("components", given, f"distinct names of {', '.join(COMPONENTS)}")
        object.__setattr__(self, "components", tuple(given))
        if not isinstance(self.contact, str) or not self.contact:
            raise self.invalid("contact", self.contact, "the name of a contact in the stack")

    def default_name(self) -> str:
        """The contact's name and the word force."""
        return f"{self.contact}_force"

    def rows(self, robot: Robot) -> int:
        """Number of components k."""
        return len(self.components)

    def force_rows(self, dimension: int) -> tuple[Mat, Vec, Vec]:
        """(C ``(k, dimension)``, zeros, zeros); raises DeclarationError for a moment of a point or a wheel."""
        index = [COMPONENTS.index(name) for name in self.components]
        if max(index) >= dimension:
            raise self.invalid(f"components of {self.contact}", self.components, ", ".join(COMPONENTS[:dimension]))
        return np.eye(dimension)[index], np.zeros(len(index)), np.zeros(len(index))

    def at(self, value: ArrayLike) -> Reference:
        """Force to have ``(k,)`` [N, N m]; raises DeclarationError for shapes."""
        return Reference(self.name, numbers(self.name, "value", value, (len(self.components),)))

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The components."""
        return tuple(self.components)
