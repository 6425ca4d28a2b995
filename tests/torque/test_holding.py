"""Holding torques stay within a share of the torque limits: motors can hold the robot wherever it goes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import PD, Level, Stack, Torque
from hqp.errors import DeclarationError
from hqp.torque.holding import most_needed, within_holding

from ..tasks.test_loads import heavier

DT = 0.002


def reaching(robot: Any, *more: Any) -> tuple[Stack, list[Any]]:
    """Both hand targets are a metre out of reach, on both feet with torque limits."""
    law = PD(25.0, 10.0, max_velocity=0.4)
    hands = [t.Position(frame=palm, law=law, name=palm) for palm in robot.landmarks["palms"]]
    base = t.Orientation(frame=robot.landmarks["base"][0], law=PD(4.0))
    stack = Stack(
        Level(t.Com(axes="xy", law=law, name="com")), Level(*hands), Level(base), Level(t.Posture(law=PD(1.0))),
        subject_to=[*(t.FixedContact(frame=f) for f in robot.landmarks["soles"]), t.JointLimits(), t.TorqueLimits(),
                    *more],
    )  # fmt: skip
    start = robot.state(robot.home)
    return stack, [hand.at(start.position(hand.frame) + [1.5, 0.0, 0.0]) for hand in hands]


def bounded(stack: Stack, robot: Any, share: float = 0.8) -> dict[str, float]:
    """Bounds of a stack by joint."""
    found, _ = within_holding(stack, robot, share)
    held: Any = [e for e in found.subject_to if isinstance(e, t.Within)]
    return dict(zip(held[0].task.joints, held[0].upper, strict=True)) if held else {}


@pytest.mark.long
def test_a_robot_that_reaches_too_far_stays_where_its_motors_hold_it() -> None:
    """Without the bound, Talos bends until its torso has no torque left and falls."""
    robot = hqp.robots.load("talos")
    stack, goals = reaching(robot)
    ends = {}
    for share in (None, 0.8):
        session = hqp.Controller(stack, Torque(holding=share), deadline=math.inf).session(robot, DT)
        q, v, jump, torque = robot.home.copy(), np.zeros(robot.nv), 0.0, None
        start, off = robot.state(q).com()[:2], 0.0
        for _ in range(1400):
            tick = session.step(robot.state(q, v), *goals)
            jump = max(jump, 0.0 if torque is None else float(np.abs(tick.command - torque).max()))
            q, v = tick.advance()
            torque, off = tick.command.copy(), max(off, float(np.abs(robot.state(q).com()[:2] - start).max()))
        ends[share] = off, jump, float(np.abs(v).max())
    assert ends[None][0] > 0.02
    assert ends[0.8][0] < 1e-4
    assert ends[0.8][1] < 5.0
    assert ends[0.8][2] < 1.0


def test_which_joints_are_bounded() -> None:
    talos = hqp.robots.load("talos")
    stack, _ = reaching(talos)
    joints = bounded(stack, talos)
    assert {"torso_2_joint", "arm_left_2_joint", "arm_right_2_joint"} < set(joints)
    assert not any("leg" in joint for joint in joints)  # the feet help to hold them
    assert set(joints.values()) == {0.8}
    palm = talos.landmarks["palms"][0]
    leaning, _ = reaching(talos, t.FixedContact(frame=palm, name="wall"))
    side = "left" if "left" in palm else "right"
    assert not any("torso" in joint or f"arm_{side}" in joint for joint in bounded(leaning, talos))
    free = Stack(*stack.levels, subject_to=[e for e in stack.subject_to if not isinstance(e, t.TorqueLimits)])
    assert not bounded(free, talos)
    own = t.Within(t.HoldingTorque(joints="torso_2_joint"), upper=0.5, name="own")
    assert within_holding(Stack(*stack.levels, subject_to=[*stack.subject_to, own]), talos, 0.8)[1] == ""
    half = Stack(Level(t.Posture()), subject_to=[*free.subject_to, t.TorqueLimits(scale=0.5)])
    assert set(bounded(half, talos).values()) == {0.4}
    ur5 = hqp.robots.load("ur5")
    arm = Stack(Level(t.Posture()), subject_to=[t.TorqueLimits()])
    assert not bounded(arm, ur5)  # its motors hold it in every pose
    carrying = Stack(Level(t.Posture()), subject_to=[t.TorqueLimits(), t.Payload(frame="tool0")])
    assert len(bounded(carrying, ur5)) == 6


def test_motors_that_hold_the_robot_with_more_at_home_are_told() -> None:
    robot = hqp.robots.load("talos").copy()
    robot.effort_limit = robot.effort_limit.copy()
    robot.effort_limit[robot.joints("arm_left_2_joint")] = 5.0
    stack, _ = reaching(robot)
    session = hqp.Controller(stack, Torque()).session(robot, DT)
    assert "arm_left_2_joint" in session.dropped
    assert "arm_left_2_joint" not in bounded(stack, robot)
    exact = hqp.Controller(stack, Torque(), price=0).session(robot, DT)
    assert "holding_torque" not in exact.stack
    assert "holding_torque" in session.stack


@pytest.mark.parametrize("name", ["talos", "panda", "g1", "ur5", "dreamer", "tiago"])
def test_no_posture_needs_more_than_the_bound_says(name: str) -> None:
    robot, rng = hqp.robots.load(name).copy(), np.random.default_rng(0)
    most, task = most_needed(robot), t.HoldingTorque()
    columns = task.columns(robot)
    bodies = [b for c in columns for b, (_, first, count, *_) in enumerate(robot.bodies) if first <= c < first + count]
    for _ in range(200):
        needed = np.abs(task.value(robot.state(robot.random_configuration(rng, 3.0)))) * robot.effort_limit[columns]
        assert np.all(needed <= most[bodies] * (1.0 + 1e-9) + 1e-9)


@pytest.mark.parametrize(("name", "frame"), [("cbi", "r_palm"), ("panda", "panda_hand")])
def test_shares_are_those_of_gravity_with_what_is_carried(name: str, frame: str) -> None:
    robot, rng, task = hqp.robots.load(name).copy(), np.random.default_rng(0), t.HoldingTorque()
    twin = heavier(robot, frame, 3.0, (0.1, -0.05, 0.2))
    columns = task.columns(robot)
    for _ in range(5):
        q = robot.random_configuration(rng)
        state = robot.state(q)
        assert np.allclose(task.value(state) * robot.effort_limit[columns], state.gravity_force()[columns])
        state.loads = ((frame, 3.0, np.array([0.1, -0.05, 0.2])),)
        heavy = twin.state(q).gravity_force()[columns]
        assert np.allclose(task.value(state) * robot.effort_limit[columns], heavy)


def test_bad_input() -> None:
    for share in (0.0, 1.5, "much", math.nan):
        with pytest.raises(DeclarationError, match="holding"):
            Torque(holding=share)  # type: ignore[arg-type]
    robot = hqp.robots.load("talos").copy()
    robot.effort_limit = np.full(robot.nv, np.inf)
    with pytest.raises(DeclarationError, match="limit of their own motor"):
        t.HoldingTorque().rows(robot)
