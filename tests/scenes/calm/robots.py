"""Robots for closed loops: contacts, hands, and start configurations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

import hqp
from hqp.arrays import Vec
from hqp.declare.element import Element
from hqp.robots import Robot
from hqp.tasks import FixedContact, PointContact

HUMANOIDS = ("cbi", "talos", "g1")
ARMS = ("ur5", "panda")
OTHERS = ("icub", "romeo", "tiago", "anymal", "solo12")
ROBOTS = (*HUMANOIDS, *ARMS, *OTHERS)


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot with its contacts, the frames of its hands, its base and the direction of reaching ``(3,)``."""

    robot: Robot
    contacts: tuple[Element, ...]
    hands: tuple[str, ...]
    base: str | None
    ahead: Vec

    @property
    def feet(self) -> tuple[str, ...]:
        """Frames of the contacts."""
        return tuple(getattr(contact, "frame", "") for contact in self.contacts)


_ARMS = {  # hand frame, start
    "ur5": ("tool0", (0.0, -1.0, 1.4, -0.4, 1.57, 0.0)),
    "panda": ("panda_hand_tcp", None),
    "tiago": ("arm_tool_link", (0.15, 0.2, -0.4, -0.5, 1.6, -1.3, 0.6, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0)),
}
_QUADRUPEDS = {  # three feet on the ground, one that reaches, base
    "anymal": (("RF_FOOT", "LH_FOOT", "RH_FOOT"), "LF_FOOT", "base"),
    "solo12": (("FR_FOOT", "HL_FOOT", "HR_FOOT"), "FL_FOOT", "base_link"),
}


@cache
def subject(name: str) -> Subject:
    """Robot by catalogue name: arms are fixed to the world, quadrupeds stand on three feet and reach with one."""
    ahead = np.array((1.0, 0.0, 0.0))
    if name in _ARMS:
        frame, start = _ARMS[name]
        robot = hqp.robots.load(name, floating=False)
        if start is not None:
            robot.home[:] = start
        place = robot.state().position(frame) * (1.0, 1.0, 0.0)
        return Subject(robot, (), (frame,), None, place / math.hypot(*place))
    if name in _QUADRUPEDS:
        feet, hand, base = _QUADRUPEDS[name]
        robot = hqp.robots.load(name)
        return Subject(robot, tuple(PointContact(frame=foot) for foot in feet), (hand,), base, ahead)
    robot = hqp.robots.load(name)
    soles, palms = robot.landmarks["soles"], robot.landmarks["palms"]
    return Subject(
        robot, tuple(FixedContact(frame=foot) for foot in soles), palms[::-1], robot.landmarks["base"][0], ahead
    )
