"""Hands out of reach for many seconds: calm persists, and arms that can move do not stall."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack
from hqp.declare.law import Law
from hqp.declare.robot import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture
from tests.scenes.calm import arrival, distance, drawn, straight
from tests.scenes.calm.variants import PRICED

RESTLESS = 0.02
"""Median over 0.8 s of the largest change of a joint's speed in a tick [rad/s]; bang-bang in the window is 0.1."""


def stack_of(robot: Robot, com: Law, base: Law, posture: Law, hand: Position) -> Stack:
    """CoM > hand > base > posture, s.t. feet and joint limits."""
    return Stack(
        Level(Com(axes="xy", law=com)),
        Level(hand),
        Level(Orientation(frame=robot.landmarks["base"][0], law=base, name="base")),
        Level(Posture(law=posture)),
        subject_to=[*(FixedContact(frame=sole) for sole in robot.landmarks["soles"]), JointLimits()],
    )


def restless(name: str, ahead: list[float], gain: float = 1.0, ticks: int = 4000, dt: float = 0.002) -> int:
    """Count restless periods of 0.8 s after the first two; base and posture have no speed limit."""
    robot = hqp.robots.load(name)
    hand = Position(frame=robot.landmarks["palms"][1], law=P(5.0, max_velocity=0.5), name="hand")
    stack = stack_of(robot, P(2.0), P(2.0), P(gain), hand)
    session = hqp.Controller(stack, deadline=math.inf).session(robot, dt)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal, commands = robot.state(q).position(hand.frame) + np.array(ahead), []
    for _ in range(ticks):
        tick = session.step(robot.state(q, v), hand.at(goal))
        commands.append(tick.command)
        q, v = tick.advance()
    change = np.abs(np.diff(np.array(commands), axis=0)).max(axis=1)
    period = round(0.8 / dt)
    slow = RESTLESS * dt / 0.002
    return sum(float(np.median(change[k : k + period])) > slow for k in range(2 * period, ticks - 1, period))


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "ahead"),
    [
        ("talos", [0.7, 0.0, 0.25]),
        ("g1", [-0.6, 0.0, 0.1]),
        ("g1", [0.7, 0.0, 0.25]),
        ("g1", [0.3, -0.3, 0.9]),
        ("cbi", [0.7, 0.0, 0.25]),
        ("cbi", [0.3, -0.3, 0.9]),
        ("icub", [0.3, -0.3, 0.9]),
    ],
)
def test_out_of_reach_it_stays_calm(name: str, ahead: list[float]) -> None:
    """A posture as fast as its law demands turns the rows of hand and base from tick to tick."""
    assert restless(name, ahead) == 0


@pytest.mark.parametrize(("name", "dt"), [("g1", 0.01), ("icub", 0.01), ("cbi", 0.02), ("icub", 0.02)])
def test_at_slow_rates_too(name: str, dt: float) -> None:
    """At 100 and 50 Hz the rows turn further in a tick."""
    assert restless(name, [0.3, -0.3, 0.9], ticks=round(9.0 / dt), dt=dt) == 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "loop"),
    [
        (42, "cbi, 5 ms"),
        (110, "icub, 10 ms"),
        (465, "g1, 10 ms"),
        (341, "solo12, 5 ms"),
        pytest.param(339, "cbi, 2 ms", marks=pytest.mark.slow),
    ],
)
def test_an_eager_base_below_hands_out_of_reach(seed: int, loop: str) -> None:
    """Base and hands use the same joints."""
    (found,) = drawn.loops("velocity", [seed])
    assert loop == f"{found['robot']}, {found['scene'].split(': ')[1].split(', ')[0]}"
    assert float(found["reversals"]) < 5.0
    assert float(found["acceleration_p50"]) < 1.0
    assert float(found["acceleration_p99"]) < 30.0


def test_a_base_that_moves_by_an_elbow_whose_hand_is_held() -> None:
    """An elbow turns the rows of the base through those of the hand, which has none of the base's columns."""
    (found,) = drawn.loops("velocity", [375])
    assert str(found["robot"]) == "g1"
    assert float(found["reversals"]) < 5.0
    assert float(found["acceleration_p50"]) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "gain"), [("g1", 1.0), ("g1", 10.0), ("cbi", 10.0)])
@pytest.mark.parametrize("ahead", [[0.7, 0.0, 0.25], [0.3, -0.3, 0.9]])
def test_for_twenty_seconds_and_with_eager_postures(name: str, ahead: list[float], gain: float) -> None:
    assert restless(name, ahead, gain, 10_000) <= 1


@pytest.mark.long
@pytest.mark.parametrize("ahead", [[1.0, 0.0, 0.0], [0.3, -0.3, 0.9]])
def test_torques_do_not_jump_as_a_level_comes_to_be_unmet(ahead: list[float]) -> None:
    """A posture with kp = 100 is slowed over some tens of ticks."""
    robot = hqp.robots.load("talos")
    law = PD(100.0, 20.0, max_velocity=0.4)
    hand = Position(frame=robot.landmarks["palms"][1], law=law, name="hand")
    stack = stack_of(robot, law, PD(100.0, 20.0), PD(100.0, 20.0), hand)
    session = hqp.Controller(stack, hqp.Torque(contact_law=PD(0.0, 40.0)), deadline=math.inf).session(robot, 0.002)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal, commands = robot.state(q).position(hand.frame) + np.array(ahead), []
    for _ in range(1500):
        tick = session.step(robot.state(q, v), hand.at(goal))
        commands.append(tick.command)
        q, v = tick.advance()
    allowed = np.maximum(5.0, 0.1 * robot.effort_limit[robot.actuated])
    assert (np.abs(np.diff(np.array(commands), axis=0)) < allowed).all()


@pytest.mark.long
@pytest.mark.parametrize("formulation", ["velocity", pytest.param("acceleration", marks=pytest.mark.slow), "torque"])
@pytest.mark.parametrize(
    "joints", [2, pytest.param(3, marks=pytest.mark.slow), 6, pytest.param(7, marks=pytest.mark.slow)]
)
def test_a_nearly_straight_arm_arrives_at_a_target_on_its_line(joints: int, formulation: str) -> None:
    """The posture, attracted to the straight arm, must not undo the small motion along the nearly lost direction."""
    records = list(straight.measure(formulation, [joints], PRICED))
    assert len(records) == 6
    assert not list(straight.misses(records))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "panda", "xarm7", "g1", "talos"])
def test_goals_on_a_straight_way_are_reached(name: str) -> None:
    """A speed limit keeps the demand within the joints' ability, so that the hand moves straight."""
    records = [r for r in arrival.measure(name, range(48), PRICED) if r["joined"] and r["limited"]]
    assert records
    assert not [r for r in records if r["priced"] == math.inf > r["exact"]]


@pytest.mark.slow
def test_a_hand_out_of_reach_comes_near() -> None:
    for record in distance.measure(["ur5", "cbi", "talos"], PRICED):
        assert record["off"] - record["least"] < record["allowed"], record


def test_a_gripper_is_not_slowed_with_the_arm() -> None:
    """Its joints turn no row of the hand."""
    robot = hqp.robots.load("panda")
    hand = Position(frame="panda_hand", law=P(5.0, max_velocity=0.4), name="hand")
    posture = Posture(law=P(5.0), name="posture")
    stack = Stack(Level(hand), Level(posture), subject_to=[JointLimits()])
    session = hqp.Controller(stack, deadline=math.inf).session(robot, 0.002)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    goal, wanted = robot.state(q).position(hand.frame) + np.array([1.5, 0.0, 0.0]), q.copy()
    wanted[-2:] = np.where(q[-2:] < 0.02, 0.03, 0.01)
    for _ in range(1000):
        q, v = session.step(robot.state(q, v), hand.at(goal), posture.at(wanted)).advance()
    np.testing.assert_allclose(q[-2:], wanted[-2:], atol=1e-3)


def test_the_other_arm_follows_its_posture() -> None:
    """Its joints are in no row of the unreachable hand: they turn no rows."""
    robot = hqp.robots.load("baxter", floating=False)
    hand = Position(frame="left_gripper_base_link", law=P(5.0, max_velocity=0.4), name="hand")
    posture = Posture(law=P(10.0), name="posture")
    stack = Stack(Level(hand), Level(posture), subject_to=[JointLimits()])
    session = hqp.Controller(stack, deadline=math.inf).session(robot, 0.002)
    shoulder = robot.joints("right_s0")[0]
    q, v = robot.home.copy(), np.zeros(robot.nv)
    state = robot.state(q, v)
    goal, wanted, feed = state.position(hand.frame) + np.array([1.0, 0.0, 0.0]), state.angles.copy(), np.zeros(robot.nv)
    for k in range(2000):
        wanted[shoulder], feed[shoulder] = 0.5 * math.sin(0.004 * k), math.cos(0.004 * k)
        state = robot.state(q, v)
        if k > 500:
            assert abs(state.angles[shoulder] - wanted[shoulder]) < 5e-3
        q, v = session.step(state, hand.at(goal), posture.at(wanted, velocity=feed)).advance()
    assert np.linalg.norm(robot.state(q).position(hand.frame) - goal) > 0.5
