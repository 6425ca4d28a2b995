"""Compare native ticks with the readable tick in Python, and read the fields of a tick."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Inequality, Level, P, Stack, Status
from hqp.solvers.lexicographic import kernel
from tests.loop.readable_tick import ReadableSession
from tests.scenes.own_elements import ArmOnly

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")


@dataclass(frozen=True, kw_only=True)
class Wall(Inequality):
    """User bound."""

    frame: str
    offset: float

    def rows(self, robot: Any) -> int:
        return 1

    def jacobian(self, state: Any) -> Any:
        return -state.jacobian(self.frame)[0]

    def drift(self, state: Any) -> Any:
        return -state.drift(self.frame)[:1]

    def bounds(self, state: Any) -> Any:
        return state.position(self.frame)[0] - self.offset, np.inf


HAND = t.Position(frame="r_palm", law=None)
ARM = ArmOnly(frame="l_palm", name="arm")
FEET = t.FixedContact(frame="l_sole"), t.FixedContact(frame="r_sole")
NATIVE = Stack(
    Level(*FEET),
    Level(t.Com(axes="xy"), HAND),
    Level(t.Pose(frame="l_palm", name="palm"), t.Orientation(frame="head", axes="yaw", weight=2.0)),
    Level(t.Posture()),
    subject_to=[t.JointLimits(acceleration=None, braking=None)],
)
MIXED = Stack(
    Level(*FEET), Level(HAND, ARM), Level(t.Posture()), subject_to=[Wall(frame="r_palm", offset=0.0, name="wall")]
)


def pair(stack: Stack, formulation: Any, **options: Any) -> tuple[Any, Any]:
    """A session, and the readable one on a separate robot."""
    robot = hqp.robots.load("cbi")
    controller = hqp.Controller(stack, formulation, deadline=np.inf, **{"price": 0, **options})
    return controller.session(robot, 0.002), ReadableSession(controller, robot.copy(), 0.002)


def references(rng: np.random.Generator, stack: Stack, state: Any, order: int) -> list[Any]:
    """Drawn references: none, goals, feedforward, NaN, a goal without a value."""
    found: list[Any] = []
    for element in (HAND, ARM):
        if element.name not in stack or rng.uniform() < 0.3:
            continue
        goal = element.value(state) + 0.05 * rng.normal(size=3)
        if rng.uniform() < 0.05:
            goal[1] = np.nan
        extra = {"velocity": 0.1 * rng.normal(size=3)} if rng.uniform() < 0.5 else {}
        if order == 2 and rng.uniform() < 0.5:
            extra["acceleration"] = rng.normal(size=3)
        found.append(element.at(None if rng.uniform() < 0.2 else goal, **extra))
    return found


@pytest.mark.parametrize("stack", [NATIVE, MIXED], ids=["native", "mixed"])
@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
def test_ticks_are_the_readable_ones(stack: Stack, formulation: Any) -> None:
    fast, slow = pair(stack, formulation)
    rng, q, v = np.random.default_rng(1), fast.robot.home, np.zeros(fast.robot.nv)
    seen = set()
    for k in range(120):
        if k == 70:  # not the state that the command led to
            v = 0.01 * rng.normal(size=v.size)
        given = references(rng, stack, fast.robot.state(q, v), formulation.order)
        one, other = fast.step(fast.robot.state(q, v), *given), slow.step(q, v, *given)
        seen.add(one.status)
        assert one.status is other.status
        assert {note.element for note in one.notes} == set(other.blamed)
        np.testing.assert_allclose(one.x, other.x, atol=1e-8)
        for w, expected in zip(one.solution.residuals, other.solution.residuals, strict=True):
            np.testing.assert_allclose(w, expected, atol=1e-8)
        assert all((a == b).all() for a, b in zip(one.solution.active, other.solution.active, strict=True))
        q, v = one.advance()
    assert seen == {Status.OPTIMAL, Status.INVALID_REFERENCE}


def test_strides_of_a_reference_do_not_matter() -> None:
    """Columns and transposes are read in the native call, too."""
    fast, slow = pair(NATIVE, hqp.Velocity())
    palm, q, v = NATIVE.find("palm"), fast.robot.home, np.zeros(fast.robot.nv)
    pose = palm.value(fast.robot.state(q))  # type: ignore[union-attr]
    places = np.asfortranarray(np.tile(HAND.value(fast.robot.state(q)) + 0.01, (8, 1)))
    for k in range(8):
        given = hqp.Reference("r_palm", places[k], 0.1 * places[k]), hqp.Reference("palm", np.asfortranarray(pose))
        one, other = fast.step(fast.robot.state(q, v), *given), slow.step(q, v, *given)
        np.testing.assert_allclose(one.x, other.x, atol=1e-9)
        q, v = one.advance()


@pytest.mark.parametrize("limits", [(t.JointLimits(),), ()], ids=["limits", "no limits"])
def test_ticks_with_prices_are_the_readable_ones(limits: tuple[hqp.Element, ...]) -> None:
    """A hand target leaves the reach and returns: ticks that keep the exact answer, and ticks of stages."""
    robot = hqp.robots.load("ur5")
    hand = t.Pose(frame="tool0")
    controller = hqp.Controller(Stack(Level(hand), Level(t.Posture()), subject_to=limits), deadline=np.inf)
    fast, slow = controller.session(robot, 0.002), ReadableSession(controller, robot.copy(), 0.002)
    q, v = robot.integrate(robot.home, np.array((0.3, -1.0, 1.2, -0.8, 0.6, 0.2)), 1.0), np.zeros(robot.nv)
    start, staged = hand.value(robot.state(q)), []
    for k in range(400):
        goal = start.copy()
        goal[0, 3] += 1.5 * max(0.0, np.sin(2.0 * np.pi * k / 200))
        one, other = fast.step(robot.state(q, v), hand.at(goal)), slow.step(q, v, hand.at(goal))
        staged.append(other.solution.stage_points is not None)
        np.testing.assert_allclose(one.x, other.x, rtol=0.0, atol=1e-10)  # separate kinematics: to rounding
        assert one.status is other.status
        assert (one.solution.stage_points is not None) == staged[-1]
        if staged[-1]:
            points = one.solution.stage_points
            np.testing.assert_allclose(points, other.solution.stage_points, rtol=0.0, atol=1e-10)
            np.testing.assert_array_equal(pickle.loads(pickle.dumps(one)).solution.stage_points, points)
        for mine, expected in zip(one.solution.active, other.solution.active, strict=True):
            np.testing.assert_array_equal(mine, expected)
        q, v = one.advance()
    assert min(sum(staged), 400 - sum(staged)) > 50
    assert sum(a != b for a, b in pairwise(staged)) >= 2


def test_what_a_tick_tells_stays() -> None:
    fast, _ = pair(NATIVE, hqp.Velocity())
    robot = fast.robot
    ticks, commands = [], []
    for k in range(5):
        state = robot.state()
        tick = fast.step(state, HAND.at(HAND.value(state) + 0.01 * k))
        ticks.append(tick)
        commands.append(tick.command.copy())
    for k, (tick, command) in enumerate(zip(ticks, commands, strict=True)):
        assert tick.solution is not None
        np.testing.assert_array_equal(tick.command, command)
        np.testing.assert_array_equal(robot.actuation @ tick.solution.x, command)
        assert tick.solution.stats.iterations >= 1
        assert tick.times is not None
        assert 0.0 < tick.times.solve < 1.0
        assert tick.unwrap() is tick.command
        plain = pickle.loads(pickle.dumps(tick))
        assert (plain.status, plain.notes, plain.held) == (Status.OPTIMAL, (), 0)
        np.testing.assert_array_equal(plain.command, command)
        if k:
            np.testing.assert_allclose(abs(tick.jump.change), np.abs(command - commands[k - 1]).max(), atol=1e-12)
    with pytest.raises(hqp.HqpError, match="latest step"):
        ticks[1].explain()


def test_a_command_is_the_callers_own() -> None:
    fast, _ = pair(NATIVE, hqp.Velocity())
    state = fast.robot.state()
    goal = HAND.at(HAND.value(state) + 0.02)
    first, second = fast.step(fast.robot.state(), goal), fast.step(fast.robot.state(), goal)
    expected = second.command.copy()
    second.command[:] = 99.0
    third = fast.step(fast.robot.state(), goal)
    np.testing.assert_array_equal(third.command, expected)
    assert third.jump.change == 0.0
    held = fast.step(fast.robot.state(np.full(fast.robot.nq, np.nan)), goal)
    assert held.held == 1
    assert np.abs(held.command).max() < 1.1 * np.abs(expected).max()
    assert first.status is Status.OPTIMAL


def test_errors_of_the_program_are_raised_as_ever() -> None:
    fast, _ = pair(NATIVE, hqp.Velocity())
    for _ in range(2):
        fast.step(fast.robot.state())
    old = fast.robot.state()
    fast.robot.state()
    with pytest.raises(hqp.HqpError, match="stale"):
        fast.step(old)
    with pytest.raises(hqp.HqpError, match="closest"):
        fast.step(fast.robot.state(), t.Position(frame="r_plam").at([0, 0, 0]))
    with pytest.raises(hqp.HqpError, match="shape"):
        fast.step(fast.robot.state(), hqp.Reference("r_palm", np.zeros(2)))
    with pytest.raises(hqp.HqpError, match="belongs to"):
        fast.step(fast.robot.copy().state())
    assert fast.step(fast.robot.state()).status is Status.OPTIMAL


def test_a_hold_value_comes_back_after_a_goal() -> None:
    fast, slow = pair(NATIVE, hqp.Velocity(law=P(1.0)))
    for k in range(6):
        goals = [HAND.at([0.3, -0.2, 0.9], velocity=[0.1, 0.0, 0.0])] if k % 2 else []
        one, other = fast.step(fast.robot.state(), *goals), slow.step(slow.robot.home, np.zeros(slow.robot.nv), *goals)
        np.testing.assert_allclose(one.x, other.x, atol=1e-9)


def test_changes_of_status_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    fast, _ = pair(NATIVE, hqp.Velocity())
    bad = np.full(fast.robot.nq, np.nan)
    with caplog.at_level("INFO", logger="hqp.session"):
        for q in (None, None, bad, bad, None, None):
            fast.step(fast.robot.state(q))
    assert [record.levelname for record in caplog.records] == ["WARNING", "INFO"]
    assert "INVALID_STATE state: base" in caplog.records[0].message


@pytest.mark.parametrize("price", [0, None], ids=["exact", "priced"])
def test_torque_ticks_are_the_readable_ones(price: Any) -> None:
    robot = hqp.robots.load("talos")
    soles, palm = robot.landmarks["soles"], robot.landmarks["palms"][0]
    hand, effort = t.Position(frame=palm), t.JointTorque(name="effort")
    rectangle = (-0.1, 0.1, -0.05, 0.05)
    stack = Stack(
        Level(t.Com(name="com", law=hqp.PD(50.0))),
        Level(hand),
        Level(t.Posture(law=hqp.PD(30.0))),
        *([Level(effort)] if price == 0 else []),  # never met: with a price all ticks would be of stages
        subject_to=[
            *(t.FixedContact(frame=sole) for sole in soles),
            t.TorqueLimits(),
            *(t.FrictionCone(contact=sole, mu=0.6) for sole in soles),
            *(t.CenterOfPressure(contact=sole, rectangle=rectangle) for sole in soles),
        ],
    )
    controller = hqp.Controller(stack, hqp.Torque(), price=price, deadline=np.inf)
    fast, slow = controller.session(robot, 0.001), ReadableSession(controller, robot.copy(), 0.001)
    rng, q, v = np.random.default_rng(2), robot.home, np.zeros(robot.nv)
    place = hand.value(robot.state())
    for k in range(120):
        given = [hand.at(place + 0.02 * np.sin(0.02 * k))] if k % 30 else []
        if price == 0 and k % 40 == 7:
            given.append(
                effort.at(rng.normal(size=robot.actuated.size))
            )  # an effort target, without rows on the motion
        if k % 50 == 20:
            given = [hand.at([np.nan, 0.0, 0.0])]
        one, other = fast.step(robot.state(q, v), *given), slow.step(q, v, *given)
        assert one.status is other.status
        np.testing.assert_allclose(one.x, other.x, rtol=1e-9, atol=1e-7)
        forces = [s.program.contact_forces(tick.x) for s, tick in ((fast, one), (slow, other))]
        for sole in soles:
            np.testing.assert_allclose(forces[0][sole], forces[1][sole], rtol=1e-8, atol=1e-6)
        np.testing.assert_allclose(fast.program.dynamics.h, slow.program.dynamics.h, rtol=1e-7, atol=1e-7)
        q, v = one.advance()
        assert min(one.times.assemble, one.times.solve) > 0.0


@pytest.mark.long
def test_a_state_that_moves_fast_is_ordinary() -> None:
    """Ticks accept a fast state within the bounds of each joint, beyond the quick bound on q'q + v'v."""
    fast, _ = pair(NATIVE, hqp.Velocity())
    robot = fast.robot
    v = np.zeros(robot.nv)
    for _ in range(4):
        state = robot.state(robot.home, v)
        tick = fast.step(state, HAND.at(HAND.value(state)))
        v[6:] = 1.5
    assert tick.status is Status.OPTIMAL
    v[6] = 1e6
    tick = fast.step(robot.state(robot.home, v))
    assert tick.status is Status.INVALID_STATE
