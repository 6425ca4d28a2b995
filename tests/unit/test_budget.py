"""The time of a tick: what a solver is given follows how late ticks end."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack, Status
from hqp._session import Budget
from hqp.declare.safety import RateLimits
from hqp.loop.outgoing import largest_change
from hqp.loop.stepping import step
from hqp.tasks import Com, FixedContact, JointLimits, Position, Posture, TorqueLimits
from tests.scenes.overloaded import overloaded

LATE, STEP, FIRST, LONGEST = Budget.LATE, Budget.STEP, Budget.FIRST, Budget.LONGEST


def test_the_margin_follows_how_late_ticks_end() -> None:
    clock, rng, late = 0.0, np.random.default_rng(0), []
    each = Budget(1e-3)
    assert each.left(1e-4) == pytest.approx((1.0 - FIRST) * 1e-3 - 1e-4)
    for _ in range(40_000):
        each.begin(clock)
        clock += each.left(1e-4) + 1e-4 + rng.exponential(5e-5)  # what comes after the solver
        late.append(clock)
        each.end(clock, True)
    ends = np.diff([0.0, *late])
    assert np.mean(ends[5000:] > 1e-3) < 5.0 * LATE
    quantile = -5e-5 * math.log(LATE)
    assert abs(each.margin - quantile) < 2.0 * STEP


def test_the_margin_has_its_limits() -> None:
    clock = 0.0
    each = Budget(1e-3)
    each.end(clock, True)  # of no tick that began
    assert each.margin == FIRST * 1e-3
    for _ in range(100):
        each.begin(clock)
        clock += 1.0
        each.end(clock, True)
    assert each.margin == LONGEST * 1e-3
    each.begin(clock)
    each.end(clock, False)  # in time without being cut
    assert each.margin == LONGEST * 1e-3
    assert each.left(1.0) > 0.0
    each.begin(clock)
    each.skip()
    each.end(clock + 1.0, True)  # of a tick that was not measured
    assert each.margin == LONGEST * 1e-3


def test_a_session_keeps_back_what_follows_the_solver() -> None:
    robot = hqp.robots.load("g1")
    run = hqp.Controller(overloaded(robot), hqp.Torque(), deadline=2e-4).session(robot, 0.002)
    for _ in range(100):
        run.step(robot.state())
    assert run.line.budget.margin > FIRST * 2e-4  # the notes alone take longer
    exact = hqp.Controller(overloaded(robot), hqp.Torque(), deadline=math.inf).session(robot, 0.002)
    for _ in range(3):
        exact.step(robot.state())
    assert exact.line.limit is None


def test_a_tick_that_was_held_up_costs_the_next_ones_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = hqp.robots.load("g1")
    hand = Position(frame="left_rubber_hand", law=P(5.0, max_velocity=0.4), name="hand")
    feet = [FixedContact(frame=f"{side}_ankle_roll_link") for side in ("left", "right")]
    stack = Stack(Level(Com(axes="xy")), Level(hand), Level(Posture()), subject_to=[*feet, JointLimits()])
    run = hqp.Controller(stack, deadline=0.02).session(robot, 0.002)
    far, state = hand.at(robot.state().position(hand.frame) + np.array([1.0, 0.0, 0.0])), robot.state()
    run.step(state, far)
    fill = run.program.fill
    with monkeypatch.context() as held_up:
        held_up.setattr(run.program, "fill", lambda *given: (time.sleep(0.05), fill(*given)))
        run.line.leave_direct()
        held_up.setattr(run.line, "direct", None)
        step(run.line, state, (far,), None)
    found = []
    for _ in range(20):
        q, _ = run.step(state, far).advance()
        state = robot.state(q)
        found.append(run.step(state, far).status)
    assert found.count(Status.TIME_LIMIT) < 10, found


class Given:
    """What solvers are given in a tick, what had been spent before, and what that took off [s]."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.left: list[float] = []
        self.spent: list[float] = []
        self.taken: list[float] = []
        self.latest: dict[Budget, float] = {}
        original = Budget.left

        def left(budget: Budget, spent: float) -> float:
            self.spent.append(spent)
            self.left.append(original(budget, spent))
            self.taken.append(original(budget, 0.0) - self.left[-1])
            self.latest[budget] = self.left[-1]
            return self.left[-1]

        patch.setattr(Budget, "left", left)


@dataclass(frozen=True, kw_only=True)
class Slow(Position):
    """A user's task whose rows take long."""

    def jacobian(self, state: Any) -> Any:
        time.sleep(5e-3)
        return super().jacobian(state)


@pytest.mark.parametrize("rates", [None, RateLimits(velocity=1e6)], ids=["native", "general"])
def test_time_spent_on_rows_is_taken_off_what_the_solver_gets(
    rates: RateLimits | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = hqp.robots.load("ur5")
    run = hqp.Controller(Stack(Level(Slow(frame="tool0"))), deadline=2.0, rates=rates).session(robot, 0.002)
    run.step(robot.state())  # the very first answer may take its time
    given = Given(monkeypatch)
    for _ in range(3):
        assert run.step(robot.state()).status is Status.OPTIMAL
        assert given.spent[-1] >= 5e-3
        assert given.taken[-1] >= 4.99e-3


def test_time_spent_on_dynamics_is_taken_off_what_the_solver_gets(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = hqp.robots.load("ur5")
    run = hqp.Controller(Stack(Level(Posture())), hqp.Torque(), deadline=2.0).session(robot, 0.002)
    run.step(robot.state())
    prepare = run.line.direct.prepare if run.line.direct is not None else None
    assert prepare is not None
    monkeypatch.setattr(run.line.direct, "prepare", lambda state: (time.sleep(5e-3), prepare(state)))
    given = Given(monkeypatch)
    assert run.step(robot.state()).status is Status.OPTIMAL
    assert given.spent[0] >= 5e-3
    assert given.taken[0] >= 4.99e-3


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Torque()], ids=["velocity", "torque"])
def test_two_stacks_in_a_transition_share_the_deadline(formulation: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, deadline = hqp.robots.load("ur5"), 1e-3
    whole = Stack(Level(Position(frame="tool0")), Level(Posture()))
    run = hqp.Controller(whole, formulation, deadline=deadline).session(robot, 0.002)
    run.step(robot.state())
    run.change(whole.without("tool0"), 0.1)
    given = Given(monkeypatch)
    for _ in range(5):
        run.step(robot.state())
        assert len(given.latest) == 2  # each solver has what it was given until it is given something else
        assert sum(given.latest.values()) <= deadline


def test_a_cut_tick_moves_the_command_a_little(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, rng = hqp.robots.load("g1"), np.random.default_rng(0)
    law = PD(100.0, 20.0, max_velocity=0.4)
    hand = Position(frame="left_rubber_hand", law=law, name="hand")
    feet = [FixedContact(frame=f"{side}_ankle_roll_link") for side in ("left", "right")]
    levels = (Level(Com(axes="xy", law=law)), Level(hand), Level(Posture(law=law)))
    stack = Stack(*levels, subject_to=[*feet, JointLimits(), TorqueLimits()])
    run = hqp.Controller(stack, hqp.Torque(), deadline=1.0).session(robot, 0.002)
    far, state = hand.at(robot.state().position(hand.frame) + np.array([1.0, 0.0, 0.0])), robot.state()
    last, cuts = run.step(state, far).command.copy(), 0
    for k in range(150):
        time_left = float(rng.uniform(1e-6, 2e-4)) if k % 3 == 0 else 1.0
        monkeypatch.setattr(Budget, "left", lambda self, spent, found=time_left: found)
        assert run.line.limit is not None
        run.line.limit(time_left)
        tick = run.step(state, far)
        if tick.status is Status.TIME_LIMIT:
            cuts += 1
            assert np.abs(tick.command - last).max() <= largest_change("torque", 0.002) + 0.1
        last = tick.command.copy()
        state = robot.state(*tick.advance())
    assert cuts > 0
