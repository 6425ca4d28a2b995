"""Joints of several axes: postures along the shortest rotation, ball limits as cones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import PD, Level, P, Stack
from hqp.errors import DeclarationError
from hqp.robots import Robot
from hqp.tasks import BallLimits, Damping, JointLimits, Manipulability, Momentum, Position, Posture
from hqp.tasks.limits import ACCELERATION

MOST = 0.6
"""Limit of the ball [rad]."""


@pytest.fixture
def robot() -> Any:
    """A planar base, a ball joint on it, and a hinge on the ball."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "base")
    ball = model.addJoint(base, pin.JointModelSpherical(), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5])), "ball")
    hinge = model.addJoint(ball, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.3])), "hinge")
    for joint in (base, ball, hinge):
        at = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2]))
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), at)
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.4]))
    model.addFrame(pin.Frame("tip", hinge, 0, tip, pin.FrameType.OP_FRAME))
    robot = Robot(model, name="stem")
    robot.cones["ball"] = MOST
    return robot


def turn(robot: Any, q: Any) -> float:
    """Angle of the ball [rad]."""
    return float(np.linalg.norm(robot.state(q).angles[robot.joints("ball")]))


@pytest.mark.parametrize(
    "element",
    [
        Posture(),
        Posture(joints="ball"),
        Posture(joints=("hinge", "base")),
        BallLimits(),
        Manipulability(frame="tip"),
        Momentum(),
        Damping(kinetic_energy=True),
    ],
)
def test_derivatives(robot: Any, element: Any) -> None:
    found = hqp.check(element, robot)
    assert not found.faults, str(found)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("element", [Manipulability(frame="tip"), Momentum(), Damping(kinetic_energy=True)])
def test_native_rows_equal_readable_rows(robot: Any, element: Any, order: int, written: Any) -> None:
    rng = np.random.default_rng(2)
    for _ in range(5):
        q = robot.integrate(robot.home, rng.uniform(-1.0, 1.0, robot.nv), 1.0)
        state = robot.state(q, rng.normal(size=robot.nv))
        native, readable = (written(element, state, element.hold(state), order, native=way) for way in (True, False))
        np.testing.assert_allclose(native.J, readable.J, atol=1e-9)
        np.testing.assert_allclose(native.lower, readable.lower, atol=1e-8)


def test_configuration_is_the_inverse_of_angles(robot: Any) -> None:
    angles = np.array([0.3, -0.2, 1.0, 0.4, -0.3, 0.2, 0.7])
    np.testing.assert_allclose(robot.state(robot.configuration(angles)).angles, angles, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(("formulation", "law"), [(hqp.Velocity(), P(1.0)), (hqp.Acceleration(), PD(4.0, 4.0))])
def test_from_outside_its_cone_a_ball_comes_back_gradually(robot: Any, formulation: Any, law: Any) -> None:
    """The return velocity is reached at the acceleration limit of the JointLimits' box."""
    posture = Posture(law=law)
    stack = Stack(Level(posture), subject_to=[JointLimits()])
    session = hqp.Controller(stack, formulation, deadline=math.inf).session(robot, dt=0.002)
    angles = np.zeros(robot.nv)
    angles[3:6] = 0.7, 0.6, -0.3
    q, v, last = robot.configuration(angles), np.zeros(robot.nv), np.zeros(robot.nv)
    for _ in range(800):
        tick = session.step(robot.state(q, v), posture.at(angles))
        assert tick.status == hqp.Status.OPTIMAL
        q, v = tick.advance()
        assert np.linalg.norm(v - last) <= ACCELERATION * 0.002 * (1.0 + 1e-9)
        last = v
    assert turn(robot, q) < MOST + 1e-3


@pytest.mark.long
def test_a_posture_takes_a_ball_the_shortest_way(robot: Any) -> None:
    """From 3 rad about x to 3 rad about -x it is 0.28 rad; the turn keeps one axis and slows down as exp(-gain t)."""
    posture = Posture(law=P(2.0), joints="ball")
    session = hqp.Controller(Stack(Level(posture)), price=0.0).session(robot, dt=0.001)
    angles = np.zeros(robot.nv)
    angles[3] = 3.0
    q, goal = robot.configuration(angles), posture.at([-3.0, 0.0, 0.0])
    left = [np.linalg.norm(posture.error(robot.state(q), goal.value))]
    assert left[0] == pytest.approx(2.0 * math.pi - 6.0)
    for _ in range(1000):
        q, v = session.step(robot.state(q), goal).advance()
        assert np.abs(v[4:6]).max() < 1e-9
        left.append(np.linalg.norm(posture.error(robot.state(q), goal.value)))
    assert left[-1] == pytest.approx(left[0] * math.exp(-2.0), rel=5e-3)


@pytest.mark.long
@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=lambda f: f.__class__.__name__)
@pytest.mark.parametrize("direction", [pytest.param((1.0, 0.0), marks=pytest.mark.slow), (0.6, 0.8), (-0.7, 0.7)])
def test_a_ball_stops_at_its_cone_whatever_the_direction(robot: Any, formulation: Any, direction: Any) -> None:
    law = P(5.0, max_velocity=1.0) if formulation.order == 1 else PD(100.0, 20.0)
    posture = Posture(law=law)
    stack = Stack(Level(posture), subject_to=[JointLimits()])
    session = hqp.Controller(stack, formulation, deadline=math.inf).session(robot, dt=0.002)
    assert "ball_limits" in session.stack
    goal = np.zeros(robot.nv)
    goal[3:5] = 1.2 * np.array(direction)
    q, v, most = robot.home, np.zeros(robot.nv), 0.0
    for _ in range(800):
        q, v = session.step(robot.state(q, v), posture.at(goal)).advance()
        most = max(most, turn(robot, q))
    assert most < MOST + 1e-4
    assert turn(robot, q) == pytest.approx(MOST, abs=1e-3)
    np.testing.assert_allclose(robot.state(q).angles[3:5], MOST * np.array(direction) / np.hypot(*direction), atol=5e-3)


@pytest.mark.slow
def test_along_the_cone_it_moves_freely_and_from_outside_it_returns(robot: Any) -> None:
    tip = Position(frame="tip", law=P(3.0), axes="xy")
    stack = Stack(Level(tip), subject_to=[JointLimits(joints=("ball", "hinge", "base"))])
    session = hqp.Controller(stack, deadline=math.inf).session(robot, dt=0.002)
    angles = np.zeros(robot.nv)
    angles[3] = 1.0
    q, v = robot.configuration(angles), np.zeros(robot.nv)
    turns, goal = [turn(robot, q)], tip.at(robot.state(robot.home).position("tip")[:2])
    for _ in range(1000):
        q, v = session.step(robot.state(q, v), goal).advance()
        turns.append(turn(robot, q))
    assert turns[-1] < MOST + 1e-3
    assert np.max(-np.diff(turns)) / 0.002 < 2.0  # pulled back at 0.5 rad/s at least, no jump
    ring = np.zeros(robot.nv)
    posture = Posture(law=P(5.0), joints="ball")
    session = hqp.Controller(Stack(Level(posture), subject_to=[JointLimits()]), deadline=math.inf).session(robot, 0.002)
    ring[3] = MOST
    q, v = robot.configuration(ring), np.zeros(robot.nv)
    for k in range(1500):  # around the rim, although a box on the coordinates would block it
        w = 0.002 * k
        q, v = session.step(robot.state(q, v), posture.at([MOST * math.cos(w), MOST * math.sin(w), 0.0])).advance()
    where = robot.state(q).angles[3:6]
    np.testing.assert_allclose(where, [MOST * math.cos(w), MOST * math.sin(w), 0.0], atol=0.15)
    assert np.linalg.norm(where) < MOST + 1e-3


def test_bad_input(robot: Any) -> None:
    for bad in (BallLimits(joints="hinge"), BallLimits(margin=1.0)):
        with pytest.raises(DeclarationError, match="ball joints with a limit"):
            bad.rows(robot)
    with pytest.raises(DeclarationError, match="return_velocity"):
        BallLimits(return_velocity=0.0)
    own = Stack(Level(Posture()), subject_to=[JointLimits(), BallLimits(margin=0.1)])
    session = hqp.Controller(own).session(robot, dt=0.01)
    assert len(session.stack.subject_to) == 2
