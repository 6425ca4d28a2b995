"""The first command after a change of stack starts from the last command of the change."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, RateLimits, Stack
from hqp.tasks import JointLimits, Position, Posture

DT = 0.002
FORMULATIONS = [hqp.Velocity(), hqp.Acceleration(), hqp.Torque()]


@pytest.mark.parametrize("formulation", FORMULATIONS, ids=lambda one: type(one).__name__)
def test_rates_go_on_from_what_was_sent_last(formulation: Any) -> None:
    robot = hqp.robots.load("ur5")
    hand = Position(frame="tool0", name="hand")
    whole = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits()])
    limits = {"velocity": 10.0, "acceleration": 500.0, "torque": 2000.0}
    session = hqp.Controller(whole, formulation, deadline=math.inf, rates=RateLimits(**limits)).session(
        robot, DT, stuck=False
    )
    most = limits[type(formulation).__name__.lower()] * DT * (1.0 + 1e-9)
    q, v = robot.home.copy(), np.zeros(6)
    goal, ended, last, before = robot.state(q, v).position("tool0") + [0.2, 0.2, 0.1], 0, None, 1.0
    for k in range(700):
        if k in (40, 360):
            session.change(whole.without("hand") if k == 40 else whole, over=0.05)
        broken = last is not None and last.transition == 1.0 and before < 1.0
        state = robot.state(np.full(6, np.nan) if broken else q, v)
        tick = session.step(state, *([hand.at(goal)] if "hand" in session else []))
        if last is not None:
            assert np.abs(tick.command - last.command).max() <= most, f"tick {k}"
            before = last.transition
        last, ended = tick, ended + broken
        if not broken:
            q, v = tick.advance()
    assert ended >= 1
