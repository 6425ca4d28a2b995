"""Bounds of joint limits are relative to the velocity that contacts allow: joints do not brake against contacts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.robots
from hqp import PD, Level, Stack
from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from hqp.tasks import FixedContact, JointLimits, Posture
from hqp.torque.program import TorqueProgram

DT = 0.002
POSTURE = Posture(name="posture")
FEET = FixedContact(frame="l_sole", name="left"), FixedContact(frame="r_sole", name="right", when="both")


class Readable(JointLimits):
    """JointLimits without its native operation."""

    def step_bounds(self, state: State, dt: float, order: int) -> tuple[Vec, Vec]:
        return super().step_bounds(state, dt, order)


def stack(limits: JointLimits, *more: hqp.Element) -> Stack:
    return Stack(Level(POSTURE, when=("both", "one")), subject_to=[*FEET, *more, limits])


def states(robot: Any, count: int = 5) -> Iterator[State]:
    rng = np.random.default_rng(3)
    for _ in range(count):
        q = robot.integrate(robot.home, rng.uniform(-0.2, 0.2, robot.nv), 1.0)
        yield robot.state(q, rng.normal(size=robot.nv))


def bounds(program: TorqueProgram) -> Mat:
    """Bounds on the acceleration of the joints ``(2, k)``."""
    return np.array(program.assembly.bounds[:, program.assembly.members["limits"].part])


def asked(limits: JointLimits, state: State, kd: float, rate: Vec, feet: tuple[FixedContact, ...]) -> Mat:
    """Bounds by the docstring of JointLimits, with dense inverses."""
    J = np.vstack([state.jacobian(foot.frame) for foot in feet])
    inverse = np.linalg.inv(state.mass_matrix())
    Jbar = inverse @ J.T @ np.linalg.inv(J @ inverse @ J.T)
    off = J @ state.v
    off[:6] -= rate
    w = Jbar @ (min(1.0, kd / (limits.approach or math.inf)) * off)
    box = np.array(limits.bounds_around(state, state.v - w, DT, 2))
    return limits.weight * (box - kd * w[limits.selection(state.robot)])


@pytest.mark.parametrize("way", [JointLimits, Readable])
@pytest.mark.parametrize("kd", [0.0, 8.0, 40.0])
def test_bounds_are_those_of_the_equation(way: type[JointLimits], kd: float) -> None:
    """A left sole with a reference velocity, both feet and one, weights, and joint limits without an approach rate."""
    robot, rate = hqp.robots.load("cbi"), np.array([0.1, 0.0, -0.2, 0.0, 0.3, 0.0])
    for approach in (20.0, 0.0):
        limits = way(name="limits", weight=2.0, acceleration=300.0, approach=approach)
        program: Any = hqp.Torque(contact_law=PD(0.0, kd)).compile(stack(limits), robot, DT)
        for state in states(robot):
            given = Reference("left", FEET[0].value(state), velocity=rate)
            references = {"left": given, "right": Reference("right", FEET[1].value(state))}
            references |= {"posture": Reference("posture", robot.home[7:]), "limits": Reference("limits")}
            for feet in (FEET, FEET[:1]):
                program.go_without(frozenset() if feet == FEET else frozenset({"right"}))
                program.prepare(state)
                program.fill(state, references, (given,))
                np.testing.assert_allclose(bounds(program), asked(limits, state, kd, rate, feet), rtol=1e-9, atol=1e-7)


@pytest.mark.long
@pytest.mark.skipif(not kernel(), reason="no native kernel here")
def test_native_ticks_and_files_have_the_same_bounds() -> None:
    """With and without a foot, and with a foot declared twice."""
    robot = hqp.robots.load("cbi")
    limits, again = JointLimits(name="limits", acceleration=300.0), FixedContact(frame="l_sole", name="again")
    formulation = hqp.Torque(contact_law=PD(0.0, 40.0))
    for more in ((), (again,)):
        session: Any = hqp.Controller(stack(limits, *more), formulation, deadline=np.inf).session(robot.copy(), DT)
        file = LoadedSession(text(session))
        for i, state in enumerate(states(session.robot)):
            phase = ("both", "one")[i % 2]
            tick, found = session.step(state, phase=phase), file.step(state.q, state.v, phase=phase)
            feet = FEET if phase == "both" else FEET[:1]
            np.testing.assert_allclose(
                bounds(session.program), asked(limits, state, 40.0, np.zeros(6), feet), atol=1e-6
            )
            np.testing.assert_allclose(found.command, tick.command, rtol=1e-9, atol=1e-9)


class Broken(FixedContact):
    """Contact without a Jacobian in every second tick."""

    def jacobian(self, state: State) -> Mat:
        return super().jacobian(state) * (math.nan if state.q[0] > 0.0 else 1.0)


@pytest.mark.parametrize("way", [JointLimits, Readable])
def test_beside_a_contact_that_is_left_out_limits_stand(way: type[JointLimits]) -> None:
    robot = hqp.robots.load("cbi")
    held = [FEET[0], Broken(frame="r_sole", name="right"), way(name="limits")]
    whole = Stack(Level(POSTURE), subject_to=held)
    session: Any = hqp.Controller(whole, hqp.Torque(contact_law=PD(0.0, 40.0)), deadline=np.inf).session(robot, DT)
    for state in states(robot):
        tick = session.step(state)
        assert (tick.status.name == "INVALID_ELEMENT") == (state.q[0] > 0.0)
        lower, upper = bounds(session.program)
        assert (lower <= upper).all()
        assert np.isfinite(tick.command).all()
