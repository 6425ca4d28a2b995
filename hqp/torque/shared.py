"""Contacts of reaction forces: their axes on the ground, and pairs that share a load."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.declare.readable import ground_of
from hqp.declare.robot import Robot
from hqp.programs.assembly import Assembly

STEEP = math.radians(30.0)
"""Angle to the normal below which a frame's x axis gives no direction on the ground [rad]."""

ALIGNED = 1e-6
"""Sine of the angle to the normal below which an axis gives no direction, as ``kAligned`` of the native rows."""

LEANS = 45.0
"""A face leans by no more: beyond half of 90 degrees another of its axes is nearer to the normal [deg]."""


@dataclass(frozen=True, eq=False)
class Shared:
    """An element on two contacts whose rows turn with their frames, and with the number ``share`` ``(1,)``."""

    element: Any
    contacts: tuple[Element, Element]
    parts: tuple[slice, slice]
    ground: tuple[GroundAxes, GroundAxes]
    factors: tuple[float, float]
    own: slice
    share: Vec

    @classmethod
    def of(
        cls,
        element: Any,
        by_name: Mapping[str, Element],
        rows: Assembly,
        ground: Mapping[str, GroundAxes],
        own: slice,
    ) -> Shared:
        """Found in a stack; raises DeclarationError for contacts that are not there, or no faces."""
        contacts, parts = [], []
        for name in element.contacts:
            contact = named(element, name, by_name)
            part = rows.members[contact.name].part
            if len(blocks(contact, part.stop - part.start)) != 2 or hasattr(contact, "force_basis"):
                raise element.invalid("contact", name, "a contact of a face, such as FixedContact")
            contacts.append(contact)
            parts.append(part)
        one, other = (-contact.weight * element.weight for contact in contacts)
        pair, places = (tuple(x) for x in (contacts, parts))
        both = tuple(ground[contact.name] for contact in contacts)
        return cls(element, pair, places, both, (one, other), own, np.array([element.share]))  # type: ignore[arg-type]


def named(element: Element, name: object, by_name: Mapping[str, Element]) -> Element:
    """The contact of that name; raises DeclarationError."""
    contact = by_name.get(str(name)) if name else None
    if contact is None:
        known = ", ".join(by_name) or "there is none"
        raise element.invalid("contact", name or None, f"a contact in subject_to: {known}")
    return contact


@dataclass(frozen=True, eq=False)
class GroundAxes:
    """Axes of the force at a contact: the ground's normal as z, the frame's x axis projected on the ground as x.

    If x is within STEEP of the normal at home, y is the projected y axis instead.  The pyramid of a cone turns with the
    robot, and does not lean with a shank.
    rotation, normal: live, of the frame and of the ground.  first: 0 for the x axis, 1 for y.  axes: ``(3, 3)``, the
    columns x, y, z, written by every fill.
    """

    rotation: Mat
    normal: Vec
    first: int
    axes: Mat

    @classmethod
    def of(cls, contact: Element, rows: Assembly, robot: Robot) -> GroundAxes:
        """Axes of a contact of a frame."""
        frame, live = contact.frame, rows.members[contact.name].normal  # type: ignore[attr-defined]
        _, rotation = robot.placement(robot.frame(frame))
        home = robot.copy().state(robot.home).rotation(frame)
        usual = ground_of(contact)
        normal = usual.copy() if live is None else live
        return cls(rotation, normal, int(abs(float(home[:, 0] @ usual)) > math.cos(STEEP)), np.eye(3, order="F"))

    @property
    def now(self) -> Mat:
        """The axes ``(3, 3)`` of the robot's latest state, from rotation and normal."""
        for first in (self.first, 1 - self.first):
            ahead = self.rotation[:, first]
            ahead = ahead - float(ahead @ self.normal) * self.normal
            size = math.sqrt(float(ahead @ ahead))
            if size > ALIGNED:
                break
        x = ahead / size if first == 0 else np.cross(ahead / size, self.normal)
        return np.column_stack([x, np.cross(self.normal, x), self.normal])

    @property
    def parts(self) -> dict[str, Any]:
        """Arrays and numbers of the native code."""
        return {"rotation": self.rotation, "normal": self.normal, "axis": self.first, "axes": self.axes}


def blocks(contact: Element, size: int) -> list[slice]:
    """Three-row blocks of a contact's rows that are in world axes, those of forces before those of moments.

    Rows of a Weld are in the axes of the frame that it is relative to, and stay there.
    """
    turns = getattr(contact, "frame", None) is not None and getattr(contact, "relative_to", None) is None
    return [slice(at, at + 3) for at in range(0, size - 2, 3)] if turns else []


def require_standing(contacts: Sequence[Element], robot: Robot) -> None:
    """Raise DeclarationError for a face that the robot stands on at home whose z axis is far from the vertical.

    Corners of soles are in the frame's axes: with z ahead or down they are elsewhere.  Faces higher above the lowest
    contact than half of the CoM are hands that touch something later.
    """
    state = robot.copy().state(robot.home)
    heights = {c.name: float(state.position(c.frame)[2]) for c in contacts}  # type: ignore[attr-defined]
    if not heights:
        return
    ground = min(heights.values())
    reach = ground + 0.5 * (float(state.com()[2]) - ground)
    for contact in contacts:
        frame = contact.frame  # type: ignore[attr-defined]
        if contact.rows(robot) != 6 or heights[contact.name] > reach or getattr(contact, "normal", None) is not None:
            continue
        off = math.degrees(math.acos(min(max(float(state.rotation(frame)[2, 2]), -1.0), 1.0)))
        if off > LEANS:
            raise contact.invalid(
                f"z axis of the sole {frame} at home",
                f"{off:.0f} degrees off the vertical",
                f"at most {LEANS:.0f} degrees; use a frame with z up, or give normal=(x, y, z) of the surface",
            )
