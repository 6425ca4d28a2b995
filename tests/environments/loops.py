"""Three loops that every environment must run: UR5 by velocities, G1 by accelerations, Talos by torques."""

from __future__ import annotations

import importlib.metadata
import sys

import numpy as np

import hqp
from tests.scenes.stacks import scene

LOOPS = (("ur5", "velocity"), ("g1", "acceleration"), ("talos", "torque"))
TICKS = 300
REACH = 5e-3
"""Largest final distance of the hand from its target, which is 5 cm away [m]."""


def loop(name: str, formulation: str) -> float:
    """Distance of the hand from its target after the loop [m]; raises AssertionError for a tick without an optimum."""
    session, _ = scene(name, formulation)
    robot = session.robot
    (hand,) = (element for element in session.controller.stack if element.name == "hand")
    q, v = robot.home, np.zeros(robot.nv)
    goal = robot.state(q).position(hand.frame) + np.array((-0.02, 0.0, 0.03))
    for _ in range(TICKS):
        tick = session.step(robot.state(q, v), hand.at(goal))
        assert tick.status.solved, (name, tick.status, tick.notes)
        q, v = tick.advance()
    return float(np.linalg.norm(robot.state(q).position(hand.frame) - goal))


def main() -> int:
    """Run all; return 1 if a hand does not arrive."""
    about = {"pin": "pin", "numpy": "numpy", "scipy": "scipy"}
    print("hqp", hqp.__file__, *(f"{name} {importlib.metadata.version(name)}" for name in about))
    far = {f"{name} {kind}": loop(name, kind) for name, kind in LOOPS}
    print(*(f"{where}: {distance:.1e} m" for where, distance in far.items()), sep="\n")
    return int(max(far.values()) > REACH)


if __name__ == "__main__":
    sys.exit(main())
