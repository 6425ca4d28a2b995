"""Laws of elements by phase: gains change over time, nothing is compiled, laws that do not fit are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
import hqp.robots
import hqp.tasks as t
from hqp import DCM, PD, Level, P, Phase, Sequence, Stack, Status, serial
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError
from hqp.loop.compiled import Compiler
from hqp.programs.assembly import Assembly

DT = 0.002
HAND = t.Position(frame="tool0", law=P(1.0), name="hand")
POSTURE = t.Posture(name="posture")
ARM = Stack(Level(HAND, price=0), Level(POSTURE))


@pytest.fixture(scope="module")
def arm() -> Robot:
    return hqp.robots.load("ur5")


def begin(robot: Robot, stack: Stack, formulation: Any, **laws: Any) -> Any:
    session = hqp.Controller(stack, formulation, deadline=np.inf).session(robot, DT)
    return Sequence(Phase(name="slow"), Phase(name="fast", laws=laws)).run(session)


def asked(robot: Robot, dt: float, *laws: Any) -> Any:
    """Demand of a unit error after dt with each law in turn after the first; with one law, its gain."""
    rows = Assembly([HAND], [], robot, dt, {"hand": laws[0]})
    for law in laws[1:]:
        rows.take_law("hand", law, at_once=False)
        rows.go_on()
    state = robot.state(robot.home)
    rows.fill(state, {"hand": HAND.at(state.position("tool0") + 1.0)}, ())
    return rows.upper


def test_a_law_goes_over_in_the_time_of_the_stiffer_one(arm: Robot) -> None:
    np.testing.assert_allclose(asked(arm, 0.05, P(2.0), P(10.0)), 6.0)
    np.testing.assert_allclose(asked(arm, 0.1, P(10.0), P(2.0)), 2.0)
    np.testing.assert_allclose(asked(arm, 0.05, P((0.0, 2.0, 3.0)), P((0.0, 10.0, 1.0))), [0.0, 6.0, 2.7])
    np.testing.assert_allclose(asked(arm, 0.025, PD(100.0), PD(400.0, 40.0)), 250.0)
    np.testing.assert_allclose(asked(arm, 0.05, PD(1.0, 10.0), PD(4.0, 20.0)), 2.5)


def test_a_law_that_changes_on_the_way_goes_on_from_there(arm: Robot) -> None:
    np.testing.assert_allclose(asked(arm, 0.05, P(2.0), P(10.0), P(4.0)), 0.25 * 2.0 + 0.25 * 10.0 + 0.5 * 4.0)
    np.testing.assert_allclose(asked(arm, 0.05, P(2.0), P(10.0), P(2.0)), 0.25 * 10.0 + 0.75 * 2.0)
    np.testing.assert_allclose(asked(arm, 0.1, P(2.0), P(10.0), P(4.0), P(2.0)), 2.0 + 2.0 * 0.6)


@pytest.mark.parametrize(
    ("formulation", "slow", "fast", "after", "fastest"),
    [
        (hqp.Velocity(), P(1.0), P(10.0), 0.1, 10.0),
        (hqp.Velocity(), P(1.0), P(10.0, max_velocity=0.4), 0.1, 10.0),
        (hqp.Velocity(), P(10.0, max_velocity=0.4, max_acceleration=1.0), P((1.0, 5.0, 2.0)), 0.1, 10.0),
        (hqp.Acceleration(), PD(25.0), PD(400.0, max_acceleration=9.0), 0.05, 20.0),
        (hqp.Torque(holding=None), PD(25.0, max_velocity=0.1), PD((400.0, 300.0, 200.0)), 0.071, 20.0),
    ],
)
def test_an_element_has_the_law_of_its_phase(
    arm: Robot, formulation: Any, slow: Any, fast: Any, after: float, fastest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the time in hqp/cpp/rows/law_change.hpp, the solution equals that of a stack with the new law, and back."""
    stack = ARM.with_laws({"hand": slow})
    q, v = arm.home + 0.1, 0.05 * np.ones(arm.nv)
    far = 0.2  # within the limits of motors
    goal = HAND.at(arm.state(q).position("tool0") + far * np.array([0.2, -0.1, 0.15]))
    expected = []
    for law in (slow, fast):
        alone = hqp.Controller(stack.with_laws({"hand": law}), formulation, deadline=np.inf).session(arm, DT)
        alone.step(arm.state(q, v), goal)
        expected.append(alone.step(arm.state(q, v), goal).x.copy())
    run = begin(arm, stack, formulation, hand=fast)
    monkeypatch.setattr(Compiler, "compile", None)
    ticks = round(after / DT) + 1
    for name, x, other in (("slow", *expected), ("fast", *expected[::-1]), ("slow", *expected)):
        run.go(name)
        found = [run.step(arm.state(q, v), goal) for _ in range(ticks)]
        assert all(tick.status is Status.OPTIMAL for tick in found)
        np.testing.assert_allclose(found[-1].x, x, atol=1e-9)
        if run.session.count > ticks:
            steps = np.abs(np.diff([other, *(tick.x for tick in found)], axis=0)).max(axis=1)
            assert steps.max() < 1.01 * DT * fastest * np.abs(x - other).max()


def test_torques_do_not_jump_where_a_law_changes(arm: Robot) -> None:
    """Closed loop: torques change by at most a tenth of the jump of an abrupt change of law."""
    q, v = arm.home + 0.1, np.zeros(arm.nv)
    stack = ARM.with_laws({"hand": PD(25.0)})
    run = begin(arm, stack, hqp.Torque(holding=None), hand=PD(400.0))
    goal = HAND.at(arm.state(q).position("tool0") + [0.1, -0.05, 0.1])
    torques = []
    for k in range(150):
        if k == 75:
            run.go("fast")
        tick = run.step(arm.state(q, v), goal)
        torques.append(tick.command.copy())
        q, v = tick.advance()
    jumps = np.abs(np.diff(torques, axis=0)).max(axis=1)
    once = hqp.Controller(stack.with_laws({"hand": PD(400.0)}), hqp.Torque(holding=None)).session(arm, DT)
    assert jumps[74] < 0.1 * jump_at_once(arm, stack, once)


def jump_at_once(arm: Robot, stack: Stack, other: Any) -> float:
    session = hqp.Controller(stack, hqp.Torque(holding=None)).session(arm, DT)
    q, v = arm.home + 0.1, np.zeros(arm.nv)
    goal = HAND.at(arm.state(q).position("tool0") + [0.1, -0.05, 0.1])
    last = np.zeros(arm.nv)
    for _ in range(75):
        tick = session.step(arm.state(q, v), goal)
        last = tick.command.copy()
        q, v = tick.advance()
    return float(np.abs(other.step(arm.state(q, v), goal).command - last).max())


def test_what_comes_in_has_its_law_at_once(arm: Robot) -> None:
    stack = Stack(Level(HAND, when="fast", price=0), Level(POSTURE))
    session = hqp.Controller(stack, hqp.Velocity(), deadline=np.inf).session(arm, DT)
    run = Sequence(Phase(name="slow"), Phase(name="fast", laws={"hand": P(10.0)})).run(session)
    state = arm.state(arm.home + 0.1)
    goal = HAND.at(state.position("tool0") + [0.02, 0.0, 0.0])
    run.step(state, goal)
    run.go("fast")
    x = run.step(state, goal).x
    np.testing.assert_allclose(HAND.jacobian(state) @ x, [0.2, 0.0, 0.0], atol=1e-6)


def test_laws_survive_a_change_of_stack(arm: Robot) -> None:
    """Laws of the old and the new stack, at once and during the transition."""
    run = begin(arm, ARM, hqp.Velocity(), hand=P(4.0))
    state = arm.state(arm.home + 0.1)
    goal = HAND.at(state.position("tool0") + [0.02, 0.0, 0.0])
    run.step(state, goal)
    run.go("fast")
    for _ in range(130):
        run.step(state, goal)
    for over in (0.0, 0.02):
        run.session.change(Stack(Level(HAND, price=0), Level(t.Posture(name=f"other {over}"))), over)
        for _ in range(40):
            x = run.step(state, goal).x
            np.testing.assert_allclose(HAND.jacobian(state) @ x, [0.08, 0.0, 0.0], atol=1e-6)


def test_what_does_not_fit_is_refused(arm: Robot) -> None:
    for laws, text in (
        ({"hnd": P(1.0)}, "unknown element.*hand"),
        ({"limits": P(1.0)}, "limits: has no law"),
        ({"hand": PD(1.0)}, "hand: needs a P here"),
        ({"hand": P((1.0, 2.0))}, "P.gain has 2 numbers"),
    ):
        stack = Stack(*ARM.levels, subject_to=[t.JointLimits(name="limits")])
        with pytest.raises(DeclarationError, match=text):
            begin(arm, stack, hqp.Velocity(), **laws)
    for bad in ({"hand": 2.0}, {1: P(1.0)}, "hand"):
        with pytest.raises(DeclarationError, match="phase x: bad laws"):
            Phase(name="x", laws=bad)  # type: ignore[arg-type]


def test_a_law_that_is_part_of_its_rows_stays() -> None:
    robot = hqp.robots.load("talos")
    soles = robot.landmarks["soles"]
    within: list[hqp.Element] = [t.FixedContact(frame=sole) for sole in soles]
    within += [t.CenterOfPressure(contact=sole, rectangle=(-0.09, 0.09, -0.05, 0.05)) for sole in soles]
    stack = Stack(Level(t.Balance(name="balance")), Level(t.Posture()), subject_to=within)
    with pytest.raises(DeclarationError, match="its DCM is part of its rows"):
        begin(robot, stack, hqp.Torque(), balance=DCM(2.0))
    with pytest.raises(DeclarationError, match="cop: has no law"):
        begin(robot, stack, hqp.Torque(), **{f"{soles[0]}_cop": PD(2.0)})


def test_a_file_of_a_sequence_holds_them() -> None:
    steps = Sequence(Phase(name="a", laws={"left hand": PD((1.0, 2.0), 3.0), "com": P(2.0, max_velocity=0.5)}))
    text = serial.dumps_phases(steps)
    assert serial.loads_phases(text) == steps
    assert '"left hand" = { type = "PD", kp = [1.0, 2.0], kd = 3.0 }' in text
    with pytest.raises(DeclarationError, match="law: unknown type"):
        serial.loads_phases('[[phase]]\nname = "a"\nlaws = { hand = { type = "PID", gain = 1.0 } }')
    with pytest.raises(DeclarationError, match="unknown key"):
        serial.loads_phases('[[phase]]\nname = "a"\nlaws = { hand = { type = "P", gian = 1.0 } }')


def test_a_run_without_laws_has_the_declared_ones(arm: Robot) -> None:
    """Start from the declared laws after any earlier run on the session."""
    session = hqp.Controller(ARM, hqp.Velocity(), deadline=np.inf).session(arm, DT)
    state = arm.state(arm.home + 0.1)
    goal = HAND.at(state.position("tool0") + [0.02, 0.0, 0.0])
    for laws, ticks, speed in (({"hand": P(10.0)}, 1, 0.2), ({}, 52, 0.02)):
        run = Sequence(Phase(name="only", laws=laws)).run(session)
        found = [run.step(state, goal) for _ in range(ticks)]
        np.testing.assert_allclose(HAND.jacobian(state) @ found[-1].x, [speed, 0.0, 0.0], atol=1e-6)


def test_a_phase_with_the_law_of_the_one_before_lets_it_go_on(arm: Robot) -> None:
    """The second phase does not delay the change of gain."""
    session = hqp.Controller(ARM, hqp.Velocity(), deadline=np.inf).session(arm, DT)
    fast = {"hand": P(10.0)}
    run = Sequence(Phase(name="slow"), Phase(name="fast", laws=fast), Phase(name="still fast", laws=fast)).run(session)
    state = arm.state(arm.home + 0.1)
    goal = HAND.at(state.position("tool0") + [0.02, 0.0, 0.0])
    run.step(state, goal)
    for name in ("fast", "still fast"):
        run.go(name)
        found = [run.step(state, goal) for _ in range(26)]
    np.testing.assert_allclose(HAND.jacobian(state) @ found[-1].x, [0.2, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize(
    "laws",
    [3, None, "hand", [("hand", P(2.0))], {"hand": 3.0}, {"hand": PD(4.0, 4.0)}, {"arm": P(2.0)}, {4: P(2.0)}],
    ids=repr,
)
def test_a_session_refuses_laws_when_they_are_given(arm: Robot, laws: Any) -> None:
    session = hqp.Controller(ARM, deadline=np.inf).session(arm, DT)
    with pytest.raises(DeclarationError):
        session.obey(laws)
    assert session.step(arm.state()).status is Status.OPTIMAL


def test_a_session_takes_the_laws_at_the_time_of_the_call(arm: Robot) -> None:
    session = hqp.Controller(ARM, deadline=np.inf).session(arm, DT)
    home = arm.state().position("tool0")

    def speed() -> float:
        for _ in range(1000):  # laws have gone over
            tick = session.step(arm.state(), HAND.at(home + [0.0, 0.0, 0.01]))
        return float(np.linalg.norm(tick.command))

    laws = {"hand": P(1.0)}
    session.obey(laws)
    slow = speed()
    laws["hand"] = P(2.0)
    assert speed() == slow
    session.obey(laws)
    assert speed() == pytest.approx(2.0 * slow, rel=1e-6)


def test_laws_given_in_every_tick_go_over_as_laws_given_once(arm: Robot) -> None:
    once, always = (hqp.Controller(ARM, deadline=np.inf).session(arm, DT) for _ in range(2))
    goal = HAND.at(arm.state().position("tool0") + [0.0, 0.0, 0.01])
    for k in range(300):
        laws = {"hand": P(4.0 if k < 150 else 2.0)}
        if k in (0, 150):
            once.obey(laws)
        always.obey(dict(laws))
        given = HAND.off() if 155 <= k < 160 else goal
        x, y = (session.step(arm.state(), given).x.copy() for session in (once, always))
        np.testing.assert_array_equal(x, y)
