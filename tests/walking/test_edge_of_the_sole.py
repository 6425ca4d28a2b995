"""Torques of a walk change in proportion to the demands, also where the edge of a sole begins to bound the body."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp.declare.reference import Reference
from hqp.estimation.rotations import exponential
from hqp.walking import Walker
from hqp.walking.feet import upper
from hqp.walking.stance import Stance

STEPS, FAR = 100, 0.012  # heights of the CoM around its own [m]


@pytest.fixture(scope="module", params=["g1", "cbi"])
def walker(request: Any) -> Walker:
    robot = hqp.robots.load(request.param, rotors=True)
    robot.effort_limit[:] *= 10.0  # if a hip is at its limit, waist and arms bear the rest
    return Walker(robot, deadline=math.inf)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 6))])
def test_no_torque_changes_by_more_than_the_force_on_half_a_leg(walker: Walker, seed: int) -> None:
    """On the left foot, the ZMP at a drawn edge, waist and swing foot in drawn motion.

    A change of the force at the CoM by m da takes no more than m da h / 2 of any joint.
    """
    rng = np.random.default_rng(seed)
    robot, stacks, (left, right) = walker.robot, walker.stacks, walker.feet
    q = Stance(robot, walker.feet).on((left,), walker.gait.lower)
    assert q is not None
    v = np.zeros(robot.nv)
    v[robot.joints(upper(robot, walker.feet)[:3])] = rng.uniform(-1.0, 1.0, 3)
    state = robot.state(q, v)
    com, rate = state.com(), state.com_velocity()[:2]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = state.rotation(right.frame), state.position(right.frame)
    ahead = rng.uniform(0.0, 2.0 * math.pi)
    dcm = com[:2] + rate / walker.omega + 0.1 * np.array([math.cos(ahead), math.sin(ahead)])
    swing = np.concatenate((rng.uniform(-10.0, 10.0, 3), rng.uniform(-20.0, 20.0, 3)))
    lean = exponential(np.append(rng.uniform(-0.1, 0.1, 2), 0.0))
    given = (
        Reference(stacks.balance.name, np.array([*com[:2], *dcm])),
        Reference(stacks.swing[1].name, pose, np.zeros(6), swing),
        Reference(stacks.trunk.name, lean @ state.rotation(stacks.trunk.frame)),
        Reference(left.name, normal=state.rotation(left.frame)[:, 2]),
    )
    found = []
    for height in com[2] + np.linspace(-FAR, FAR, STEPS + 1):
        tick = walker.session.step(
            robot.state(q, v), Reference(stacks.height.name, np.array([height])), *given, phase="left"
        )
        found.append(tick.command.copy())
    most = robot.mass * walker._laws.height.kp * 2.0 * FAR / STEPS * 0.5 * walker.height
    assert np.abs(np.diff(found, axis=0)).max() < most
