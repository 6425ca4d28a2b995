"""Name joints whose command alternates between their limits, with the rate; name no calm joint."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp._session import LimitWatch
from hqp.loop.checks import units_of
from hqp.tasks import JointLimits, Position, Posture

DT = 0.002


def out_of_reach(name: str, price: Any, rates: Any = None) -> list[hqp.Tick]:
    robot = hqp.robots.load(name)
    hand = Position(frame=robot.frame_names[-1], law=P(5.0))
    stack = Stack(Level(hand), Level(Posture()), subject_to=[JointLimits(acceleration=None)])
    run = hqp.Controller(stack, price=price, rates=rates, deadline=math.inf).session(robot, DT)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal = robot.state(q).position(hand.frame) + [1.5, 0.0, 0.2]
    ticks = []
    for _ in range(900):
        ticks.append(run.step(robot.state(q, v), hand.at(goal)))
        q, v = ticks[-1].advance()
    return ticks


def rate(detail: str) -> float:
    """Rate of alternation in a note [1/s]."""
    return float(detail.split("between its limits ")[1].split()[0])


@pytest.mark.parametrize("rates", [None, hqp.declare.safety.RateLimits(velocity=1e6)], ids=["native", "general"])
def test_an_exact_arm_out_of_reach_alternates(rates: Any) -> None:
    """docs/calm.md: UR5 and Panda, exact, alternate from limit to limit in nearly every tick."""
    ticks = out_of_reach("ur5", 0, rates)
    notes = [note for note in ticks[-1].notes if "alternates" in note.detail]
    assert notes
    robot = hqp.robots.load("ur5")
    for note in notes:
        assert note.element in robot.joint_names
        joint = robot.joint_names.index(note.element)
        sent = np.sign([tick.command[joint] for tick in ticks[-251:]])
        measured = np.count_nonzero(sent[1:] != sent[:-1]) / (250 * DT)
        assert rate(note.detail) == pytest.approx(measured, rel=0.35)


def test_a_priced_arm_does_not() -> None:
    assert not [note for tick in out_of_reach("ur5", None) for note in tick.notes if "alternates" in note.detail]


def test_rates_are_counted_and_fade() -> None:
    robot = hqp.robots.load("ur5")
    run = hqp.Controller(Stack(Level(Posture()), subject_to=[JointLimits()])).session(robot, DT)
    assert units_of(run.program, robot) == {"joint_limits": ["rad"] * 6}
    watch = LimitWatch([(0, 6)], list(robot.joint_names), DT)
    rows = sum(level.m for level in run.problem.levels)
    ticks = itertools.count()

    def look(side: int) -> Any:
        marks = np.zeros(rows, dtype=np.int8)
        marks[2] = side
        return watch.look(bytearray(marks.tobytes()), 0, next(ticks))

    for k in range(500):
        told = look(1 if k % 10 < 5 else -1)
    ((joint, _, why),) = told
    assert joint == robot.joint_names[2]
    assert rate(why) == pytest.approx(1.0 / (5 * DT), rel=0.1)
    for _ in range(int(3.0 * watch.SPAN / DT * math.log(100.0 / watch.OFTEN))):
        told = look(0)
    assert told == []
    assert watch.look(bytearray(), 0, next(ticks)) == []  # a solver that marks no rows
    for k in range(2000):  # slowly from side to side is no alternation
        assert look(1 if k % 200 < 100 else -1) == []
