"""Bounds that move with a given velocity: their rate is exact, and they are kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, Stack
from hqp.arrays import Vec
from hqp.declare.reference import Reference

DT, FRAME, RATE, SWING = 0.002, "panda_hand", 2.0, 0.2
FORMULATIONS = {"velocity": hqp.Velocity(), "acceleration": hqp.Acceleration(), "torque": hqp.Torque()}
AXIS = (0.0, 0.0, 1.0)
BOUNDED = {
    "box": t.Within(t.Position(frame=FRAME), lower=-0.02, upper=0.02, name="b"),
    "turn": t.Within(t.Orientation(frame=FRAME), lower=-0.05, upper=0.05, name="b"),
    "pose": t.Within(t.Pose(frame=FRAME), lower=-0.05, upper=0.05, name="b"),
    "cone": t.Cone(t.AlignAxis(frame=FRAME, axis=AXIS), angle=0.1, name="b"),
    "gaze": t.Cone(t.LookAt(frame=FRAME, axis=AXIS), angle=0.1, name="b"),
}


@pytest.fixture(scope="module")
def panda() -> Any:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return hqp.robots.load("panda")


def moving(what: str, home: Any, told: bool = True) -> Callable[[float], Reference]:
    """The reference over time: it oscillates by 0.2 m or rad, a box by a quarter of that."""
    p, R = home.position(FRAME).copy(), home.rotation(FRAME).copy()
    u = R @ AXIS
    side = np.cross(u, [0.0, 1.0, 0.0])
    axis = np.array([0.6, 0.0, 0.8])

    def at(time: float) -> Reference:
        a, a1 = SWING * math.sin(RATE * time), SWING * RATE * math.cos(RATE * time)
        a2 = -RATE * RATE * a
        bounded: Any = BOUNDED[what]
        turned, y = pin.exp3(axis * a) @ R, np.array([0.0, 0.25, 0.0])
        w = math.cos(a) * u + math.sin(a) * side
        w1 = math.cos(a) * side - math.sin(a) * u
        value, velocity, acceleration = {
            "box": (p + a * y, a1 * y, a2 * y),
            "turn": (turned, a1 * axis, a2 * axis),
            "pose": ((p + a * y, turned), np.r_[a1 * y, a1 * axis], np.r_[a2 * y, a2 * axis]),
            "cone": (w, a1 * w1, a2 * w1 - a1 * a1 * w),
            "gaze": (p + 0.6 * u + a * side, a1 * side, a2 * side),
        }[what]
        rates: dict[str, Any] = {"velocity": velocity, "acceleration": acceleration} if told else {}
        reference: Reference = bounded.at(value, **rates)
        return reference

    return at


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize("what", BOUNDED)
def test_rate_and_drift_are_those_of_the_way_left(panda: Any, what: str, far: bool) -> None:
    """Compare with differences along a motion of robot and reference, inside and well outside."""
    bounded: Any = BOUNDED[what]
    rng = np.random.default_rng(5)
    reference, v = moving(what, panda.state()), rng.normal(size=panda.nv)
    start = panda.integrate(panda.home, rng.normal(size=panda.nv), 0.4) if far else panda.home

    def value(time: float) -> Vec:
        state = panda.state(panda.integrate(start, v, time), v)
        return -np.atleast_1d(bounded.bounds(state, reference(time).value)[0]).copy()

    now = reference(0.3)
    state = panda.state(panda.integrate(start, v, 0.3), v)
    u, a = bounded.carried(state, now.velocity, now.acceleration, now.value)
    first = bounded.jacobian(state, now.value) @ v - u
    second = bounded.drift(state, now.value) - a
    h = 1e-4
    before, here, after = value(0.3 - h), value(0.3), value(0.3 + h)
    assert np.allclose((after - before) / (2 * h), first, atol=1e-5 * (1.0 + np.abs(first).max()))
    assert np.allclose((after - 2 * here + before) / h**2, second, atol=1e-4 * (1.0 + np.abs(second).max()))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["velocity", pytest.param("acceleration", marks=pytest.mark.slow), "torque"])
@pytest.mark.parametrize("what", ["box", "turn", "cone", "gaze"])
def test_they_are_not_passed(panda: Any, what: str, kind: str) -> None:
    """The bounds carry the hand along; without their velocity it passes them by more than 10 mm or 40 mrad."""
    worst = {}
    for told in (False, True):
        bounded: Any = BOUNDED[what]
        reference = moving(what, panda.state(), told)
        stack = Stack(Level(t.Posture()), subject_to=[t.JointLimits(), bounded])
        session = hqp.Controller(stack, FORMULATIONS[kind], deadline=math.inf).session(panda, DT)
        q, v, passed, commands = panda.home, np.zeros(panda.nv), [], []
        for k in range(1200):
            tick = session.step(panda.state(q, v), reference(k * DT))
            assert tick.status == hqp.Status.OPTIMAL
            q, v = tick.advance()
            lower, upper = bounded.bounds(panda.state(q), reference((k + 1) * DT).value)
            passed.append(max(np.max(lower), -np.min(upper)))
            commands.append(tick.command)
        worst[told] = max(passed[300:])
        jump = np.abs(np.diff(commands[300:], axis=0)).max()
        assert jump < {"velocity": 0.02, "acceleration": 1.0, "torque": 1.0}[kind]  # rad/s, rad/s2, N m
    assert worst[False] > (0.008 if what == "box" else 0.03)
    assert worst[True] < 3e-4


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize("what", [*BOUNDED, "ball"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_velocity_that_is_no_number_is_told(panda: Any, what: str, kind: str, bad: float) -> None:
    """Ignore the reference with a note; a ball of the world moves as well."""
    bounded: Any = BOUNDED.get(what)
    if bounded is None:
        ball = hqp.shapes.sphere("ball", 0.05, tuple((panda.state().position(FRAME) + [0.15, 0.0, 0.0]).tolist()))
        bounded = t.CollisionAvoidance(pairs="world", world=ball, name="b")
        told = bounded.at({"ball": ball.position}, {"ball": [bad, 0.0, 0.0]})
    else:
        given = moving(what, panda.state(), False)(0.0).value
        value = given[0] if isinstance(bounded, t.Cone) else given
        told = bounded.at(value, velocity=np.full(6 if what == "pose" else 3, bad))
    session = hqp.Controller(Stack(Level(t.Posture()), subject_to=[bounded]), FORMULATIONS[kind]).session(panda, DT)
    session.step(panda.state())
    tick = session.step(panda.state(), told)
    assert tick.status in (hqp.Status.INVALID_REFERENCE, hqp.Status.INVALID_ELEMENT)
    assert np.isfinite(tick.command).all()
