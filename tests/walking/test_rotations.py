"""Rotations and forces from sensors, against Pinocchio and statics."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

import hqp.robots
from hqp.errors import DeclarationError
from hqp.estimation import MomentumObserver
from hqp.estimation.rotations import quaternion_of, rotation_of

AXES = [np.array(v, dtype=np.float64) for v in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, -1, 1), (1, 2, -3))]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 2.0, 2.2, math.pi - 1e-6, math.pi, 5.0])
def test_quaternions_of_rotations_are_those_of_pinocchio(angle: float) -> None:
    for axis in AXES:
        R = pin.exp3(angle * axis / np.linalg.norm(axis))
        found, given = quaternion_of(R), pin.Quaternion(R).coeffs()
        assert abs(abs(float(found @ given)) - 1.0) < 1e-12
        assert np.abs(found - math.copysign(1.0, found @ given) * given).max() < 1e-7
        assert np.abs(rotation_of(2.5 * found) - R).max() < 1e-7


@pytest.mark.parametrize("force", [(10.0, 0.0, 0.0), (0.0, -4.0, 7.0), (0.0, 0.0, 0.0)])
def test_an_arm_at_rest_feels_the_force_at_its_tool(force: tuple[float, float, float]) -> None:
    robot, period = hqp.robots.load("ur5"), 0.002
    observer = MomentumObserver(robot, "tool0", robot.joint_names, period, bandwidth=20.0)
    state = robot.state(robot.home)
    held = np.array(state.bias_force() - state.jacobian("tool0")[:3].T @ force)[robot.actuated]
    for _ in range(round(1.0 / period)):
        found = observer.update(state, held)
    assert np.abs(found - force).max() < 1e-6 * (1.0 + np.abs(force).max())


@pytest.mark.parametrize("wrong", [0.0, -0.1, math.nan, math.inf])
@pytest.mark.parametrize("name", ["period", "bandwidth"])
def test_an_observer_needs_positive_times(name: str, wrong: float) -> None:
    given = {"period": 0.002, "bandwidth": 20.0, name: wrong}
    robot = hqp.robots.load("ur5")
    with pytest.raises(DeclarationError, match=name):
        MomentumObserver(robot, "tool0", robot.joint_names, **given)
