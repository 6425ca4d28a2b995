"""A state with native placements reads like one with Pinocchio's."""

from collections.abc import Callable

import numpy as np
import pytest

import hqp
from hqp.declare.robot import Robot, State
from hqp.errors import StaleState
from hqp.programs.assembly import kinematics


def _update(robot: Robot) -> Callable[[np.ndarray], None]:
    native = kinematics(robot)
    assert native is not None
    return native.update


def _numbers(state: State, frame: str) -> list[np.ndarray]:
    found = [state.position(frame), state.rotation(frame), state.jacobian(frame), state.velocity(frame)]
    return [np.array(a) for a in (*found, state.com(), state.drift(frame), state.position(frame))]


@pytest.mark.parametrize("frame", ["r_palm", "l_sole"])
def test_same_numbers(frame: str) -> None:
    robot = hqp.robots.load("cbi").copy()
    update = _update(robot)  # before the first query of a frame it writes bodies only
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, v = robot.integrate(robot.home, rng.standard_normal(robot.nv), 0.3), rng.standard_normal(robot.nv)
        expected = _numbers(robot.state(q, v), frame)
        robot.state(robot.home).kinematics()
        state = robot.state(q, v)
        update(state.q)
        state.is_placed()
        for a, b in zip(_numbers(state, frame), expected, strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)


def test_stale() -> None:
    robot = hqp.robots.load("cbi").copy()
    update = _update(robot)
    state = robot.state()
    update(state.q)
    state.is_placed()
    robot.state()
    for ask in (state.position, state.rotation, state.jacobian):
        with pytest.raises(StaleState):
            ask("r_palm")
