"""Estimates of a robot from its own sensors."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from benchmarks.mistry2008.experiments.balance import GAINS, PERIOD, SENSES, SOLES, Balance, follow
from hqp.errors import DeclarationError
from hqp.estimation import FeetEstimator
from hqp.robots.on_mujoco import Sensors
from tests.scenes.mistry2008 import CBI, paper_stack


@pytest.mark.long
@pytest.mark.parametrize("sensors", [Sensors(), SENSES])
def test_base_of_a_standing_robot_from_imu_encoders_and_feet(sensors: Sensors) -> None:
    run = Balance(paper_stack(CBI, GAINS, hand=False), "nullspace", sensors=sensors)
    follow(run, 1.0, lambda t: np.array([0.0, 0.02 * (1.0 - math.cos(6.0 * t))]))
    off = run.log["base_error"]
    assert np.ptp(run.log["q"][:, 1]) > 0.02  # it moves
    assert 1e3 * np.linalg.norm(off[:, :3], axis=1).max() < 1.2  # MuJoCo's soles creep by as much under a sway
    assert np.linalg.norm(off[:, 3:], axis=1).max() < 2e-3
    velocity = run.robot.state(*run.known).v[:3] - run.v[:3]
    assert np.linalg.norm(velocity) < 0.01


def test_a_foot_that_is_lifted_and_set_down_stands_in_its_new_place() -> None:
    robot = hqp.robots.load("cbi")
    estimator = FeetEstimator(robot, SOLES, PERIOD, robot.home)
    q, v, up = robot.home.copy(), np.zeros(robot.nv), np.array([0.0, 0.0, 9.81])
    both, left = np.array([400.0, 400.0]), np.array([800.0, 0.0])
    knee = robot.positions(robot.joints(("R_KFE",)))
    hip = robot.positions(robot.joints(("R_HFE",)))
    assert knee is not None
    assert hip is not None
    for load in (both, left):
        for _ in range(50):
            found, _ = estimator.update(q, v, up, load)
    q[hip] += 0.2  # the right foot moves without load
    for load in (left, both):
        for _ in range(50):
            found, _ = estimator.update(q, v, up, load)
    np.testing.assert_allclose(found[:3], robot.home[:3], atol=1e-6)
    for _ in range(50):
        found, _ = estimator.update(q, v, up, left[::-1].copy())  # now loads the right one alone
    np.testing.assert_allclose(found[:3], robot.home[:3], atol=1e-6)


def test_a_step_without_load_does_not_count() -> None:
    robot = hqp.robots.load("cbi")
    estimator = FeetEstimator(robot, SOLES, PERIOD, robot.home)
    v, still = np.zeros(robot.nv), np.zeros(3)
    for _ in range(5):  # no contact yet, and the accelerometer reads zero: 10 ms
        found, _ = estimator.update(robot.home, v, still, np.array([0.0, np.nan]))
    assert abs(found[2] - robot.home[2]) < 1e-3
    for _ in range(100):
        found, _ = estimator.update(robot.home, v, still, np.zeros(2))
    assert found[2] < robot.home[2] - 0.1  # permanently in the air: it falls


def test_the_yaw_of_the_imu_is_not_believed() -> None:
    robot = hqp.robots.load("cbi")
    estimator = FeetEstimator(robot, SOLES, PERIOD, robot.home)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    q[3:7] = 0.0, 0.0, math.sin(0.2), math.cos(0.2)  # 23 degrees off
    for _ in range(500):
        found, _ = estimator.update(q, v, np.array([0.0, 0.0, 9.81]), np.array([400.0, 400.0]))
    np.testing.assert_allclose(found[:7], robot.home[:7], atol=1e-9)


def test_what_an_estimator_refuses() -> None:
    robot = hqp.robots.load("cbi")
    with pytest.raises(DeclarationError, match="period"):
        FeetEstimator(robot, SOLES, 0.0, robot.home)
    with pytest.raises(DeclarationError, match="tilt"):
        FeetEstimator(robot, SOLES, PERIOD, robot.home, tilt=math.nan)
