"""Links that drawn postures throw at each other slow down in time, at the default influence."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack
from hqp.tasks import CollisionAvoidance, JointLimits, Posture, PrescribedMotion, TorqueLimits
from tests.scenes.collision.original import Original
from tests.tasks.test_prescribed import load

DT = 0.005
LEVELS: dict[str, tuple[Any, Any]] = {
    "velocity": (hqp.Velocity(), P(20.0)),
    "acceleration": (hqp.Acceleration(), PD(400.0, 40.0)),
    "torque": (hqp.Torque(holding=None), PD(400.0, 40.0)),
}


@pytest.mark.long
@pytest.mark.parametrize("level", ["velocity", "acceleration", pytest.param("torque", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["talos", pytest.param("g1", marks=pytest.mark.slow)])
def test_thrown_links_keep_their_clearance(name: str, level: str) -> None:
    """Judge the shapes of the file by coal in a closed loop with the default influence."""
    robot, rng = load(name), np.random.default_rng(0)
    formulation, law = LEVELS[level]
    avoid, posture = CollisionAvoidance(), Posture(law=law)
    limits = [JointLimits(), TorqueLimits()] if level == "torque" else [JointLimits()]
    stack = Stack(Level(posture, price=0), subject_to=[PrescribedMotion(name="base"), *limits, avoid])
    session = hqp.Controller(stack, formulation, deadline=math.inf).session(robot, DT, stuck=False)
    wide = CollisionAvoidance(influence=0.03, slots=4096)
    judge = Original(wide, robot)
    low, high = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    q, v, fastest, nearest = robot.home.copy(), np.zeros(robot.nv), 0.0, math.inf
    for k in range(450):
        if k % 60 == 0:
            goal = robot.state(robot.configuration(rng.uniform(low, high))).angles[robot.actuated].copy()
        tick = session.step(robot.state(q, v), posture.at(goal))
        assert tick.status.usable
        q, v = tick.advance()
        fastest = max(fastest, float(np.abs(v).max()))
        if k % 5 == 0:
            near = wide.near(robot.state(q))
            nearest = min(nearest, judge.margin(near))
    assert fastest > 3.0
    assert nearest > -2e-3, nearest
