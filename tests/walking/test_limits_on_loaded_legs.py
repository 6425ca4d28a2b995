"""Default joint limits of a session, legs included, do not hinder loaded legs."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp.robots
from hqp.tasks import JointLimits
from hqp.walking import Walker
from hqp.walking.course import Course

from .test_walker import Walked


@pytest.mark.slow
@pytest.mark.parametrize(("name", "speed", "jump"), [("g1", 0.3, 15.0), ("cbi", 0.2, 80.0)])
def test_default_limits_of_all_joints_let_it_walk(name: str, speed: float, jump: float) -> None:
    """G1 fell, and torques of CBi changed by 494 N m in a tick, if such limits outranked the forces that a foot can
    bear.

    The change was 163 N m if joints had to brake the speed that the ground under the sole takes away.
    """
    robot = hqp.robots.load(name, rotors=True)
    limits = JointLimits(joints=tuple(robot.joint_names))
    walk = Walked(Course(Walker(robot, dt=0.002, deadline=np.inf, limits=limits), sensors=None, delay=0.0))
    walk.run(1.0)
    start = walk.plant.com()[0]
    walk.walker.go(forward=speed)
    walk.run(4.0)
    assert walk.plant.com()[0] - start > 0.6 * 4.0 * speed
    assert max(walk.jumps) < jump
    assert walk.optimal > 0.998
    assert not walk.statuses["CONSTRAINTS_VIOLATED"]
