"""Torques stay within a few times the motors' limits although the stack declares none."""

import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, P, Stack, Torque
from hqp.lab.rivals.compare import _torque_stack
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture, TorqueLimits
from hqp.torque.motors import OVERLOAD

DT = 0.002


def reaching(robot: Any) -> tuple[Stack, Position]:
    """Feet with friction and centre of pressure, balance, a hand, the base, a posture; no limits of torques."""
    hand = Position(frame=robot.landmarks["palms"][1], law=P(5.0), name="hand")
    base = Orientation(frame=robot.landmarks["base"][0], law=P(2.0), name="base")
    levels = Level(Com(axes="xy", law=P(2.0))), Level(hand), Level(base), Level(Posture(law=P(1.0)))
    feet = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    return _torque_stack(Stack(*levels, subject_to=[*feet, JointLimits()])).without("torque_limits"), hand


@pytest.mark.long
@pytest.mark.parametrize("name", ["talos", "g1"])
def test_a_leg_that_comes_to_be_straight_takes_no_absurd_torque(name: str) -> None:
    """The hand's target moves 1.5 m away within a second: 1e7 N m and more in single ticks without the limits."""
    robot = hqp.robots.load(name)
    stack, hand = reaching(robot)
    session = hqp.Controller(stack, Torque(contact_law=PD(0.0, 40.0)), deadline=math.inf).session(robot, DT)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    place = robot.state(q).position(hand.frame)
    limit = robot.effort_limit[robot.actuated]
    for k in range(1000):
        tick = session.step(robot.state(q, v), hand.at(place + np.array([1.5 * min(1.0, k * DT), 0.0, 0.0])))
        assert tick.status.solved, (k, tick.notes)
        assert np.all(np.abs(tick.command) <= OVERLOAD * limit * (1.0 + 1e-9))
        q, v = tick.advance()


def test_what_leaves_torques_free() -> None:
    robot = hqp.robots.load("talos")
    stack, _ = reaching(robot)
    equalities = Stack(*stack.levels, subject_to=[e for e in stack.subject_to if e.equality])

    def elements(stack: Stack, formulation: Torque, **options: Any) -> list[str]:
        session = hqp.Controller(stack, formulation, **options).session(robot, DT)
        return [element.name for element in session.stack.subject_to]

    assert elements(stack, Torque())[0] == "motors"
    assert "motors" not in elements(stack, Torque(), price=0)
    assert "motors" not in elements(stack, Torque(effort_limits=False))
    assert "motors" not in elements(equalities, Torque(), solver="nullspace")
    own = TorqueLimits(joints=robot.joint_names[0])
    assert "motors" not in elements(Stack(*stack.levels, subject_to=[own, *stack.subject_to]), Torque())
    unlimited = robot.copy()
    unlimited.effort_limit = np.full(robot.nv, np.inf)
    session = hqp.Controller(stack, Torque()).session(unlimited, DT)
    assert "motors" not in session.stack


def test_a_motor_that_could_not_hold_the_robot_is_left_out_and_told(caplog: pytest.LogCaptureFixture) -> None:
    robot = hqp.robots.load("talos").copy()
    stack, _ = reaching(robot)
    knee = robot.actuated[robot.joint_names.index("leg_left_4_joint")]
    robot.effort_limit = robot.effort_limit.copy()
    robot.effort_limit[knee] = 1.0
    with caplog.at_level("WARNING", logger="hqp"):
        session = hqp.Controller(stack, Torque()).session(robot, DT)
    assert "leg_left_4_joint 1 of " in session.dropped
    assert session.dropped in caplog.text
    tick = session.step(robot.state())
    assert tick.status is hqp.Status.OPTIMAL
    assert abs(tick.command[robot.joint_names.index("leg_left_4_joint")]) > OVERLOAD
