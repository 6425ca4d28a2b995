"""Motions of operators and faults of networks: six families of hand motion as packets."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import hqp
from hqp.arrays import Mat, Vec
from hqp.declare.element import Task
from hqp.declare.stack import Stack
from hqp.errors import UnsupportedProblem
from hqp.tasks import Pose, Position

RATE = 72.0
"""Packets a second, a headset's."""

FAMILIES = {
    "sine": "10 cm to either side, once in 2 s",
    "step": "10 cm aside at once, after 1 s",
    "past reach": "1.5 m ahead within 1 s, there for a second, and back",
    "dropout": "the sine without packets from 2.0 to 2.3 s",
    "glitch": "the sine, one packet in twenty half a metre off",
    "straight arm": "slowly out along the arm until it is straight, and back",
}
"""Scenes in order, in words."""

SECONDS = 5.0
"""Duration of each scene."""

EASE = 1.0
"""A motion that goes on for ever begins within this time [s]."""


@dataclass(frozen=True)
class Family:
    """A motion of the operator's hand, and its packets.

    shift: displacement of the hand from its start at a time, ``(3,)`` [m].  lost, wrong: true if the packet with that
    number and time is lost, or is half a metre off.
    """

    name: str
    shift: Callable[[float], Vec]
    lost: Callable[[int, float], bool] = lambda i, t: False
    wrong: Callable[[int, float], bool] = lambda i, t: False

    def packets(self, seconds: float) -> Iterator[tuple[float, Vec]]:
        """When each packet was sent [s], and the shift in it."""
        for i in range(math.ceil(seconds * RATE)):
            t = i / RATE
            if not self.lost(i, t):
                yield t, self.shift(t) + (np.array([0.0, 0.0, 0.5]) if self.wrong(i, t) else 0.0)


def family(name: str, robot: Any, stack: Stack) -> Family:
    """A family by name, for the hand of a stack."""
    if name == "step":
        return Family(name, lambda t: np.array([0.0, 0.1 if t > 1.0 else 0.0, 0.0]))
    if name == "past reach":
        return Family(name, lambda t: np.array([1.5 * _there(t, 0.5, 1.5, 2.5, 3.5), 0.0, 0.0]))
    if name == "straight arm":
        way = straight(robot, stack)
        return Family(name, lambda t: _there(t, 0.3, 1.8, 2.0, 3.5) * way)
    if name == "dropout":
        return Family(name, sine, lost=lambda i, t: 2.0 < t < 2.3)
    if name == "glitch":
        return Family(name, sine, wrong=lambda i, t: i % 20 == 10)
    return Family("sine", sine)


def sine(t: float) -> Vec:
    """10 cm to either side and 5 cm up and down, eased in."""
    ease = _smooth(t / EASE)
    return np.array([0.0, 0.1 * ease * math.sin(math.pi * t), 0.05 * ease * (1.0 - math.cos(math.pi * t))])


def hand_of(stack: Stack) -> Task:
    """The first position or pose below ``subject_to``; raises UnsupportedProblem if there is none."""
    for level in stack.levels:
        for element in level:
            if isinstance(element, (Position, Pose)):
                return element
    raise UnsupportedProblem("teleoperation needs a Position or Pose in a level of the stack")


def moved(home: Mat | Vec, shift: Vec) -> Mat | Vec:
    """A position or pose shifted."""
    if home.ndim == 1:
        return home + shift
    found = home.copy()
    found[:3, 3] += shift
    return found


def straight(robot: Any, stack: Stack) -> Vec:
    """The way ``(3,)`` from the hand, ahead, to the farthest place that it reaches with the levels above kept [m]."""
    hand: Any = hand_of(stack)
    twin = robot.copy()
    home = np.array(hand.value(twin.state(twin.home)))
    near, far = 0.0, 1.5
    while far - near > 5e-3:
        middle = 0.5 * (near + far)
        goal = hand.at(moved(home, np.array([middle, 0.0, 0.0])))
        met = hqp.reach(stack, twin, goal, restarts=5, budget=0.2).success
        near, far = (middle, far) if met else (near, middle)
    return np.array([near, 0.0, 0.0])


def _there(t: float, go: float, there: float, back: float, end: float) -> float:
    """From 0 to 1 and back."""
    return _smooth((t - go) / (there - go)) - _smooth((t - back) / (end - back))


def _smooth(u: float) -> float:
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
