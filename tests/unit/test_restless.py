"""Joints whose command alternates from limit to limit are named, with how often; calm ones are not."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.loop.restless import OFTEN, SPAN, LimitWatch, Watched
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
        told = float(note.detail.split("limit to limit ")[1].split()[0])
        assert told == pytest.approx(measured, rel=0.35)


def test_a_priced_arm_does_not() -> None:
    assert not [note for tick in out_of_reach("ur5", None) for note in tick.notes if "alternates" in note.detail]


def test_rates_are_counted_and_fade() -> None:
    robot = hqp.robots.load("ur5")
    run = hqp.Controller(Stack(Level(Posture()), subject_to=[JointLimits()])).session(robot, DT)
    watch = LimitWatch(Watched(run.program, robot), DT)
    rows = sum(level.m for level in run.problem.levels)
    assert watch.parts == [slice(0, 6)]

    def marks(side: int) -> list[np.ndarray[Any, np.dtype[np.int8]]]:
        found = np.zeros(rows, dtype=np.int8)
        found[2] = side
        return [found]

    ticks = itertools.count()
    for k in range(500):
        told = watch.look(marks(1 if k % 10 < 5 else -1), next(ticks))
    ((joint, rate),) = told
    assert joint == robot.joint_names[2]
    assert rate == pytest.approx(1.0 / (5 * DT), rel=0.1)
    for _ in range(int(3.0 * SPAN / DT * math.log(100.0 / OFTEN))):
        told = watch.look(marks(0), next(ticks))
    assert told == ()
    assert watch.look((), next(ticks)) == ()  # a solver that marks no rows
    for k in range(2000):  # slowly from side to side is no alternation
        assert watch.look(marks(1 if k % 200 < 100 else -1), next(ticks)) == ()
