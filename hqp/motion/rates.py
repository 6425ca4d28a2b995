"""Velocities of a motion given frame by frame."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot


def velocities(robot: Robot, q: Mat, fps: float) -> Mat:
    """Velocity that leads from each configuration to the next ``(T, nv)``, the last one twice."""
    rates: list[Vec] = [robot.difference(one, two) * fps for one, two in pairwise(q)]
    return np.array([*rates, rates[-1]])
