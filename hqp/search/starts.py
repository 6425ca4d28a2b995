"""Configurations from which a search starts: home, turned bases, random joints."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from hqp.arrays import Vec
from hqp.declare.robot import Robot

INSIDE = 0.98
"""Share of the joints' ranges that random starts are drawn from."""

BASE = 0.1
"""A free base starts within this of q0 [m, rad]."""

RANDOM = 24
"""Number of random starts after the others."""


def starts(robot: Robot, q: Vec) -> Iterator[Vec]:
    """Yield q, home with the present base, both turned about the vertical, and random configurations."""
    home = robot.home.copy()
    if robot.floating:
        home[:7] = q[:7]
    yield q
    yield home
    rng = np.random.default_rng(0)
    turns = (np.pi, 0.5 * np.pi, -0.5 * np.pi) if robot.floating else ()
    for turn in turns:
        yield turned(robot, home, turn)
        yield turned(robot, q, turn)
    for i in range(RANDOM):
        start = random_start(robot, q, rng)
        yield turned(robot, start, turns[i % 3]) if turns and i % 4 else start


def random_start(robot: Robot, q0: Vec, rng: np.random.Generator) -> Vec:
    """Draw joints inside their limits, within half a turn if they have none; a free base near that of q0."""
    lower, upper = np.maximum(robot.lower, -math.pi), np.minimum(robot.upper, math.pi)
    step = INSIDE * rng.uniform(lower, upper) - robot.state(q0).angles
    if robot.floating:
        step[:6] = rng.uniform(-BASE, BASE, 6)
    return robot.integrate(q0, step, 1.0)


def turned(robot: Robot, q: Vec, angle: float) -> Vec:
    """Turn the base about the vertical through its origin [rad]."""
    x, y, z, w = q[3:7].tolist()
    c, s = np.cos(0.5 * angle), np.sin(0.5 * angle)
    found = q.copy()
    found[3:7] = (c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z)
    return found
