"""Arms whose motors are too weak for their goals: a range that braking cannot hold is named, not passed in silence."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from hqp import PD, Level, Stack
from hqp.tasks import JointLimits, Posture, TorqueLimits


@pytest.mark.parametrize(("name", "share"), [("panda", 0.2), ("panda", 0.4), ("ur5", 0.3)])
def test_a_joint_that_leaves_its_range_is_named(name: str, share: float) -> None:
    if name not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    robot, rng, dt = hqp.robots.load(name), np.random.default_rng(0), 0.005
    own = robot.actuated
    joints = tuple(robot.joint_name(int(c)) for c in own)
    low, high = robot.lower[own], robot.upper[own]
    posture = Posture(joints=joints, law=PD(400.0, 40.0))
    stack = Stack(Level(posture), subject_to=[JointLimits(), TorqueLimits(scale=share)])
    session = hqp.Controller(stack, hqp.Torque(holding=None), deadline=math.inf).session(robot, dt, stuck=False)
    q, v, left, goal = robot.home.copy(), np.zeros(robot.nv), 0, low
    for k in range(500):
        if k % 80 == 0:
            goal = np.where(rng.uniform(size=low.size) < 0.5, low - 0.3, high + 0.3)
        tick = session.step(robot.state(q, v), posture.at(goal))
        noted = " ".join(f"{note.element} {note.detail}" for note in tick.notes)
        q, v = tick.advance()
        angles = robot.state(q).angles[own]
        out = np.where(angles > high, v[own], np.where(angles < low, -v[own], 0.0))
        for i in np.flatnonzero((out > 1e-3) & (np.maximum(angles - high, low - angles) > 1e-4)).tolist():
            left += 1
            assert tick.status is hqp.Status.CONSTRAINTS_VIOLATED or joints[i] in noted, (
                k,
                joints[i],
                tick.status,
                noted,
            )
    assert (left > 20) == (name == "panda" and share < 0.3), left
