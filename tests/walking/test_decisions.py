"""Decisions of a walker on its own model, without a simulation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from hqp import Status
from hqp.walking import Walker
from tests.scenes.walkers import DT, made


def on_its_model(walker: Walker, loads: Any = lambda walker: None) -> Iterator[Any]:
    """Ticks of a walker with a robot that follows its commands; loads: function of the walker for the loads of its
    feet."""
    q, v = walker.start.copy(), np.zeros(walker.robot.nv)
    while True:
        state = walker.robot.state(q, v)
        tick = walker.step(state, loads(walker))
        yield tick
        q, v = tick.advance()


def test_a_stop_ends_between_the_feet(robot: Any) -> None:
    walker = made(robot)
    walker.go(forward=0.2)
    ticks, planned = on_its_model(walker), np.zeros(2)
    for k in range(round(6.0 / DT)):
        next(ticks)
        if k == round(1.5 / DT):
            walker.stop()
        if walker.phase == "swing" and not walker.walking:
            planned = np.array(walker._native.planned(math.inf))
        if k > round(1.5 / DT) and walker.phase == "stand":
            break
    assert walker.phase == "stand"
    assert np.abs(planned - 0.5 * (walker.holds[0].xy + walker.holds[1].xy)).max() < 2e-3


def test_the_plan_waits_for_a_late_foot(robot: Any) -> None:
    """Loads of the feet: the swing foot never touches the ground."""

    def loads(walker: Walker) -> list[float]:
        if walker.phase != "swing":
            return [0.5 * walker.weight, 0.5 * walker.weight]
        return [walker.weight * (side == walker.stance) for side in (0, 1)]

    walker = made(robot)
    walker.go()
    early, late = [], []
    for _, _ in zip(on_its_model(walker, loads), range(round(3.0 / DT)), strict=False):
        if walker.phase == "swing":
            state = walker._state
            late_by = state.t - state.duration
            (early if late_by < -DT else late if late_by > DT else []).append(state.since)
            if len(late) > 10:
                break
    assert len(early) > 10
    assert len(late) > 10
    assert np.ptp(late) == 0.0
    assert np.diff(early).max() == pytest.approx(DT)


def test_the_sum_of_errors_grows_within_the_sole_and_stops_at_its_edge(robot: Any) -> None:
    walker = made(robot)
    q, v = walker.start.copy(), np.zeros(walker.robot.nv)
    walker.step(walker.robot.state(q, v))
    q[0] += 0.003
    for _ in range(20):
        before = np.array(walker._state.sum)
        walker.step(walker.robot.state(q, v))
        assert not walker.edge
        assert walker._state.sum[0] > before[0]
    v[0] = 0.6
    for _ in range(20):
        before = np.array(walker._state.sum)
        walker.step(walker.robot.state(q, v))
        assert walker.edge
        assert np.all(walker._state.sum == before)


def test_a_stop_of_the_session_ends_the_walk_first(robot: Any) -> None:
    walker = made(robot)
    session = walker.session
    walker.go(forward=0.1)
    ticks, ended = on_its_model(walker), 0
    for tick in ticks:
        if walker.phase == "swing" and not session.stopping and not session.stopped:
            session.stop("operator")
            assert session.stopping == "operator"
            assert session.stopped == ""
            walker.go(forward=0.1)
            assert not walker.walking
            assert "operator" in walker.why[0]
        if tick.status is Status.STOPPED:
            assert walker.phase == "stand"
            assert (session.stopping, session.stopped) == ("", "operator")
            ended += 1
        else:
            assert ended == 0
        if ended == 50:
            break
        assert walker.time < 6.0
    session.resume()
    walker.go(forward=0.1)
    assert walker.walking
    while walker.phase != "swing":
        assert next(ticks).status.usable
    session.stop("again")
    session.resume()  # before the walk has ended
    assert session.stopping == ""
    session.stop("fallen", at_once=True)
    assert next(ticks).status is Status.STOPPED


def test_a_walker_that_stands_is_stopped_at_once(robot: Any) -> None:
    walker = made(robot)
    walker.session.stop("before the start")
    assert next(on_its_model(walker)).status is Status.STOPPED
