"""Arrays of a tick belong to the caller or are read-only; a session works after an interrupt."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack, Status
from hqp.declare.safety import RateLimits
from hqp.errors import ConcurrentUse, HqpError, StaleState
from hqp.loop.tick import Tick
from hqp.robots import Robot
from hqp.tasks import JointLimits, Position, Posture, TorqueLimits

HAND = Position(frame="tool0", name="hand")
FORMULATIONS = [
    pytest.param(hqp.Velocity(), id="velocity"),
    pytest.param(hqp.Acceleration(), id="acceleration"),
    pytest.param(hqp.Torque(), id="torque"),
]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return hqp.robots.load("ur5")


def stack(formulation: Any, *tasks: Any) -> Stack:
    limits = [TorqueLimits()] if isinstance(formulation, hqp.Torque) else [JointLimits()]
    return Stack(*(Level(task) for task in tasks or (HAND,)), Level(Posture()), subject_to=limits)


def arrays(thing: Any, depth: int = 4) -> Iterator[Any]:
    """Every array that a tick, a solution, a state or one of their parts exposes."""
    if isinstance(thing, np.ndarray):
        yield thing
    elif isinstance(thing, (tuple, list)):
        for part in thing:
            yield from arrays(part, depth)
    elif depth and is_dataclass(thing):
        for item in fields(thing):
            yield from arrays(getattr(thing, item.name), depth - 1)
    elif isinstance(thing, Tick):
        names = {name for name in dir(thing) if not name.startswith("__")} - {"line", "_line", "_layout", "program"}
        for name in names:
            part = getattr(thing, name)
            if not callable(part):
                yield from arrays(part, depth)
    elif hasattr(thing, "commanded"):  # a state
        yield from arrays([thing.q, thing.v, thing.commanded], depth)


def spoil(tick: Tick) -> int:
    """Write 99 into every writeable array of a tick; return the number of arrays."""
    count = 0
    for array in arrays(tick):
        count += 1
        if array.flags.writeable:
            array[...] = 99
    return count


KINDS = {
    "plain": False,
    "rates": False,
    "blended": True,
    "blended, rates": True,
    "held": False,
    "held later": False,
}
"""Kinds of ticks; true during a change of stack."""


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_what_a_tick_hands_out_is_the_callers_own(robot: Robot, formulation: Any, kind: str) -> None:
    rates = RateLimits(velocity=5.0, acceleration=500.0, torque=5e3)
    controller = hqp.Controller(
        stack(formulation), formulation, deadline=np.inf, rates=rates if "rates" in kind else None
    )
    runs = [controller.session(each, 0.002) for each in (robot.copy(), robot.copy())]
    goal = HAND.value(robot.state()) + [0.02, -0.03, 0.05]
    q = robot.home + 0.01
    lost = np.full(robot.nq, np.nan)

    def step(run: Any, given: Any) -> Tick:
        return run.step(run.robot.state(given), HAND.at(goal))

    for run in runs:
        for _ in range(3):
            step(run, q)
        if "blended" in kind:
            run.change(stack(formulation, HAND, Position(frame="wrist_1_link", name="wrist")), 0.5)
            for _ in range(3):
                step(run, q)
    if kind == "held later":
        for run in runs:
            step(run, lost)
    ticks = [step(run, lost if "held" in kind else q) for run in runs]
    assert (ticks[0].transition < 1.0) == KINDS[kind]
    assert spoil(ticks[0]) > 4
    for given in (lost, q, q, lost, lost, q, q):
        one, other = (step(run, given) for run in runs)
        np.testing.assert_array_equal(one.command, other.command)
        np.testing.assert_array_equal(one.x, other.x)


def test_hold_values_are_copies(robot: Robot) -> None:
    """Hold the first place of a task that reuses one buffer."""

    @dataclass(frozen=True, kw_only=True)
    class Reused(Position):
        def value(self, state: Any) -> Any:
            buffer[:] = super().value(state)
            return buffer

    buffer = np.zeros(3)
    hand = Reused(frame="tool0", name="hand", law=P(5.0))
    run = hqp.Controller(stack(None, hand), deadline=np.inf).session(robot, 0.002)
    run.step(robot.state())
    for _ in range(3):
        moved = run.step(robot.state(robot.home + 0.02))
        assert np.abs(moved.command).max() > 0.01


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_state_that_is_refused_by_size_cannot_be_advanced_from(robot: Robot, formulation: Any) -> None:
    run = hqp.Controller(stack(formulation), formulation).session(robot, 0.002)
    run.step(robot.state())
    tick = run.step(robot.state(v=np.full(robot.nv, 5e3)))
    assert (tick.status, tick.held) == (Status.INVALID_STATE, 1)
    with pytest.raises(HqpError, match="shoulder_pan_joint: velocity 5000 is too large") as found:
        tick.advance()
    assert not isinstance(found.value, StaleState)


def interrupted(rng: np.random.Generator, longest: float, *calls: Any) -> int:
    """Run the calls in turn, each with a signal after a random time of at most ``longest``; count the interrupts."""
    count = 0
    for k in range(5000):
        try:
            signal.setitimer(signal.ITIMER_REAL, rng.uniform(1e-6, longest))
            calls[k % len(calls)]()
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.getitimer(signal.ITIMER_REAL)  # a last-moment alarm is raised within these lines
        except KeyboardInterrupt:
            count += 1
    return count


@pytest.mark.long
@pytest.mark.parametrize("rates", [None, RateLimits(velocity=1e4)], ids=["native", "general"])
def test_an_interrupt_anywhere_leaves_a_session_that_works(robot: Robot, rates: Any) -> None:
    """In 1266 interrupts, 10 left a session that raised ConcurrentUse in every later call."""
    robot, twin = robot.copy(), robot.copy()
    whole, more = stack(None), stack(None, HAND, Position(frame="wrist_1_link", name="wrist"))
    run, alone = (hqp.Controller(whole, deadline=np.inf, rates=rates).session(r, 0.002) for r in (robot, twin))
    goal = HAND.value(robot.state()) + [0.02, -0.03, 0.05]

    def step() -> Tick:
        return run.step(robot.state(), HAND.at(goal))

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    run.prepare(more)
    step()
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        calls = step, step, lambda: run.change(more, 0.01), step, lambda: step().explain(), lambda: run.change(whole)
        assert interrupted(np.random.default_rng(1), 150e-6, *calls) > 1000
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    run.change(whole)
    alone.step(twin.state(), HAND.at(goal))
    for _ in range(30):
        tick, expected = step(), alone.step(twin.state(), HAND.at(goal))
    np.testing.assert_allclose(tick.command, expected.command, atol=1e-6)


def test_a_call_in_a_call_of_the_same_session_is_refused(robot: Robot) -> None:
    @dataclass(frozen=True, kw_only=True)
    class Asks(Position):
        def jacobian(self, state: Any) -> Any:
            if run is not None:
                with pytest.raises(ConcurrentUse, match="under way"):
                    run.change(run.stack)
                with pytest.raises(ConcurrentUse, match="under way"):
                    run.step(state)
                told.append(True)
            return super().jacobian(state)

    run, told = None, []
    run = hqp.Controller(stack(None, Asks(frame="tool0", name="hand"))).session(robot, 0.002)
    assert run.step(robot.state()).status is Status.OPTIMAL
    assert told
