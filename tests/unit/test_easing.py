"""Easing of rows that only one of two stacks has: the rows, their shares, the saved time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, Stack
from hqp.loop.way import added
from hqp.tasks import Com, FixedContact, Position, Posture
from tests.scenes.changes import Loop, lifted, stack


def test_a_pair_is_eased_where_it_differs_in_motions_alone() -> None:
    robot = hqp.robots.load("talos")
    whole = stack(robot, "acceleration")
    bare = whole.without("hand")
    right = robot.landmarks["soles"][1]
    assert added(bare, whole) == ("hand",)
    assert added(lifted(whole, robot), whole) == (right,)
    assert added(whole, bare) == ()
    assert added(whole, whole) == ()
    com, hand, trunk, posture = whole.levels
    assert added(bare, Stack(com, trunk, hand, posture, subject_to=whole.subject_to)) == ("hand",)
    assert added(bare, Stack(trunk, com, hand, posture, subject_to=whole.subject_to)) == ()  # priorities, too
    assert added(bare, Stack(com, hand, trunk, posture, subject_to=whole.subject_to[:2])) == ()  # limits, too
    beside = Stack(Level(*com, *hand), trunk, posture, subject_to=whole.subject_to)
    assert added(bare, beside) == ("hand",)
    slow = Stack(Level(*com, price=0), hand, trunk, posture, subject_to=whole.subject_to)
    assert added(bare, slow) == ()  # the price differs


@pytest.mark.parametrize("level", ["velocity", "acceleration"])
def test_a_task_that_is_added_out_of_reach_costs_ordinary_ticks(level: str) -> None:
    """The hand starts far from its target: its own solve took priced stages, 6 to 8 plain ticks each."""
    robot = hqp.robots.load("talos")
    whole = stack(robot, level)
    loop = Loop(robot, whole.without("hand"), level)
    loop.go(50, loop.goals(0.0))
    loop.run.change(whole, 0.25)
    at_once = robot.copy()
    twin = hqp.Controller(whole, loop.run.controller.formulation, deadline=np.inf).session(at_once, 0.002)
    assert twin.step(at_once.state(loop.q, loop.v), *loop.goals(0.0)).solution.stage_points is not None  # type: ignore[union-attr]
    found = loop.go(124, loop.goals(0.0))
    staged = sum(tick.solution is not None and tick.solution.stage_points is not None for tick in found)
    assert staged <= 12, f"{staged} of {len(found)} ticks"
    assert all(tick.transition < 1.0 for tick in found)


def test_the_row_gets_its_share_between_the_two_stacks() -> None:
    """Row h b + (1 - h) J x_a, with b the row's own demand and x_a the solution without it."""
    robot = hqp.robots.load("talos")
    whole = stack(robot, "acceleration")
    loop = Loop(robot, whole.without("hand"), "acceleration")
    loop.hand = robot.state().position(robot.landmarks["palms"][1]) + [0.002, 0.001, 0.001]  # within reach all the way
    loop.go(50, loop.goals(0.0))
    loop.run.change(whole, 0.25)
    hand = whole.find("hand", Position)
    shares = []
    law: Any = loop.run.controller.formulation
    kp, kd = law.law.kp, law.law.kd
    for _ in range(124):
        state = robot.state(loop.q, loop.v)
        J, drift = hand.jacobian(state), hand.drift(state)
        asked = -kp * (state.position(hand.frame) - loop.hand) - kd * J @ loop.v - drift
        (tick,) = loop.go(1, loop.goals(0.0))
        transition: Any = loop.run.line.transition
        given, without = J @ tick.x, J @ transition.lines[0].x
        way = asked - without
        shares.append((float((given - without) @ way / (way @ way)), tick.transition))
    off = max(abs(share - h) for share, h in shares)
    assert off < 1e-6


def test_the_native_loop_asks_for_all_of_a_task_again_after_the_change() -> None:
    robot = hqp.robots.load("talos")
    feet = [FixedContact(frame=frame) for frame in robot.landmarks["soles"]]
    bare = Stack(Level(Com(name="com")), Level(Posture()), subject_to=feet)
    hand = Position(frame=robot.landmarks["palms"][1], name="hand")
    whole = Stack(Level(Com(name="com")), Level(hand), Level(Posture()), subject_to=feet)
    run = hqp.Controller(bare, deadline=np.inf).session(robot, 0.002)
    state = robot.state()
    goal = state.position(hand.frame) + [0.01, 0.0, 0.01]
    run.step(state)
    run.change(whole, 0.01)
    while run.step(state, hand.at(goal)).transition < 1.0:
        pass
    tick = run.step(state, hand.at(goal))
    twin = hqp.Controller(whole, deadline=np.inf).session(robot, 0.002)
    twin.step(state)
    assert np.abs(tick.command - twin.step(state, hand.at(goal)).command).max() < 1e-9
    run.change(bare)
    run.step(state)
    run.change(whole, 0.1)
    for _ in range(5):
        run.step(state, hand.at(goal))
    run.change(whole)  # in the middle of a transition
    for _ in range(3):  # the general path, then the native one
        last = run.step(state, hand.at(goal))
        assert np.abs(last.command - tick.command).max() < 1e-9


@pytest.mark.parametrize("level", ["velocity", "acceleration"])
def test_a_contact_on_its_way_out_is_held_where_it_is(level: str) -> None:
    """Compare the quick way, written into the rows, with a caller's reference in each tick."""
    robot = hqp.robots.load("g1")
    whole = stack(robot, level)
    foot = whole.find(robot.landmarks["soles"][1], FixedContact)
    loops = Loop(robot, whole, level), Loop(robot, whole, level)
    for loop in loops:
        loop.shift(200)
        loop.run.change(lifted(whole, robot), 0.2)
    for _ in range(98):
        own, by_hand = loops
        own.go(1, own.goals(1.0))
        by_hand.go(1, [*by_hand.goals(1.0), foot.hold(robot.state(by_hand.q, by_hand.v))])
        assert own.ticks[-1].transition < 1.0
        assert np.abs(own.ticks[-1].command - by_hand.ticks[-1].command).max() < 1e-7
    assert np.abs(own.ticks[-1].command - own.ticks[-98].command).max() > 1e-3


@pytest.mark.parametrize("level", ["velocity", "acceleration"])
def test_rows_that_are_left_out_stay_out(level: str) -> None:
    robot = hqp.robots.load("g1")
    whole = stack(robot, level)
    loop = Loop(robot, whole.without("hand"), level)
    loop.go(20, loop.goals(0.0))
    hand = whole.find("hand", Position)
    for target, reference in ((whole, hand.at([np.nan, 0.0, 0.0])), (lifted(whole, robot), hand.at())):
        loop.run.change(target, 0.1)
        for _ in range(60):
            state = robot.state(loop.q, loop.v)
            tick = loop.run.step(state, reference)
            assert np.isfinite(tick.command).all()
            assert not tick.held
            loop.q, loop.v = tick.advance()
        assert tick.transition == 1.0
