"""Legs that never get straight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare import plans
from hqp.declare.robot import Robot
from hqp.robots.knees import knee
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
