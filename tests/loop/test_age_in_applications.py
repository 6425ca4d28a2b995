"""Sessions of policies and walkers refuse old states, and go on with new ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PolicyFilter, Status, UpperBody
from hqp.solvers.lexicographic import kernel
from hqp.walking import Walker
from tests.tasks.test_prescribed import legs_of, load

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

DT, MAX_AGE = 0.002, 0.01
Step = Callable[[Any, float], hqp.Tick]


def upper_body(robot: Any) -> Step:
    arms = UpperBody(legs=legs_of(robot), output="velocities").session(robot, DT, deadline=math.inf, max_age=MAX_AGE)
    return lambda state, now: arms.step(state, now=now).tick


def policy_filter(robot: Any) -> Step:
    session = PolicyFilter(kp=60.0, kd=2.0).session(robot, DT, deadline=math.inf, max_age=MAX_AGE)
    command = robot.state(robot.home).angles[robot.actuated].copy()
    return lambda state, now: session.step(state, command, now=now).tick


def walker(robot: Any) -> Step:
    made = Walker(robot, dt=DT, deadline=math.inf, max_age=MAX_AGE)
    assert made.session.controller.braking.resume == "auto"
    return lambda state, now: made.step(state, now=now)


@pytest.mark.long
@pytest.mark.parametrize("make", [upper_body, policy_filter, walker])
def test_an_old_state_comes_to_rest_and_a_new_one_goes_on(make: Callable[[Any], Step]) -> None:
    robot = load("g1").copy()
    step, v = make(robot), np.zeros(robot.nv)
    ages = [0.0] * 5 + [MAX_AGE + DT] * 400 + [0.0] * 5  # longer than Braking(after=)
    for k, age in enumerate(ages):
        now = DT * k
        tick = step(robot.state(robot.home, v, time=now - age), now)
        assert tick.status is (Status.INVALID_STATE if age else Status.OPTIMAL), (k, tick.notes)
    with_clock = step(robot.state(robot.home, v), DT * len(ages))
    assert any("it has no time" in note.detail for note in with_clock.notes)
