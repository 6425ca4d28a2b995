"""solve_ik: the velocity of one step, with sessions kept between calls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.robots
from hqp import Level, P, Stack
from hqp.errors import DeclarationError, NotSolved
from hqp.goals import step
from hqp.tasks import JointLimits, Position, Posture


@pytest.fixture(scope="module")
def panda() -> Any:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return hqp.robots.load("panda")


HAND = Position(frame="panda_hand_tcp", law=P(5.0))


def test_it_is_the_answer_of_a_session(panda: Any) -> None:
    stack = Stack(Level(HAND), Level(Posture()), subject_to=[JointLimits()])
    goal = HAND.at([0.4, 0.1, 0.5])
    v = hqp.solve_ik(panda, panda.home, stack, 0.01, goal, fresh=True)
    session = hqp.Controller(stack, deadline=math.inf).session(panda, 0.01)
    np.testing.assert_array_equal(v, session.step(panda.state(panda.home), goal).x)


def test_in_a_loop_the_hand_arrives_and_one_session_serves(panda: Any) -> None:
    levels, q = [Level(HAND), Level(Posture())], panda.home
    goal = HAND.at([0.4, 0.1, 0.5])
    before = len(step._SESSIONS._values[panda])
    for _ in range(300):
        q = panda.integrate(q, hqp.solve_ik(panda, q, levels, 0.02, goal, subject_to=[JointLimits()]), 0.02)
    np.testing.assert_allclose(panda.state(q).position(HAND.frame), [0.4, 0.1, 0.5], atol=1e-4)
    assert len(step._SESSIONS._values[panda]) == before + 1


def test_hold_values_are_those_of_the_first_call_until_fresh(panda: Any) -> None:
    levels = [Level(Posture(law=P(1.0), name="held"))]
    moved = panda.integrate(panda.home, np.full(panda.nv, 0.01), 1.0)
    assert np.abs(hqp.solve_ik(panda, panda.home, levels, 0.01)).max() < 1e-12
    assert np.abs(hqp.solve_ik(panda, moved, levels, 0.01)).max() > 5e-3
    assert np.abs(hqp.solve_ik(panda, moved, levels, 0.01, fresh=True)).max() < 1e-12


def test_what_has_no_answer_raises(panda: Any) -> None:
    with pytest.raises(NotSolved, match="INVALID_STATE"):
        hqp.solve_ik(panda, np.full(panda.nq, math.nan), [Level(HAND)], 0.01)
    with pytest.raises(DeclarationError, match="allowed: 0 < dt <= 1"):
        hqp.solve_ik(panda, panda.home, [Level(HAND)], -0.01)


def test_few_sessions_are_kept(panda: Any) -> None:
    for k in range(40):
        hqp.solve_ik(panda, panda.home, [Level(HAND)], 0.01 + 1e-4 * k)
    assert len(step._SESSIONS._values[panda]) <= 16


def test_a_home_that_was_set_anew_counts(panda: Any) -> None:
    robot = panda.copy()
    goal = HAND.at(robot.state(robot.home).position(HAND.frame))
    hqp.solve_ik(robot, None, [Level(HAND)], 0.01, goal)
    robot.set_home(robot.home + 0.1)
    found = hqp.solve_ik(robot, None, [Level(HAND)], 0.01, goal)
    assert np.abs(found).max() > 0.1  # the old home leaves no distance
