"""A position limit that yields to the acceleration window: the joint and the predicted overrun."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack
from hqp.loop.tick import Tick
from hqp.tasks import JointLimits, Posture

DT = 0.002
FORMULATIONS = {"velocity": hqp.Velocity(), "acceleration": hqp.Acceleration(), "torque": hqp.Torque()}


def driven(robot: Any, kind: str, limited: bool, q: Any, v: Any, ticks: int, **fields: Any) -> tuple[list[Tick], Any]:
    """Ticks from a given state, and the angles after each."""
    law = P(5.0) if kind == "velocity" else PD(25.0, 10.0)
    stack = Stack(Level(Posture(law=law)), subject_to=[JointLimits(**fields)])
    rates = None if not limited else hqp.RateLimits(**{kind: 1e9})
    run = hqp.Controller(stack, FORMULATIONS[kind], rates=rates, deadline=math.inf).session(robot, DT)
    found, angles = [], []
    for _ in range(ticks):
        found.append(run.step(robot.state(q, v)))
        q, v = found[-1].advance()
        angles.append(robot.state(q).angles)
    return found, np.array(angles)


def told(tick: Tick) -> dict[str, tuple[float, str]]:
    """Predicted overrun and unit by joint that a note names."""
    found = {}
    for note in tick.notes:
        if "cannot brake" in note.detail:
            amount, unit = note.detail.split("exceeded by ")[1].split()
            found[note.element] = float(amount), unit
    return found


@pytest.mark.parametrize("limited", [False, True], ids=["plain", "rates"])
@pytest.mark.parametrize("kind", list(FORMULATIONS))
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_note_foretells_by_how_much_a_limit_is_passed(kind: str, limited: bool, side: float) -> None:
    robot, joint = hqp.robots.load("ur5"), 2
    q, v = robot.home.copy(), np.zeros(robot.nv)
    limit = robot.upper[joint] if side > 0.0 else robot.lower[joint]
    q[joint], v[joint] = limit - side * 0.03, side * 2.5
    ticks, angles = driven(robot, kind, limited, q, v, 200)
    passed = float((side * (angles[:, joint] - limit)).max())
    assert passed > 0.02
    for tick in ticks[:20]:
        (name, (amount, unit)), *others = told(tick).items()
        assert (name, unit, others) == (robot.joint_names[joint], "rad", [])
        assert amount == pytest.approx(passed, rel=6e-3)  # three digits
    assert not told(ticks[-1])  # on its way back


@pytest.mark.parametrize("limited", [False, True], ids=["plain", "rates"])
def test_a_joint_that_can_still_stop_is_not_named(limited: bool) -> None:
    robot, joint = hqp.robots.load("ur5"), 2
    q, v = robot.home.copy(), np.zeros(robot.nv)
    q[joint], v[joint] = robot.upper[joint] - 0.08, 2.5  # 0.06 at 50 rad/s^2, beyond the braking curve at 5 rad/s^2
    ticks, angles = driven(robot, "velocity", limited, q, v, 100)
    assert angles[:, joint].max() <= robot.upper[joint]
    assert ticks[0].solution is not None
    assert 2 in ticks[0].solution.active[0]  # braking as hard as the window allows
    assert not any(told(tick) for tick in ticks)


def test_a_joint_outside_that_comes_back_is_not_named() -> None:
    robot, joint = hqp.robots.load("ur5"), 2
    q = robot.home.copy()
    q[joint] = robot.upper[joint] + 0.05
    ticks, _ = driven(robot, "acceleration", False, q, np.zeros(robot.nv), 50)
    assert not any(told(tick) for tick in ticks)


def test_a_prismatic_joint_passes_by_metres() -> None:
    robot = hqp.robots.load("panda")
    joint = robot.joint_names.index("panda_finger_joint1")
    q, v = robot.home.copy(), np.zeros(robot.nv)
    q[joint], v[joint] = robot.upper[joint] - 0.001, 1.0
    ticks, angles = driven(robot, "velocity", False, q, v, 40, acceleration=20.0)
    (amount, unit) = told(ticks[0])["panda_finger_joint1"]
    assert unit == "m"
    assert amount == pytest.approx(float(angles[:, joint].max() - robot.upper[joint]), rel=6e-3)


def test_without_a_window_a_joint_stops_at_once() -> None:
    robot, joint = hqp.robots.load("ur5"), 2
    q, v = robot.home.copy(), np.zeros(robot.nv)
    q[joint], v[joint] = robot.upper[joint] - 0.03, 2.5
    assert not any(told(tick) for tick in driven(robot, "velocity", False, q, v, 5, acceleration=None)[0])
    assert list(told(driven(robot, "velocity", False, q, v, 5)[0][0])) == [robot.joint_names[joint]]


def test_the_note_is_back_after_another_tick() -> None:
    """Marks are others than those of the tick between."""
    robot, joint, posture = hqp.robots.load("ur5"), 2, Posture(law=PD(25.0, 10.0))
    run = hqp.Controller(
        Stack(Level(posture), subject_to=[JointLimits()]), hqp.Acceleration(), deadline=math.inf
    ).session(robot, DT)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    q[joint], v[joint] = robot.upper[joint] - 0.03, 2.5
    for _ in range(3):
        tick = run.step(robot.state(q, v))
    assert told(tick)
    between = run.step(robot.state(), posture.at(np.full(6, np.nan)))
    assert not told(between)
    tick = run.step(robot.state(q, v))
    assert told(tick)
