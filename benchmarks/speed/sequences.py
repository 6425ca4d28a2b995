"""Consecutive hierarchies of a 500 Hz control loop."""

from __future__ import annotations

from functools import cache

import hqp
from benchmarks.mistry2008 import loop
from hqp import Hierarchy
from hqp.arrays import Vec
from tests.scenes.mistry2008 import HZ, paper_stack, roles

ROBOTS = {"loop38": "talos", "loop57": "cbi"}
"""Sets of this module and the robot in the loop; the number in the name counts its variables."""

TICKS = 2000
SIZE, PACE = 2.0, 5.0
"""Factors of size and speed of the hand's figure over the paper's, so that joint limits become active and inactive."""


@cache
def load(name: str, ticks: int = TICKS) -> tuple[Hierarchy, ...]:
    """The hierarchies of a loop: CoG side to side, hand on a figure-8 under joint limits, commands carried out."""
    robot, found = hqp.robots.load(ROBOTS[name]), []

    def hand(t: float) -> Vec:
        return SIZE * loop.figure_eight(PACE * t)

    def keep(session: hqp.Session) -> None:
        found.append(session.problem.copy())

    stack = paper_stack(roles(robot), limits=True)
    loop.run(robot, "lexicographic", ticks / HZ, stack=stack, hand=hand, com=loop.side_to_side, seen=keep)
    return tuple(found)
