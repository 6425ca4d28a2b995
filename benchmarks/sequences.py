"""Consecutive hierarchies of a 500 Hz control loop, as a solver meets them there."""

from __future__ import annotations

from functools import cache

import numpy as np

import hqp
from benchmarks.mistry2008 import loop
from benchmarks.mistry2008.stance import HZ, paper_stack
from hqp import Hierarchy, Selection
from hqp.tasks import Com, Position

ROBOTS = {"loop38": "talos", "loop57": "cbi"}
"""Sets of this module and the robot in the loop; the number is that of its variables."""

TICKS = 2000
SIZE, PACE = 2.0, 5.0
"""The hand's figure is so much larger and faster than the paper's, so that joint limits come and go."""


@cache
def load(name: str, ticks: int = TICKS) -> tuple[Hierarchy, ...]:
    """The hierarchies of a loop: CoG side to side, hand on a figure-8 under joint limits, commands carried out."""
    robot = hqp.robots.load(ROBOTS[name])
    stack = paper_stack(robot, limits=True)
    com, hand = stack.find("com_xy", Com), stack.find("hand", Position)
    session = hqp.Controller(stack).session(robot, dt=1.0 / HZ)
    q, v = robot.home, np.zeros(robot.nv)
    start = robot.state(q, v)
    com_0, hand_0 = com.value(start), hand.value(start)
    found = []
    for i in range(ticks):
        t, later = i / HZ, (i + 1) / HZ
        goal, aim = com_0 + loop.side_to_side(t), hand_0 + SIZE * loop.figure_eight(PACE * t)
        rate = HZ * (com_0 + loop.side_to_side(later) - goal)
        speed = HZ * (hand_0 + SIZE * loop.figure_eight(PACE * later) - aim)
        tick = session.step(robot.state(q, v), com.at(goal, velocity=rate), hand.at(aim, velocity=speed))
        found.append(session.problem.copy())
        q, v = tick.advance()
    return tuple(found)


def refill(live: Hierarchy, problem: Hierarchy) -> None:
    """Copy a problem's numbers into the arrays of another of its shape, as a session does each tick."""
    for into, rows in zip(live.levels, problem.levels, strict=True):
        if isinstance(into.A, Selection) and isinstance(rows.A, Selection):
            into.A.index[:], into.A.scale[:] = rows.A.index, rows.A.scale
        else:
            np.copyto(into.A, rows.A)
        np.copyto(into.lower, rows.lower)
        np.copyto(into.upper, rows.upper)
