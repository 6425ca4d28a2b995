"""Warn of an implausible first state with the likely cause; accept a plausible one."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import Level, Stack
from hqp.errors import ModelWarning
from hqp.loop.guards import doubts
from hqp.tasks import JointLimits, Posture


@pytest.fixture(scope="module", params=["cbi", "dreamer"])
def robot(request: pytest.FixtureRequest) -> Any:
    return hqp.robots.load(request.param)


def turned(q: Any, rpy: tuple[float, float, float]) -> Any:
    """Turn the base of a configuration in the world."""
    found = q.copy()
    given = pin.Quaternion(q[6], *q[3:6])
    found[3:7] = (pin.Quaternion(pin.rpy.rpyToMatrix(*rpy)) * given).coeffs()
    return found


def test_what_a_robot_may_do_is_plausible(robot: Any) -> None:
    """Any heading, tilts of up to 50 degrees, any position, and joints slightly outside their limits."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        q = robot.random_configuration(rng, 0.3)
        q[:3] = rng.uniform(-50.0, 50.0, 3)
        q[3:7] = robot.home[3:7]
        q = turned(q, (0.0, 0.0, rng.uniform(-np.pi, np.pi)))
        axis = rng.uniform(0.0, 2.0 * np.pi)
        tilt = rng.uniform(0.0, np.radians(40.0))
        q = turned(q, (tilt * np.cos(axis), tilt * np.sin(axis), 0.0))
        q[7:] += rng.uniform(-0.3, 0.3, robot.nq - 7)
        assert doubts(robot, q) == ()
        assert doubts(robot, np.concatenate((q[:3], -q[3:7], q[7:]))) == ()  # both quaternions are one rotation


def test_the_likely_cause_is_named(robot: Any) -> None:
    rng, home = np.random.default_rng(1), robot.home
    for _ in range(50):
        q = turned(home, (0.0, 0.0, rng.uniform(-2.5, 2.5)))
        swapped = q.copy()
        swapped[3:7] = q[[6, 3, 4, 5]]
        if doubts(robot, swapped):  # a heading near a half turn looks the same
            assert "w x y z" in doubts(robot, swapped)[0]
        assert "upside down" in doubts(robot, turned(q, (np.pi, 0.0, 0.0)))[0]
    assert "upside down" in doubts(robot, turned(turned(home, (0.0, 0.0, 0.4)), (3.0, 0.0, 0.0)))[0]
    assert "lying" in doubts(robot, turned(home, (0.0, 1.5, 0.3)))[0]
    assert "degrees" in doubts(robot, np.concatenate((home[:7], np.full(robot.nq - 7, 20.0))))[0]
    column = max(c for c in robot.actuated if np.isfinite(robot.upper[c]))
    far = home.copy()
    far[robot.positions(np.array([column]))] = robot.upper[column] + 1.5
    assert robot.joint_name(column) in doubts(robot, far)[0]


def test_a_session_warns_once_and_steps_on(robot: Any) -> None:
    session = hqp.Controller(Stack(Level(Posture()), subject_to=[JointLimits()])).session(robot, 0.002)
    q = turned(robot.home, (3.0, 0.0, 0.0))
    with pytest.warns(ModelWarning, match="upside down"):
        tick = session.tick(q)
    assert tick.status.solved
    with warnings.catch_warnings():
        warnings.simplefilter("error", ModelWarning)
        session.tick(q)
    for bad in (np.full(robot.nq, np.nan), np.zeros(2), "text", None):
        assert doubts(robot, bad) == ()
