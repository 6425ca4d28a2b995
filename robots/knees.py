"""The joint of a leg that stretches it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.arrays import Vec


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
