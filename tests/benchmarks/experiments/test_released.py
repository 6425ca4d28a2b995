"""Wheels without load are released and come back; a heavier upper body is no payload."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from benchmarks.sentis2012.experiments.compliance import Compliance, stack
from benchmarks.sentis2012.experiments.ground import UP, Odometry
from benchmarks.sentis2012.experiments.hand_loads import HandLoads
from benchmarks.sentis2012.experiments.released import MovingLimits, ReleasedWheels

DT = 0.002


def test_a_wheel_without_load_holds_its_rolling_speed_and_comes_back_gradually() -> None:
    robot = hqp.robots.load("dreamer")
    most = robot.effort_limit[robot.actuated]
    limits = MovingLimits(lower=-most, upper=most, name="motors")
    wheels = ReleasedWheels(robot, limits, 20.0, DT)
    bears, air, still = np.array([200.0, 300.0, 200.0]), np.array([0.0, 300.0, 200.0]), np.zeros(3)
    for _ in range(4):  # rollers bounce: 8 ms without contact are no loss
        wheels.update(air, still)
    wheels.update(bears, still)
    np.testing.assert_array_equal(limits.upper, most)
    for _ in range(5):
        wheels.update(air, np.array([0.2, 0.0, 0.0]))
    assert wheels.bearing == [False, True, True]
    held = -0.2 * wheels.HELD * 0.101
    np.testing.assert_allclose([limits.lower[-3], limits.upper[-3]], held, rtol=0.02)  # a torque, and no room
    np.testing.assert_array_equal(limits.upper[:-3], most[:-3])
    np.testing.assert_array_equal(limits.upper[-2:], most[-2:])
    wheels.update(air, np.array([100.0, 0.0, 0.0]))
    assert limits.lower[-3] == limits.upper[-3] == -most[-3]  # at most the motor's effort
    room = []
    for _ in range(14):
        wheels.update(bears, still)
        room.append(limits.upper[-3])
    assert room[0] == 0.0
    assert room[-1] == most[-3]
    assert np.diff(room).max() < 0.11 * most[-3]


def test_a_wheel_that_spins_is_released_whatever_its_estimated_load() -> None:
    robot = hqp.robots.load("dreamer")
    most = robot.effort_limit[robot.actuated]
    wheels = ReleasedWheels(robot, MovingLimits(lower=-most, upper=most, name="motors"), 20.0, DT)
    for _ in range(5):
        wheels.update(np.full(3, 250.0), np.array([0.0, 0.5, 0.0]))
    assert wheels.bearing == [True, False, True]
    for _ in range(20):
        wheels.update(np.full(3, 250.0), np.array([0.0, 0.2, 0.0]))
    assert not wheels.bearing[1]  # still faster than it rolls
    for _ in range(2):
        wheels.update(np.full(3, 250.0), np.zeros(3))
    assert all(wheels.bearing)


def test_odometry_follows_the_accelerometer_while_two_wheels_spin() -> None:
    """Two rear wheels spin alike in the air, as at a step: they contradict the truth by metres a second."""
    robot = hqp.robots.load("dreamer")
    odometry, columns = Odometry(robot), robot.joints("wheels")
    radii = np.array([w.radius for w in robot.wheels.values()])
    rims = np.array([np.cross(w.axle, UP) for w in robot.wheels.values()])
    v, moving = np.zeros(robot.nv), np.zeros(3)
    for k in range(200):
        gained = np.array([0.3, 0.1, 0.0]) * DT if k < 150 else np.array([-1.0, 0.0, 0.0]) * DT
        moving = moving + gained
        v[columns] = rims @ moving / radii
        air = k >= 100
        if air:
            v[columns[1:]] += (k - 100) * np.array([0.5, -0.5])
        found = odometry.velocity(v, gained + [1e-5, 0.0, 0.0], [True, not air, not air])
        np.testing.assert_allclose(found, moving, atol=2e-3)
    assert np.abs(odometry.spinning(v)[1:]).min() > 1.0


@pytest.mark.long
def test_a_heavier_upper_body_is_not_taken_for_a_payload() -> None:
    """At rest, leaning as on a slope of 7 degrees, with the residuals of statics."""
    robot = hqp.robots.load("dreamer")
    q = robot.home.copy()
    q[3:7] = [0.0, -math.sin(math.radians(3.5)), 0.0, math.cos(math.radians(3.5))]
    q[robot.positions(robot.joints(("torso_hip", "torso_thorax")))] += math.radians(12.0)
    state = robot.state(q)
    carried = state.jacobian("hand_point")[:3].T @ [0.0, 0.0, -9.81]
    found = {}
    for name, residual in (("heavier", -0.1 * state.gravity_force()), ("payload", carried)):
        for own_weight in (True, False):
            choice = Compliance(payload="observed", own_weight=own_weight)
            loads = HandLoads(robot, choice, stack(choice), np.zeros(robot.actuated.size), 0.0)
            observer = loads._observer
            observer.update = lambda state, _, o=observer: o.force(state)  # type: ignore[method-assign, misc]
            observer.residual = residual
            for _ in range(3000):
                loads.sent(state, np.zeros(robot.actuated.size))
            found[name, own_weight] = loads.mass
    assert found["heavier", True] < 0.1 < 0.5 < found["heavier", False]
    assert abs(found["payload", True] - found["payload", False]) < 0.02  # 1 kg, declared further out than in truth
