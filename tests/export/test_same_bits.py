"""A session from a file reproduces the numbers of its writer to the last bit, and its notes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, Stack, Status
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import Lexicographic, kernel
from tests.scenes.stacks import FORMULATIONS, ROBOTS, Given, scene

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")


def replay(
    session: hqp.Session, given: Given, ticks: int, look: Callable[[hqp.Tick], object] = lambda tick: None
) -> None:
    """Both get the same states; hold values come from Pinocchio on one side, so they are copied."""
    file = LoadedSession(text(session))
    robot = session.robot
    q, v = robot.home.copy(), np.zeros(robot.nv)
    for i in range(ticks):
        references = given(i)
        tick = session.step(robot.state(q, v), *references)
        if i == 0:
            for name, value in session.hold_values.items():
                if name in file.names:
                    file.hold(name, value)
        found = file.step(q, v, {r.name: target(r) for r in references})
        assert found.status is tick.status, f"tick {i}"
        look(tick)
        np.testing.assert_array_equal(found.x, tick.x, err_msg=f"tick {i}")
        np.testing.assert_array_equal(found.command, tick.command)
        assert found.notes == tuple(note for note in tick.notes if not note.detail.startswith("requested ")), (
            f"tick {i}"
        )
        q, v = tick.advance()


def target(reference: hqp.Reference) -> Any:
    """Value, velocity and acceleration, if given."""
    return tuple(x for x in (reference.value, reference.velocity, reference.acceleration) if x is not None)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_file_gives_the_same_bits(robot: str, formulation: str) -> None:
    replay(*scene(robot, formulation), ticks=160)


def test_exact_levels_too() -> None:
    replay(*scene("g1", price=0), ticks=120)


@pytest.mark.parametrize("robot", ROBOTS)
def test_hold_values_are_those_of_python(robot: str) -> None:
    session, _ = scene(robot)
    twin = session.robot
    q = twin.integrate(twin.home, np.random.default_rng(1).uniform(-0.2, 0.2, twin.nv), 1.0)
    file = LoadedSession(text(session))
    tick, found = session.step(twin.state(q)), file.step(q)
    np.testing.assert_allclose(found.x, tick.x, atol=1e-9)
    for name, value in session.hold_values.items():
        if name in file.names:
            np.testing.assert_allclose(file.held(name), np.ravel(value), atol=1e-12, err_msg=name)


@pytest.mark.parametrize(("formulation", "most"), [("velocity", 12), ("acceleration", 8), ("torque", 8)])
def test_answers_that_were_cut_too(formulation: str, most: int) -> None:
    robot = hqp.robots.load("g1")
    feet = [t.FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    hand = t.Position(frame="left_rubber_hand", name="hand")
    levels = Level(hand, price=0), Level(t.Posture(name="posture"), price=0)
    stack = Stack(*levels, subject_to=[t.JointLimits(), *feet])
    solver = Lexicographic(max_iterations=most)
    controller = hqp.Controller(stack, FORMULATIONS[formulation](), solver, deadline=np.inf)
    start, seen = robot.state(robot.home).position(hand.frame), set()

    def given(i: int) -> tuple[hqp.Reference, ...]:
        return (hand.at(start + np.array([float(i % 7 > 2), 0.0, 0.3])),)

    session = controller.session(robot, 0.002)
    replay(session, given, 60, lambda tick: seen.add(tick.status))
    assert seen == {Status.OPTIMAL, Status.ITERATION_LIMIT}


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_constraints_that_cannot_be_met_too(formulation: str) -> None:
    """One hand has an unreachable target; the other one, constrained, is too far away as well."""
    robot = hqp.robots.load("g1")
    feet = [t.FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    right, left = (t.Position(frame=palm) for palm in robot.landmarks["palms"])
    stack = Stack(Level(left), Level(t.Posture(name="posture")), subject_to=[t.JointLimits(), *feet, right])
    session = hqp.Controller(stack, FORMULATIONS[formulation](), deadline=np.inf).session(robot, 0.002)
    start, seen = {hand: robot.state(robot.home).position(hand.frame) for hand in (left, right)}, set()

    def given(i: int) -> tuple[hqp.Reference, ...]:
        return tuple(hand.at(at + np.array([float(i % 20 > 4), 0.0, 1.0])) for hand, at in start.items())

    replay(session, given, 60, lambda tick: seen.add(tick.status))
    assert Status.CONSTRAINTS_VIOLATED in seen


def test_contacts_that_depend_on_each_other_too() -> None:
    """A sole declared twice: both forces are those of least norm, and the motion is that of one sole."""
    robot = hqp.robots.load("g1")
    feet = [t.FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    again = t.FixedContact(frame=feet[0].frame, name="again")
    limits = [t.TorqueLimits(), *(t.FrictionCone(contact=foot.name, mu=0.7) for foot in feet)]
    posture = t.Posture(name="posture")
    levels = [Level(t.Com(axes="xy", name="com")), Level(posture)]

    def session(*held: hqp.Element) -> hqp.Session:
        stack = Stack(*levels, subject_to=[*held, *limits])
        return hqp.Controller(stack, FORMULATIONS["torque"](), deadline=np.inf).session(robot.copy(), 0.002)

    def given(i: int) -> tuple[hqp.Reference, ...]:
        return (posture.at(robot.home[7:] + 0.1 * np.sin(0.05 * i + np.arange(robot.nv - 6))),)

    once, commands = session(*feet), []
    replay(session(*feet, again), given, 60, lambda tick: commands.append((tick.state.q, tick.state.v, tick.command)))
    for i, (q, v, command) in enumerate(commands):
        np.testing.assert_allclose(once.step(once.robot.state(q, v), *given(i)).command, command, atol=1e-6)
