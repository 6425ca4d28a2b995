"""A session from a file gives the numbers of the session that wrote it, to the last bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
from hqp.export.plan_file import text
from hqp.loaded import LoadedSession
from hqp.solvers.lexicographic import kernel

from .stacks import FORMULATIONS, ROBOTS, Given, scene

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")


def replay(session: hqp.Session, given: Given, ticks: int) -> None:
    """Both take the same states; hold values are Pinocchio's on the one side, so that they are handed over."""
    file = LoadedSession(text(session))
    robot = session.robot
    q, v = robot.home.copy(), np.zeros(robot.nv)
    for i in range(ticks):
        references = given(i)
        tick = session.step(robot.state(q, v), *references)
        if i == 0:
            for name, value in session.hold_values.items():
                if name in file.names:
                    file.hold(name, value)
        found = file.step(q, v, {r.name: target(r) for r in references})
        assert found.status is tick.status, f"tick {i}"
        np.testing.assert_array_equal(found.x, tick.x, err_msg=f"tick {i}")
        np.testing.assert_array_equal(found.command, tick.command)
        q, v = tick.advance()


def target(reference: hqp.Reference) -> Any:
    """Value, velocity and acceleration, as many as there are."""
    return tuple(x for x in (reference.value, reference.velocity, reference.acceleration) if x is not None)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_file_gives_the_same_bits(robot: str, formulation: str) -> None:
    replay(*scene(robot, formulation), ticks=160)


def test_exact_levels_too() -> None:
    replay(*scene("g1", price=0), ticks=120)


@pytest.mark.parametrize("robot", ROBOTS)
def test_hold_values_are_those_of_python(robot: str) -> None:
    session, _ = scene(robot)
    twin = session.robot
    q = twin.integrate(twin.home, np.random.default_rng(1).uniform(-0.2, 0.2, twin.nv), 1.0)
    file = LoadedSession(text(session))
    tick, found = session.step(twin.state(q)), file.step(q)
    np.testing.assert_allclose(found.x, tick.x, atol=1e-9)
    for name, value in session.hold_values.items():
        if name in file.names:
            np.testing.assert_allclose(file.held(name), np.ravel(value), atol=1e-12, err_msg=name)
