"""Hands out of reach for eight seconds: what is calm at first must stay calm."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from hqp import Level, P, Price, Stack
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture

RESTLESS = 0.02
"""Median over 0.8 s of the largest change of a joint's speed in a tick [rad/s]; bang-bang in the window is 0.1."""


def restless(name: str, ahead: list[float], price: Price | None) -> int:
    """Periods of 0.8 s, of the last 6.4 s of 8 s, in which a command is restless; base and posture are not slowed."""
    robot = hqp.robots.load(name)
    hand = Position(frame=robot.landmarks["palms"][1], law=P(5.0, max_velocity=0.5), name="hand")
    base = Orientation(frame=robot.landmarks["base"][0], law=P(2.0), name="base")
    stack = Stack(
        Level(Com(axes="xy", law=P(2.0))),
        Level(hand),
        Level(base),
        Level(Posture(law=P(1.0))),
        subject_to=[*(FixedContact(frame=sole) for sole in robot.landmarks["soles"]), JointLimits()],
    )
    session = hqp.Controller(stack, deadline=math.inf, price=price).session(robot, 0.002)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal, commands = robot.state(q).position(hand.frame) + np.array(ahead), []
    for _ in range(4000):
        tick = session.step(robot.state(q, v), hand.at(goal))
        commands.append(tick.command)
        q, v = tick.advance()
    change = np.abs(np.diff(np.array(commands), axis=0)).max(axis=1)
    return sum(float(np.median(change[k : k + 400])) > RESTLESS for k in range(800, 3999, 400))


@pytest.mark.parametrize(("name", "ahead"), [("talos", [0.7, 0.0, 0.25]), ("g1", [-0.6, 0.0, 0.1])])
def test_by_default(name: str, ahead: list[float]) -> None:
    assert restless(name, ahead, None) == 0


@pytest.mark.parametrize(
    ("name", "ahead"), [("g1", [0.7, 0.0, 0.25]), ("g1", [0.2, -0.8, 0.1]), ("cbi", [0.7, 0.0, 0.25])]
)
def test_with_wider_bands(name: str, ahead: list[float]) -> None:
    assert restless(name, ahead, Price(tau=0.1, share=1e-2)) == 0


@pytest.mark.xfail(
    strict=True, reason="a posture alternates between the ends of bands in directions that are nearly lost"
)
@pytest.mark.parametrize(("name", "ahead"), [("g1", [0.7, 0.0, 0.25]), ("cbi", [0.7, 0.0, 0.25])])
def test_known_to_be_restless_by_default(name: str, ahead: list[float]) -> None:
    assert restless(name, ahead, None) == 0
