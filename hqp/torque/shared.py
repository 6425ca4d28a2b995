"""Contacts that forces are seen at: Contacts of reaction forces: their axes, and pairs that share a load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.declare.robot import Robot
from hqp.programs.assembly import Assembly


@dataclass(frozen=True, eq=False)
class Shared:
    """An element on two contacts whose rows turn with their frames, and with the number ``share`` ``(1,)``."""

    element: Any
    contacts: tuple[Element, Element]
    parts: tuple[slice, slice]
    rotations: tuple[Mat, Mat]
    factors: tuple[float, float]
    own: slice
    share: Vec

    @classmethod
    def of(cls, element: Any, by_name: Mapping[str, Element], rows: Assembly, robot: Robot, own: slice) -> Shared:
        """Found in a stack; raises DeclarationError for contacts that are not there, or no faces."""
        contacts, parts, rotations = [], [], []
        for name in element.contacts:
            contact = named(element, name, by_name)
            part = rows.members[contact.name].part
            rotation, blocks = axes(contact, part.stop - part.start, robot)
            if len(blocks) != 2 or hasattr(contact, "force_basis"):
                raise element.invalid("contact", name, "a contact of a face, such as FixedContact")
            contacts.append(contact)
            parts.append(part)
            rotations.append(rotation)
        one, other = (-contact.weight * element.weight for contact in contacts)
        pair, places, turns = (tuple(x) for x in (contacts, parts, rotations))
        return cls(element, pair, places, turns, (one, other), own, np.array([element.share]))  # type: ignore[arg-type]


def named(element: Element, name: object, by_name: Mapping[str, Element]) -> Element:
    """The contact of that name; raises DeclarationError."""
    contact = by_name.get(str(name)) if name else None
    if contact is None:
        known = ", ".join(by_name) or "there is none"
        raise element.invalid("contact", name or None, f"a contact in subject_to: {known}")
    return contact


def axes(contact: Element, size: int, robot: Robot) -> tuple[Mat, list[slice]]:
    """Live rotation of the contact's frame and the three-row blocks of its rows that are in world axes.

    Rows of a Weld are in the axes of the frame that it is relative to, and stay there.
    """
    frame = getattr(contact, "frame", None)
    if frame is None or size < 3 or getattr(contact, "relative_to", None) is not None:
        return np.eye(3), []
    _, rotation = robot.placement(robot.frame(frame))
    return rotation, [slice(at, at + 3) for at in range(0, size - 2, 3)]
