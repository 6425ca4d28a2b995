"""Waist and arms are not thrown about if a sole bounds the balance."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp.robots
from hqp.robots.on_mujoco import Ramp
from hqp.walking import Walker
from hqp.walking.course import Course


@pytest.mark.slow
def test_torques_up_a_slope_change_by_little() -> None:
    """G1 with noise: 162 N m in a tick and a fall, if waist and arms may take up 1000 rad/s^2."""
    walker = Walker(hqp.robots.load("g1", rotors=True), deadline=math.inf)
    course = Course(walker, terrain=Ramp(friction=0.5, angle=math.radians(10.0)))
    changes, before = [], None
    while walker.time < 11.0:
        if walker.time > 1.0 and not walker.walking:
            walker.go(0.1)
        tau = course.step().command.copy()
        assert not course.fallen
        changes.append(0.0 if before is None or walker.event else float(np.abs(tau - before).max()))
        before = tau
    assert max(changes) < 60.0
