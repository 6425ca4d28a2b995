"""Notes and explanations name the same cause for a hand that stays short: limits, price, reach, or none."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.arrays import Mat
from hqp.explanation.words import OUT_OF_REACH
from hqp.tasks import JointLimits, Pose, Posture

DT, START = 0.005, np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def driven(place: tuple[float, float, float], ticks: int, gain: float = 80.0) -> tuple[hqp.Tick, float]:
    """Last tick of a UR3 whose hand keeps its orientation and has a target position, and its distance [m]."""
    robot = hqp.robots.load("ur3")
    hand = Pose(frame="tool0", law=P(gain), name="hand")
    stack = Stack(Level(hand), Level(Posture(law=P(1.0), name="posture")), subject_to=[JointLimits(name="limits")])
    session = hqp.Controller(stack, hqp.Velocity(), deadline=math.inf).session(robot, DT)
    q, v = START, np.zeros(robot.nv)
    goal: Mat = np.array(hand.value(robot.state(q)))
    goal[:3, 3] = place
    tick = session.step(robot.state(q, v), hand.at(goal))
    for _ in range(ticks - 1):
        q, v = tick.advance()
        tick = session.step(robot.state(q, v), hand.at(goal))
    return tick, float(np.linalg.norm(robot.state(q).position("tool0") - place))


def within(y: float) -> tuple[float, float, float]:
    robot = hqp.robots.load("ur3")
    return float(robot.state(START).position("tool0")[0]), y, 0.2


def test_an_eager_hand_on_its_way_is_held_by_the_joints_speed() -> None:
    tick, _ = driven(within(0.48), 60)
    account = tick.explain()["hand"]
    assert account.cause == tick.account().cause("hand") == "limit"
    assert "speed" in next(line for line in str(tick.explain()).splitlines() if line.startswith("hand"))
    (note,) = tick.notes
    assert (note.element, "the rest is held by limits" in note.detail) == ("hand", True)


@pytest.mark.parametrize("y", [0.36, 0.48])
def test_nothing_holds_it_in_the_end(y: float) -> None:
    tick, off = driven(within(y), 1200)
    assert off < 1e-6
    assert tick.explain()["hand"].cause == tick.account().cause("hand") == ""
    assert tick.explain()["posture"].losses[0].element == "hand"  # the posture gives way, not the hand
    assert tick.notes == ()


def test_out_of_reach_is_said_by_note_and_explanation() -> None:
    tick, off = driven((2.0, 0.0, 0.2), 3000)
    assert off > 1.0
    assert tick.explain()["hand"].cause == tick.account().cause("hand") == "out of reach"
    assert OUT_OF_REACH in str(tick.explain())
    (note,) = tick.notes
    assert note.detail.endswith(OUT_OF_REACH)
