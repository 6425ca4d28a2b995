"""The time of a tick: what a solver is given follows how late ticks end."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from benchmarks.deadline import overloaded
from hqp.loop import budget
from hqp.loop.budget import FIRST, LATE, LONGEST, STEP, Budget


def test_the_margin_follows_how_late_ticks_end(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, rng, late = 0.0, np.random.default_rng(0), []
    monkeypatch.setattr(budget, "thread_time", lambda: clock)
    each = Budget(1e-3)
    assert each.left(1e-4) == pytest.approx((1.0 - FIRST) * 1e-3 - 1e-4)
    for _ in range(40_000):
        each.begin()
        clock += each.left(1e-4) + 1e-4 + rng.exponential(5e-5)  # what comes after the solver
        late.append(clock)
        each.end(cut=True)
    ends = np.diff([0.0, *late])
    assert np.mean(ends[5000:] > 1e-3) < 5.0 * LATE
    quantile = -5e-5 * math.log(LATE)
    assert abs(each.margin - quantile) < 2.0 * STEP


def test_the_margin_has_its_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = 0.0
    monkeypatch.setattr(budget, "thread_time", lambda: clock)
    each = Budget(1e-3)
    each.end(cut=True)  # of no tick that began
    assert each.margin == FIRST * 1e-3
    for _ in range(100):
        each.begin()
        clock += 1.0
        each.end(cut=True)
    assert each.margin == LONGEST * 1e-3
    each.begin()
    each.end(cut=False)  # in time without being cut
    assert each.margin == LONGEST * 1e-3
    assert each.left(1.0) > 0.0


def test_a_session_keeps_back_what_follows_the_solver() -> None:
    robot = hqp.robots.load("g1")
    run = hqp.Controller(overloaded(robot), hqp.Torque(), deadline=2e-4).session(robot, 0.002)
    for _ in range(100):
        run.step(robot.state())
    assert run._budget.margin > FIRST * 2e-4  # the notes alone take longer
    exact = hqp.Controller(overloaded(robot), hqp.Torque(), deadline=math.inf).session(robot, 0.002)
    for _ in range(3):
        exact.step(robot.state())
    assert exact._limit is None
