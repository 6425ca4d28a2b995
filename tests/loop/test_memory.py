"""Objects of a tick: one Python object with its record, no reference cycles, no growth of memory."""

from __future__ import annotations

import functools
import gc
import math
import operator
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack, Status
from hqp.solvers.lexicographic import Lexicographic, kernel
from hqp.tasks import JointLimits, Position, Posture
from tests.scenes.own_elements import ArmOnly

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

KINDS = {
    "in reach": (0.02, {Status.OPTIMAL}),
    "out of reach": (2.0, {Status.OPTIMAL}),
    "cut": (2.0, {Status.ITERATION_LIMIT}),
    "held": (0.02, {Status.INVALID_STATE}),
    "user element": (0.02, {Status.OPTIMAL}),
}
"""Offset of the targets [m] and the statuses of the ticks."""


def stepped(kind: str, formulation: Any) -> Iterator[Callable[[], Any]]:
    """Yield steps, each with its state and references prepared."""
    robot, hand = hqp.robots.load("ur5"), Position(frame="tool0", name="hand")
    posture = ArmOnly(frame="tool0", name="own") if kind == "user element" else Posture(name="own")
    solver = Lexicographic(max_iterations=1 if kind == "cut" else 1000)
    stack = Stack(Level(hand), Level(posture), subject_to=[JointLimits()])
    session = hqp.Controller(stack, formulation, solver, deadline=math.inf).session(robot, 0.002)
    q, v, start = robot.home.copy(), np.zeros(robot.nv), robot.state().position("tool0")
    offset, i = KINDS[kind][0] * (0.05 if kind == "cut" and formulation.order == 1 else 1.0), 0
    while True:
        sign = -1.0 if kind == "cut" and i % 2 else 1.0  # no working set of an earlier tick fits
        target = start + sign * offset * np.array([math.sin(0.01 * i), 1.0, 0.3])
        state = robot.state(q * math.nan if kind == "held" else q, v)
        given, made = hand.at(target), []

        def step(state: Any = state, given: Any = given, made: Any = made) -> Any:
            made.append(session.step(state, given))
            return made[0]

        yield step
        if kind not in ("held", "cut"):
            q, v = made[0].advance()
        i += 1


@pytest.fixture(autouse=True)
def _without_collection() -> Iterator[None]:
    gc.disable()
    gc.freeze()  # objects of other tests, millions, are neither searched nor counted
    yield
    gc.unfreeze()
    gc.enable()


FORMULATIONS = [hqp.Velocity, hqp.Acceleration, hqp.Torque]


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ticks", [600, pytest.param(10_000, marks=pytest.mark.slow)])
def test_no_cycles_and_no_growth(kind: str, formulation: Any, ticks: int) -> None:
    steps = stepped(kind, formulation())
    for _ in range(200):  # watches of the first ticks fill their windows
        next(steps)()
    gc.collect(), gc.freeze()  # garbage of the session's construction
    blocks, tracked = sys.getallocatedblocks(), len(gc.get_objects())
    for _ in range(ticks):
        tick = next(steps)()
        assert tick.status in KINDS[kind][1]
    assert gc.collect() == 0
    assert len(gc.get_objects()) - tracked < 20
    assert sys.getallocatedblocks() - blocks < 400  # free lists and buffers, not one a tick


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("kind", ["in reach", "out of reach"])
def test_a_tick_is_one_object_and_its_numbers(kind: str, formulation: Any) -> None:
    """Tracked objects that remain after a step: the tick, its lazy notes, sequences of references, views of numbers."""
    steps = stepped(kind, formulation())
    for _ in range(200):
        next(steps)()
    kept: list[Any] = []
    made: list[Counter[str]] = []
    for _ in range(8):
        step = next(steps)
        before = gc.get_objects()  # alive, so that no new object takes an old one's address
        known = {id(each) for each in before}
        kept.append(step())
        after = gc.get_objects()
        new = [each for each in after if id(each) not in known and each is not known and each is not before]
        made.append(Counter(type(each).__name__ for each in new))
    each_time = functools.reduce(operator.and_, made)  # other threads, such as the test runner's, make some between
    assert each_time.pop("Tick") == 1
    assert each_time.pop("HeldBackNotes", 0) == ("out" in kind)
    assert set(each_time) <= {"tuple", "list", "managedbuffer", "memoryview"}
    assert sum(each_time.values()) <= 5
