"""Legs that never get straight: the joint of a leg that stretches it, and its angle of the longest leg."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare import plans
from hqp.declare.robot import Robot
from hqp.tasks import JointLimits
from hqp.walking.feet import Foot

BEND = 0.2
"""Least angle of a knee from that of a straight leg, which has no direction to bend in [rad]."""

BRAKES = 50.0
"""Braking of a knee before that angle: at 5 G1 falls at 0.5 m/s, at 200 CBi at 0.15 m/s [rad/s^2]."""


@dataclass(frozen=True, kw_only=True)
class Knees(JointLimits):
    """Limits of joints at given angles: low <= q <= high, ``(k,)`` each [rad], in the order of the joints."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    def position_limits(self, robot: Robot) -> tuple[Vec, Vec]:
        """low and high ``(k,)`` [rad]."""
        return np.array(self.low), np.array(self.high)

    def plan(self, robot: Robot) -> plans.JointBox | None:
        """The native operation."""
        return super().plan(robot)


def bent(robot: Any, feet: Sequence[Foot], start: Vec) -> Knees:
    """Limits that keep each knee bent by BEND to the side where it is bent at ``start`` ``(nq,)``.

    A knee that starts straighter than 2 BEND keeps half of its bend.
    """
    found = [_knee(robot, foot.leg, start) for foot in feet]
    names, low, high = zip(*sorted(found, key=lambda one: robot.joint_names.index(one[0])), strict=True)
    return Knees(joints=names, low=low, high=high, acceleration=None, braking=BRAKES, name="knees")


def _knee(robot: Any, leg: Sequence[str], start: Vec) -> tuple[str, float, float]:
    """The knee of a leg, and the range of its angle (low, high) [rad]."""
    name, bend = knee(robot, leg, start)
    at = float(robot.state(start).angles[int(robot.joints([name])[0])])
    limit = at - bend + math.copysign(min(BEND, 0.5 * abs(bend)), bend)
    return (name, limit, math.inf) if bend > 0.0 else (name, -math.inf, limit)


def knee(robot: Any, leg: Sequence[str], q: Vec) -> tuple[str, float]:
    """The joint of a leg that changes its length most, and its angle from that of the longest leg [rad].

    The distance from the first joint to the last is d^2 = a + b cos(q - straight) for each joint's angle q: three
    angles give b and straight.
    """

    def square(column: int, turn: float) -> float:
        step = np.zeros(robot.nv)
        step[column] = turn
        state = robot.copy().state(robot.integrate(q, step, 1.0))
        off = state.position(leg[-1]) - state.position(leg[0])
        return float(off @ off)

    found = []
    for name, column in zip(leg, robot.joints(leg), strict=True):
        one, two, three = (square(column, turn) for turn in (0.0, math.tau / 3.0, -math.tau / 3.0))
        cosine, sine = (2.0 * one - two - three) / 3.0, (three - two) / math.sqrt(3.0)
        found.append((math.hypot(cosine, sine), name, math.atan2(sine, cosine)))
    _, name, bend = max(found)
    return name, bend
