"""Time budget of a tick: the solver's share follows the measured lateness of ticks."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack, Status
from hqp._session import Budget
from hqp.problem import Shape
from hqp.solvers.lexicographic import Lexicographic
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture
from tests.scenes.altered import AlteredWorkspace, Answers
from tests.scenes.overloaded import overloaded

LATE, STEP, FIRST, LONGEST = Budget.LATE, Budget.STEP, Budget.FIRST, Budget.LONGEST


def test_the_margin_follows_how_late_ticks_end() -> None:
    clock, rng, late = 0.0, np.random.default_rng(0), []
    each = Budget(1e-3)
    assert each.left(1e-4) == pytest.approx((1.0 - FIRST) * 1e-3 - 1e-4)
    for _ in range(40_000):
        each.begin(clock)
        clock += each.left(1e-4) + 1e-4 + rng.exponential(5e-5)  # work after the solver
        late.append(clock)
        each.end(clock, True)
    ends = np.diff([0.0, *late])
    assert np.mean(ends[5000:] > 1e-3) < 5.0 * LATE
    quantile = -5e-5 * math.log(LATE)
    assert abs(each.margin - quantile) < 2.0 * STEP


def test_the_margin_has_its_limits() -> None:
    clock = 0.0
    each = Budget(1e-3)
    each.end(clock, True)  # no tick has begun
    assert each.margin == FIRST * 1e-3
    for _ in range(100):
        each.begin(clock)
        clock += 1.0
        each.end(clock, True)
    assert each.margin == LONGEST * 1e-3
    each.begin(clock)
    each.end(clock, False)  # in time, uncut
    assert each.margin == LONGEST * 1e-3
    assert each.left(1.0) > 0.0
    each.begin(clock)
    each.skip()
    each.end(clock + 1.0, True)  # this tick was not measured
    assert each.margin == LONGEST * 1e-3


def test_a_session_keeps_back_what_follows_the_solver() -> None:
    robot = hqp.robots.load("g1")
    run = hqp.Controller(overloaded(robot), hqp.Torque(), deadline=1e-5).session(robot, 0.002)
    late = 0
    for _ in range(100):
        late += run.step(robot.state()).status is Status.TIME_LIMIT
    assert late > 90  # no machine reads the state in 10 us
    assert run.line.native.margin != FIRST * 1e-5  # it has adapted to late ticks
    exact = hqp.Controller(overloaded(robot), hqp.Torque(), deadline=math.inf).session(robot, 0.002)
    for _ in range(3):
        assert exact.step(robot.state()).status is not Status.TIME_LIMIT


DELAY = [0.0]
"""Time that the rows of ``Slow`` take [s]."""


@dataclass(frozen=True, kw_only=True)
class Slow(Position):
    """User task with slow rows."""

    def jacobian(self, state: Any) -> Any:
        time.sleep(DELAY[0])
        return super().jacobian(state)


def test_a_tick_that_was_held_up_costs_the_next_ones_nothing() -> None:
    robot = hqp.robots.load("g1")
    hand = Slow(frame="left_rubber_hand", law=P(5.0, max_velocity=0.4), name="hand")
    feet = [FixedContact(frame=f"{side}_ankle_roll_link") for side in ("left", "right")]
    stack = Stack(Level(Com(axes="xy")), Level(hand), Level(Posture()), subject_to=[*feet, JointLimits()])
    run = hqp.Controller(stack, deadline=0.02).session(robot, 0.002)
    far, state = hand.at(robot.state().position(hand.frame) + np.array([1.0, 0.0, 0.0])), robot.state()
    run.step(state, far)
    DELAY[0] = 0.05
    try:
        run.step(robot.state(), far)
    finally:
        DELAY[0] = 0.0
    found = []
    for _ in range(20):
        q, _ = run.step(robot.state(), far).advance()
        found.append(run.step(robot.state(q), far).status)
    assert found.count(Status.TIME_LIMIT) < 10, found


class RecordedWorkspace(AlteredWorkspace):
    """Workspace that records its time limits."""

    def __init__(self, whole: Any, given: dict[int, list[float]]) -> None:
        super().__init__(whole, Answers())
        self._given = given.setdefault(id(self), [])

    def limit(self, seconds: float) -> None:
        """Time for the next solve [s]."""
        self._given.append(seconds)
        self._whole.limit(seconds)  # type: ignore[attr-defined]


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded(Lexicographic):
    """Python solver that records its time limits by workspace."""

    given: Any = None

    def workspace(self, shape: Shape) -> Any:
        """Allocate for problems of this shape."""
        return RecordedWorkspace(super().workspace(shape), self.given)


def test_time_spent_on_rows_is_taken_off_what_the_solver_gets() -> None:
    robot, given = hqp.robots.load("ur5"), dict[int, list[float]]()
    solver = Recorded(given=given)
    run = hqp.Controller(Stack(Level(Slow(frame="tool0"))), solver=solver, deadline=2.0).session(robot, 0.002)
    run.step(robot.state())  # the first solve has no time limit
    (times,) = given.values()
    whole = times[-1]
    DELAY[0] = 0.05
    try:
        for _ in range(3):
            assert run.step(robot.state()).status is Status.OPTIMAL
            assert times[-1] <= whole - 0.0499
    finally:
        DELAY[0] = 0.0


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Torque()], ids=["velocity", "torque"])
def test_two_stacks_in_a_transition_share_the_deadline(formulation: Any) -> None:
    robot, deadline, given = hqp.robots.load("ur5"), 1e-3, dict[int, list[float]]()
    whole = Stack(Level(Position(frame="tool0")), Level(Posture()))
    run = hqp.Controller(whole, formulation, Recorded(given=given), deadline=deadline).session(robot, 0.002)
    run.step(robot.state())
    run.change(whole.without("tool0"), 0.1)
    for _ in range(5):
        run.step(robot.state())
        assert len(given) == 2  # a time limit stays until the next one is set
        assert sum(times[-1] for times in given.values()) <= deadline
