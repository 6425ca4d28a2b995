"""Note a task that comes no nearer to its target for a second, with the rows that block it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import PD, Level, P, Stack, shapes

DT = 0.005
FORMULATIONS = {
    "velocity": hqp.Velocity(law=P(5.0)),
    "acceleration": hqp.Acceleration(law=PD(100.0, 20.0)),
    "torque": hqp.Torque(law=PD(100.0, 20.0)),
}


@pytest.fixture(scope="module")
def arms() -> dict[str, Any]:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return {name: hqp.robots.load(name) for name in ("panda", "ur5")}


def held(robot: Any, kind: str, hand: Any, goals: list[Any], hard: list[Any], seconds: float) -> list[str]:
    """The HELD note of each tick, "" for none; one goal each second."""
    posture = Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))
    limits = [t.JointLimits(), *([t.TorqueLimits()] if kind == "torque" else [])]
    stack = Stack(Level(hand), posture, subject_to=[*limits, *hard])
    session = hqp.Controller(stack, FORMULATIONS[kind], deadline=math.inf).session(robot.copy(), DT)
    q, v, found = robot.home, np.zeros(robot.nv), []
    for k in range(round(seconds / DT)):
        goal = goals[min(int(k * DT), len(goals) - 1)]
        tick = session.step(session.robot.state(q, v), hand.at(goal))
        found.append(next((n.detail for n in tick.notes if n.detail.startswith("HELD")), ""))
        q, v = tick.advance()
    return found


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize(
    ("name", "frame"), [("panda", "panda_hand"), pytest.param("ur5", "tool0", marks=pytest.mark.slow)]
)
def test_a_wall_that_holds_a_hand_is_named(arms: dict[str, Any], name: str, frame: str, kind: str) -> None:
    robot = arms[name]
    start = robot.state().position(frame).copy()
    wall = t.Within(t.Position(frame=frame, axes="z"), upper=float(start[2]) + 0.05, name="ceiling", rate=10.0)
    hand = t.Position(frame=frame, axes="z", name="hand")
    found = held(robot, kind, hand, [[start[2] + 0.3]], [wall], 3.0)
    assert found[0] == found[round(1.0 / DT)] == ""
    assert "ceiling" in found[-1]
    assert "z upper" in found[-1]
    assert "hand is 0.2" in found[-1]


@pytest.mark.long
def test_an_arm_folded_beside_an_obstacle_says_so(arms: dict[str, Any]) -> None:
    """A plate between the hand and its goal: the hand rests at it, and the note names the pair's row."""
    robot, frame = arms["panda"], "panda_hand"
    start = robot.state().position(frame).copy()
    plate = shapes.box("plate", (0.02, 2.0, 2.0), (float(start[0]) + 0.25, 0.0, 0.6))
    avoid = t.CollisionAvoidance(world=(plate,))
    hand = t.Position(frame=frame, name="hand")
    found = held(robot, "velocity", hand, [start + [0.5, 0.0, 0.0]], [avoid], 5.0)
    assert avoid.name in found[-1]
    assert "plate" in found[-1]


def test_a_goal_out_of_reach_has_one_note(arms: dict[str, Any]) -> None:
    """Note of its price, if it has one."""
    robot, hand = arms["ur5"].copy(), t.Position(frame="tool0", name="hand")
    goal = hand.at(robot.state().position("tool0") + [3.0, 0.0, 0.0])
    for price in (None, hqp.Price(0.0)):
        formulation = hqp.Velocity(law=P(5.0))
        stack = Stack(Level(hand), Level(t.Posture()), subject_to=[t.JointLimits()])
        session = hqp.Controller(stack, formulation, deadline=math.inf, price=price).session(robot, DT)
        q, v = robot.home, np.zeros(robot.nv)
        tick = session.step(robot.state(q, v), goal)
        for _ in range(round(4.0 / DT)):
            q, v = tick.advance()
            tick = session.step(robot.state(q, v), goal)
        assert len([note for note in tick.notes if note.element == "hand"]) == 1


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_hand_that_moves_on_says_nothing(arms: dict[str, Any], kind: str) -> None:
    """Reachable goals, slow laws, and a wall that disappears: the note ends with its cause."""
    robot, frame = arms["panda"], "panda_hand"
    start = robot.state().position(frame).copy()
    slow = P(2.0, max_velocity=0.02) if kind == "velocity" else PD(40.0, max_velocity=0.02)
    hand = t.Position(frame=frame, name="hand", law=slow)
    assert not any(held(robot, kind, hand, [start + [0.0, 0.2, -0.1]], [], 4.0))
    wall = t.Within(t.Position(frame=frame, axes="z"), upper=float(start[2]) + 0.02, name="wall")
    goals = [start + [0.0, 0.0, 0.2]] * 3 + [start + [0.0, 0.1, -0.1]]
    found = held(robot, kind, t.Position(frame=frame, name="hand"), goals, [wall], 4.0)
    assert found[round(2.9 / DT)]
    assert not found[-1]
