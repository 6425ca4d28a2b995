"""Elements switched off for a tick: the stack without them, one plan, fresh hold values on return."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
import hqp.robots
import hqp.tasks as t
from hqp import Level, Stack, Status, serial
from hqp.arrays import Vec
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, UnknownReference
from hqp.loop.session import Session
from tests.counting import calls
from tests.loop.readable_tick import ReadableSession

STEP = 1e-6
"""Displacement of the robot by hand in a tick [rad, m]: fast contacts cannot be kept."""

SOLES = {"left": "l_sole", "right": "r_sole"}
RECTANGLES = {"left": (-0.065, 0.18, -0.04, 0.06), "right": (-0.065, 0.18, -0.06, 0.04)}
CONTACTS = {name: t.FixedContact(frame=frame, name=name) for name, frame in SOLES.items()}
SWING = t.Pose(frame="l_sole", name="swing")
HAND = t.Position(frame="r_palm", name="hand")
FORMULATIONS = {"velocity": hqp.Velocity(), "acceleration": hqp.Acceleration(), "torque": hqp.Torque(holding=None)}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return hqp.robots.load("cbi")


def standing(kind: str, *without: str, when: bool = False) -> Stack:
    """Feet, balance, a foot and a hand in the air, posture."""
    contacts = [CONTACTS[name] for name in SOLES if name not in without]
    within: list[Any] = list(contacts)
    levels = [Level(t.Com(axes="xyz", name="com"))]
    if kind == "torque":
        within.append(t.TorqueLimits())
        for contact in contacts:
            within.append(t.FrictionCone(contact=contact.name, mu=0.6))
            within.append(t.CenterOfPressure(contact=contact.name, rectangle=RECTANGLES[contact.name]))
        levels = [Level(t.Balance(margin=0.005, name="com"), t.Com(axes="z", name="height"))]
    else:
        within.append(t.JointLimits())
    levels.append(Level(SWING, name="swing", when="step" if when else ()))
    levels += [Level(HAND, name="hand"), Level(t.Posture(name="posture"))]
    if kind == "torque" and len(contacts) == 2:
        levels.append(Level(t.LoadShare(contacts=("left", "right"), name="share"), price=0))
    stack = Stack(*levels, subject_to=within)
    gone = [name for name in without if name in stack]
    return stack.without(*gone) if gone else stack


def begin(stack: Stack, kind: str, robot: Robot, **options: Any) -> Session:
    return hqp.Controller(stack, FORMULATIONS[kind], deadline=np.inf, **options).session(robot, 0.002)


def driven(session: Session, robot: Robot, ticks: int, *off: str) -> tuple[Vec, list[hqp.Tick]]:
    """x of every tick while the hand follows a moving target."""
    q, v, found, given = robot.home, np.zeros(robot.nv), [], []
    goal = robot.state(robot.home).position("r_palm") + [0.1, -0.05, 0.1]
    for _ in range(ticks):
        references = [e.off() for e in session.stack if e.name in off]
        references += [HAND.at(goal)] if "hand" in session.stack else []
        tick = session.step(robot.state(q, v), *references)
        assert tick.status is Status.OPTIMAL, tick.notes
        found.append(tick.x.copy())
        given.append(tick)
        q, v = tick.advance()
    return np.array(found), given


@pytest.mark.parametrize("price", [None, 0])
@pytest.mark.parametrize("kind", FORMULATIONS)
def test_off_is_the_stack_without(kind: str, price: Any, robot: Robot) -> None:
    """With a contact and tasks off, the solution is that of a stack without them."""
    out = ("left", "hand")
    found, _ = driven(begin(standing(kind), kind, robot, price=price), robot, 12, *out)
    bare, _ = driven(begin(standing(kind, *out), kind, robot, price=price), robot, 12)
    np.testing.assert_allclose(found, bare, atol=1e-9 * np.abs(bare).max())


def test_rows_in_python_say_the_same(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without native operations rows come from the elements' readable functions."""
    out = ("left", "hand")
    native, ticks = driven(begin(standing("torque"), "torque", robot, price=0), robot, 3, *out)
    monkeypatch.setattr("hqp.programs.assembly.native", None)
    controller = hqp.Controller(standing("torque"), FORMULATIONS["torque"], deadline=np.inf, price=0)
    readable = ReadableSession(controller, robot, 0.002)
    goal = robot.state(robot.home).position("r_palm") + [0.1, -0.05, 0.1]
    for tick, x in zip(ticks, native, strict=True):
        off = [e.off() for e in controller.stack if e.name in out]
        found = readable.step(tick.state.q, tick.state.v, *off, HAND.at(goal))
        np.testing.assert_allclose(found.x, x, atol=1e-7 * np.abs(native).max())


def test_a_contact_that_is_out_bears_nothing_and_takes_what_is_asked_of_its_force_along(robot: Robot) -> None:
    session = begin(standing("torque"), "torque", robot)
    for _ in range(3):
        tick = session.step(robot.state(robot.home), CONTACTS["left"].off())
    forces = session.program.contact_forces(tick.x)  # type: ignore[attr-defined]
    assert not forces["left"].any()
    assert forces["right"][2] == pytest.approx(robot.mass * 9.81, rel=0.3)
    told = tick.explain()
    assert {a.element for a in told.accounts if a.cause == "off"} == {"left_friction", "left_cop", "share"}
    assert told.certificate.ok
    assert "off" in str(told)
    assert hqp.certificate(session.problem, tick.x, stages=tick.solution.stage_points).ok  # type: ignore[union-attr]


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_what_comes_back_takes_fresh_hold_values(kind: str, robot: Robot) -> None:
    """No other element takes a new one; nothing is compiled."""
    session = begin(standing(kind), kind, robot)
    program, q = session.program, robot.home
    for k in range(12):
        out = 4 <= k < 8
        q = robot.integrate(q, STEP * np.ones(robot.nv), 1.0)
        tick = session.step(robot.state(q), SWING.off(), *([CONTACTS["left"].off(), HAND.off()] if out else []))
        assert session.program is program
        assert tick.status is Status.OPTIMAL
        if k in (3, 7):
            before = session.hold_values
    after, here = session.hold_values, robot.state(robot.integrate(robot.home, STEP * np.ones(robot.nv), 9.0))
    for name, element in (("left", CONTACTS["left"]), ("hand", HAND)):
        assert np.abs(after[name] - before[name]).max() > STEP
        np.testing.assert_allclose(after[name], element.value(here), atol=1e-9)
    for name in ("right", "posture"):
        np.testing.assert_array_equal(after[name], before[name])


def test_a_set_of_elements_that_was_seen_goes_on_where_it_ended() -> None:
    """Warm-start the solver each time Talos' foot leaves or returns."""
    talos = hqp.robots.load("talos")
    feet = [t.FixedContact(frame=frame, name=name) for name, frame in zip(SOLES, talos.landmarks["soles"], strict=True)]
    within: list[Any] = [*feet, t.TorqueLimits(), t.JointLimits()]
    for foot in feet:
        within.append(t.FrictionCone(contact=foot.name, mu=0.6))
        within.append(t.CenterOfPressure(contact=foot.name, rectangle=(-0.09, 0.09, -0.05, 0.05)))
    balance, share = t.Balance(margin=0.005), t.LoadShare(contacts=tuple(SOLES))
    swing = t.Pose(frame=feet[1].frame, name="swing")
    levels = [Level(balance, t.Com(axes="z", name="height")), Level(swing), Level(t.Posture()), Level(share, price=0)]
    session = begin(Stack(*levels, subject_to=within), "torque", talos)
    over, effort = talos.state().position(feet[0].frame)[:2], []
    for k in range(60):
        tick = session.step(
            talos.state(), balance.at(over, over), share.at(0.0), (feet[1] if (k // 10) % 2 else swing).off()
        )
        assert tick.solution is not None
        effort.append(tick.solution.stats.iterations)
    assert effort[0] > 10
    assert max(effort[20::10]) <= 3


def test_phases_put_levels_and_elements_in_and_out(robot: Robot) -> None:
    """Switch a level with ``when`` and a contact by phase; a reference overrides the phase for a tick."""
    feet = {"left": t.FixedContact(frame="l_sole", name="left", when="both")}
    stack = standing("torque", when=True).replace(*feet.values())
    session = begin(stack, "torque", robot)
    assert stack.phases() == ("step", "both")
    state = robot.state(robot.home)
    tick = session.step(state, phase="both")
    assert (tick.phase, session.program.out) == ("both", {"swing"})
    gone = {"left", "left_friction", "left_cop", "share"}
    tick = session.step(state, phase="step")
    assert (tick.phase, session.program.out) == ("step", gone)
    session.step(state, SWING.off(), phase="step")
    assert session.program.out == gone | {"swing"}
    session.step(state, feet["left"].on(), phase="step")
    assert session.program.out == set()
    session.step(state)
    assert session.program.out == gone | {"swing"}
    with pytest.raises(DeclarationError, match=r"unknown phase.*'swim'.*both"):
        session.step(state, phase="swim")
    assert serial.loads(serial.dumps(stack)) == stack


def test_what_nothing_would_hold_is_refused(robot: Robot) -> None:
    """A declaration raises; a tick gets a note and keeps the contacts."""
    feet = [t.FixedContact(frame=frame, name=name, when="stand") for name, frame in SOLES.items()]
    stack = Stack(Level(t.Posture(), when="fly"), Level(t.Com(name="com")), subject_to=feet)
    with pytest.raises(DeclarationError, match="phase fly: without left, right constraints and actuators do not"):
        begin(stack, "torque", robot)
    session = begin(standing("torque"), "torque", robot)
    for _ in range(3):
        tick = session.step(robot.state(robot.home), *(contact.off() for contact in CONTACTS.values()))
        assert tick.status is Status.INVALID_REFERENCE
        assert [note.element for note in tick.notes] == ["left", "right"]
        assert session.program.out == set()
    assert session.step(robot.state(robot.home)).status is Status.OPTIMAL


def test_names_that_are_not_there_are_refused(robot: Robot) -> None:
    session = begin(standing("torque"), "torque", robot)
    for _ in range(2):
        with pytest.raises(UnknownReference, match="r_food"):
            session.step(robot.state(robot.home), hqp.Reference("r_food", on=False))
        session.step(robot.state(robot.home))
    with pytest.raises(DeclarationError, match="bad when"):
        Level(HAND, when=3)  # type: ignore[arg-type]
    payload = t.Payload(frame="r_palm", mass=1.0, name="box")
    stack = Stack(*standing("torque").levels, subject_to=[*standing("torque").subject_to, payload])
    with pytest.raises(DeclarationError, match="a load has no rows"):
        begin(stack, "torque", robot).step(robot.state(robot.home), payload.off())


def test_a_contact_that_is_out_is_not_missed(robot: Robot) -> None:
    """Ignore its measured load until it returns."""
    session, left = begin(standing("torque"), "torque", robot), CONTACTS["left"]
    for _ in range(30):
        tick = session.step(robot.state(robot.home), left.off().loaded(0.0))
        assert tick.status is Status.OPTIMAL
    statuses = [session.step(robot.state(robot.home), left.at().loaded(0.0)).status for _ in range(15)]
    assert statuses[-1] is Status.CONTACT_LOST
    assert statuses[0] is Status.OPTIMAL


def test_support_is_that_of_the_contacts_that_are_in(robot: Robot) -> None:
    """Natively and by the readable functions: one foot's hull while the other foot is off."""
    stack = Stack(
        Level(t.SupportPolygon(sole=(-0.05, 0.1, -0.03, 0.03), name="support")),
        Level(t.Posture()),
        subject_to=list(CONTACTS.values()),
    )
    session = begin(stack, "acceleration", robot)
    for out in ((), ("left",), (), ("right",)):
        tick = session.step(robot.state(robot.home), *(CONTACTS[name].off() for name in out))
        place = session.program.places["support"]
        rows = session.problem.levels[place.level]
        state = robot.state(robot.home)
        state.out = frozenset(out)
        element: Any = session.stack.find("support")
        _, upper = element.bounds(state)
        np.testing.assert_array_equal(np.isfinite(rows.upper[place.part]), np.isfinite(upper))
        np.testing.assert_allclose(rows.dense(robot.nv)[place.part], element.jacobian(state), atol=1e-9)
        assert np.isfinite(upper).reshape(2, 4).all(axis=1).tolist() == [
            bool(out) and name not in out for name in SOLES
        ]
        assert tick.status is not Status.INVALID_ELEMENT


def test_references_of_what_is_out_say_nothing(robot: Robot) -> None:
    """Ignore them, even if they are NaN."""
    session = begin(standing("velocity"), "velocity", robot)
    swing = hqp.Reference("swing", np.full((4, 4), np.nan), on=False)
    for _ in range(4):
        tick = session.step(robot.state(robot.home), swing)
        assert tick.status is Status.OPTIMAL


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_switch_in_native_ticks_calls_little(kind: str, robot: Robot) -> None:
    """A switch makes at most three times the Python and C calls of a plain tick; it made eight times as many."""
    session = begin(standing(kind, when=True), kind, robot)
    q, v = robot.home + STEP, np.zeros(robot.nv)

    def called(phase: str | None) -> int:
        return calls(lambda: session.step(state, phase=phase))

    for phase in (None, "step") * 3:
        for _ in range(3):
            session.step(robot.state(q, v), phase=phase)
    counts = []
    for phase in (None, None, None, "step", "step"):
        state = robot.state(q, v)
        counts.append(called(phase))
    assert max(counts[3] / counts[4], counts[0] / counts[1]) <= 3.0, counts


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_native_ticks_take_the_hold_values_of_what_comes_back(kind: str, robot: Robot) -> None:
    """Each task takes its ``hold`` value in the tick of its return."""
    stack = standing(kind)
    session = begin(stack, kind, robot)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    names = [e.name for e in stack.levels[-1 if kind != "torque" else -2]] + ["hand", "swing", "com"]
    out = [hqp.Reference(name, on=False) for name in names]
    for k in range(12):
        q = robot.integrate(q, 20 * STEP * np.cos(np.arange(robot.nv)), 1.0)
        state = robot.state(q, v)
        session.step(state, *(out if k % 4 else ()))
        if k % 4 == 0:
            held = session.hold_values
            for name in names if k else ():
                np.testing.assert_allclose(held[name], stack.find(name).hold(state).value, atol=1e-12, err_msg=name)
