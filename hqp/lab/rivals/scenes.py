"""Scenes for every library: an ordinary one, and one for each fault."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare.stack import Stack
from hqp.errors import UnsupportedProblem
from hqp.lab.trajectory import Motion
from hqp.tasks import Pose, Position

SCENES = {
    "nominal": "targets go round a circle of 5 cm radius",
    "unreachable": "targets move 1.5 m ahead within 1 s",
    "step": "targets jump 10 cm",
    "limit": "the circle with every joint confined to 0.05 rad about home",
    "nan": "the circle; targets are NaN for 0.1 s",
    "infeasible": "hard constraints contradict each other: a frame is held at two places, 2 cm apart",
    "redundant": "hard constraints are given twice",
    "outside": "the start is 0.1 rad beyond a joint's range",
}
"""Scenes in order, in words."""

ROOM = 0.05
"""Range of each joint in the scene ``limit`` [rad]."""


@dataclass(frozen=True)
class Scene:
    """A stack on a robot that starts at its home; motion: one of the lab's trajectories; held: values of elements
    that are not held where they start.
    """

    name: str
    robot: Any
    stack: Stack
    motion: str | Motion
    held: dict[str, Any] = field(default_factory=dict)


def scene(name: str, robot: Any, stack: Stack) -> Scene:
    """A scene by name; raises UnsupportedProblem where the stack has nothing that it needs."""
    robot = robot.copy()
    plain = {"nominal": "circle", "unreachable": "unreachable", "step": "step", "nan": "nan"}
    if name in plain:
        return Scene(name, robot, stack, plain[name])
    if name == "limit":
        angles = robot.state(robot.home).angles
        joints = robot.joints(None)
        robot.lower, robot.upper = robot.lower.copy(), robot.upper.copy()
        robot.lower[joints] = np.maximum(robot.lower[joints], angles[joints] - ROOM)
        robot.upper[joints] = np.minimum(robot.upper[joints], angles[joints] + ROOM)
        return Scene(name, robot, stack, "circle")
    if name == "outside":
        return Scene(name, _outside(robot), stack, "hold")
    frame, contacts = _frame(stack), [e for e in stack if e.is_contact and e.equality]
    if name == "redundant" and contacts:
        again = [replace(e, name=f"{e.name} again") for e in contacts]
        return Scene(name, robot, Stack(*stack.levels, subject_to=[*stack.subject_to, *again]), "circle")
    here = Pose(frame=frame, name="held here")
    there = Pose(frame=frame, name="held there")
    home = here.value(robot.state(robot.home))
    other = home.copy()
    other[0, 3] += 0.02 if name == "infeasible" else 0.0
    both = Stack(*stack.levels, subject_to=[*stack.subject_to, here, there])
    return Scene(name, robot, both, "hold", {"held here": home, "held there": other})


def _frame(stack: Stack) -> str:
    for level in stack.levels:
        for element in level:
            if isinstance(element, (Position, Pose)):
                return str(element.frame)
    raise UnsupportedProblem("the scenes need a Position or Pose in the stack")


def _outside(robot: Any) -> Any:
    """The joint nearest to its upper limit is put beyond it."""
    angles = robot.state(robot.home).angles
    joints = [int(c) for c in robot.joints(None) if np.isfinite(robot.upper[c])]
    nearest = min(joints, key=lambda c: float(robot.upper[c] - angles[c]))
    step: Vec = np.zeros(robot.nv)
    step[nearest] = robot.upper[nearest] + 0.1 - angles[nearest]
    robot.home = robot.integrate(robot.home, step, 1.0)
    return robot
