"""Phases, elements switched off, and gravity compensation: a session from a file matches the one that wrote it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import PD, Level, P, Phase, Sequence, Stack
from hqp.errors import DeclarationError
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from tests.scenes.stacks import FORMULATIONS

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")
SOLES = {"left": "l_sole", "right": "r_sole"}
SOLE = (-0.065, 0.18, -0.04, 0.04)
HAND = t.Position(frame="r_palm", name="hand")


def stepping(kind: str) -> Stack:
    """Stack with a foot in the air in a phase, and a hand that works while both feet stand."""
    feet = [t.FixedContact(frame=sole, name=name) for name, sole in SOLES.items()]
    feet[0] = dataclasses.replace(feet[0], when="stand")
    within: list[hqp.Element] = list(feet)
    balance = [Level(t.Com(axes="xy", name="com"))]
    if kind == "torque":
        within.append(t.TorqueLimits())
        within += [t.FrictionCone(contact=name, mu=0.6) for name in SOLES]
        within += [t.CenterOfPressure(contact=name, rectangle=SOLE) for name in SOLES]
        within.append(t.UnilateralContact(contact="left", minimum=20.0))  # switched with it, else infeasible
        balance = [Level(t.Balance(margin=0.005, name="balance")), Level(t.Com(axes="z", name="height"))]
    else:
        within.append(t.JointLimits())
    levels = [Level(t.Pose(frame="l_sole", name="swing"), when="fly"), Level(HAND, when="stand")]
    share = [Level(t.LoadShare(contacts=("left", "right"), name="share"), price=0)] if kind == "torque" else []
    return Stack(*balance, *levels, Level(t.Posture(name="posture")), *share, subject_to=within)


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_phases_are_those_of_python(kind: str) -> None:
    robot = hqp.robots.load("cbi")
    session = hqp.Controller(stepping(kind), FORMULATIONS[kind](), deadline=np.inf).session(robot, 0.002)
    file = LoadedSession(text(session))
    q, v = robot.home.copy(), np.zeros(robot.nv)
    start, kept = robot.state(q).position(HAND.frame), {}
    for i in range(90):
        phase = ("stand", "fly", "stand")[i // 30]
        aim = HAND.at(start + 0.1 * np.sin(0.03 * i + np.arange(3)))
        tick = session.step(robot.state(q, v), aim, phase=phase)
        if i == 0:
            for name in set(session.hold_values) & set(file.names):
                kept[name] = np.ravel(session.hold_values[name])
                if name not in ("left", "hand", "swing"):  # elements that return take fresh ones
                    file.hold(name, kept[name])
        found = file.step(q, v, {"hand": aim.value}, phase=phase)
        assert found.status is tick.status, f"tick {i}: {tick.notes} {found.notes}"
        np.testing.assert_allclose(found.command, tick.command, rtol=1e-7, atol=1e-7, err_msg=f"tick {i}")
        if i == 60:
            assert np.abs(np.ravel(session.hold_values["left"]) - kept["left"]).max() > 0.0
            np.testing.assert_allclose(file.held("left"), np.ravel(session.hold_values["left"]), atol=1e-12)
        q, v = tick.advance()
    with pytest.raises(DeclarationError, match="no phase 'walk'; allowed: fly, stand"):
        file.step(q, v, phase="walk")


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_laws_of_phases_are_those_of_python(kind: str) -> None:
    """Equal to the last bit: change to a law, to another on the way, back, and at once for a returning element; then
    again."""
    laws: list[Any] = [P(0.5), P(4.0, max_velocity=0.02), P((9.0, 7.0, 8.0), max_acceleration=0.5)]
    if kind != "velocity":
        laws = [PD(10.0), PD(400.0, 30.0, max_velocity=0.02), PD((90.0, 70.0, 80.0), max_acceleration=0.5)]
    slow, held, uneven = laws
    steps = Sequence(
        Phase(name="stand", laws={"hand": uneven}),
        Phase(name="alone", laws={"posture": slow}),  # no element has this phase as its when
        Phase(name="alone again", laws={"posture": slow}),
        Phase(name="fly", laws={"swing": held, "posture": held}),
        Phase(name="fall"),
    )
    robot = hqp.robots.load("cbi")
    controller = hqp.Controller(stepping(kind), FORMULATIONS[kind](), deadline=np.inf)
    file = LoadedSession(text(controller.session(robot, 0.002), steps))
    start = robot.state(robot.home).position(HAND.frame)
    for fault, most in ((None, 0.0), (40, 1e-9)):  # fault: an invalid state, after which numbers differ by rounding
        run = steps.run(controller.session(robot, 0.002))
        q, v = robot.home.copy(), np.zeros(robot.nv)
        for i in range(100):
            run.go(("stand", "alone", "alone again", "fly", "fall", "stand", "alone")[i // 15])
            aim = HAND.at(start + 0.1 * np.sin(0.03 * i + np.arange(3)))
            given = q * np.nan if i == fault else q
            tick = run.step(robot.state(given, v), aim)
            for name in set(run.session.hold_values) & set(file.names):
                file.hold(name, np.ravel(run.session.hold_values[name]))
            found = file.step(given, v, {"hand": aim.value}, phase=tick.phase)
            assert found.status is tick.status, f"tick {i}: {tick.notes} {found.notes}"
            np.testing.assert_allclose(found.x, tick.x, rtol=most, atol=most, err_msg=f"tick {i}, {tick.phase}")
            if i != fault:
                q, v = tick.advance()
        file.reset()


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_an_element_is_in_or_out_for_a_tick(kind: str) -> None:
    robot = hqp.robots.load("cbi")
    session = hqp.Controller(stepping(kind), FORMULATIONS[kind](), deadline=np.inf).session(robot, 0.002)
    file = LoadedSession(text(session))
    q, v = robot.home.copy(), np.zeros(robot.nv)
    start = robot.state(q).position(HAND.frame)
    for i in range(40):
        aim = HAND.at(start + 0.1)
        inside = i % 10 < 5
        com = "height" if kind == "torque" else "com"
        references = [aim, hqp.Reference(com, on=inside)]
        tick = session.step(robot.state(q, v), *references, phase="stand")
        file.on(com, inside)
        found = file.step(q, v, {"hand": aim.value}, phase="stand")
        assert found.status is tick.status
        np.testing.assert_allclose(found.command, tick.command, rtol=1e-7, atol=1e-7, err_msg=f"tick {i}")
        q, v = tick.advance()
    if kind == "torque":
        with pytest.raises(DeclarationError, match="at torque level by phases"):
            file.on("left", False)


def test_gravity_compensation_with_a_payload() -> None:
    """The torque that holds the robot up, on the present feet, completes the levels."""
    robot = hqp.robots.load("cbi")
    left, right = (t.FixedContact(frame=sole, name=name) for name, sole in SOLES.items())
    loads = [
        t.Payload(frame="r_palm", mass=2.0, name="tool"),
        t.ExternalWrench(frame="l_palm", name="push"),
        t.ExternalWrench(frame="l_palm", resisted=False, name="pull"),
    ]
    stack = Stack(Level(HAND), subject_to=[dataclasses.replace(left, when="stand"), right, *loads])
    controller = hqp.Controller(stack, hqp.Torque(gravity_compensation=True), deadline=np.inf)
    session = controller.session(robot, 0.002)
    file = LoadedSession(text(session))
    q, v = robot.home.copy(), np.zeros(robot.nv)
    push = np.array([5.0, -3.0, 8.0, 0.1, 0.2, 0.3])
    for i in range(20):
        phase = "stand" if i < 10 else None
        wrenches = {"push": push, "pull": push[::-1].copy()}
        references = [hqp.Reference(name, wrench) for name, wrench in wrenches.items()]
        tick = session.step(robot.state(q, v), *references, phase=phase)
        found = file.step(q, v, wrenches, phase=phase)
        assert found.status is tick.status
        np.testing.assert_allclose(found.command, tick.command, rtol=1e-8, atol=1e-8, err_msg=f"tick {i}")
        q, v = tick.advance()
    plain = hqp.Controller(stack, hqp.Torque(), deadline=np.inf).session(robot, 0.002)
    assert np.abs(plain.step(robot.state(q, v)).command - found.command).max() > 1.0
