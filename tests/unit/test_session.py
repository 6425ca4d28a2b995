"""The loop: inputs, outputs, and reactions to faults."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack, Status
from hqp.commands.arguments import formulation
from hqp.errors import (
    DeclarationError,
    FrameNotFound,
    HqpError,
    ModelError,
    NotSolved,
    StaleState,
    UnknownReference,
    UnsupportedProblem,
)
from hqp.loop.checks import rehearse
from hqp.robots import Robot
from hqp.solvers.stages import StagedWorkspace
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture
from tests.scenes.changes import stack

DT = 0.002
WITH_LIMITS = pytest.mark.parametrize("solver", ["lexicographic", "cascade:proxqp"])


@pytest.fixture
def robot() -> Robot:
    return hqp.robots.load("cbi")


def feet() -> list[FixedContact]:
    return [FixedContact(frame="l_sole"), FixedContact(frame="r_sole")]


def paper(hand: Position, **subject_to: Any) -> Stack:
    return Stack(
        Level(*feet(), Com(axes="xy", law=P(2.0), name="com_xy"), name="critical"),
        Level(hand, name="functional"),
        Level(Orientation(frame="pelvis", law=P(2.0)), Com(axes="z", law=P(2.0), name="com_z"), name="extraneous"),
        Level(Posture(law=P(1.0)), name="posture"),
        **subject_to,
    )


def test_command_is_the_actuated_part(robot: Robot) -> None:
    hand = Position(frame="r_palm", law=P(5.0))
    session = hqp.Controller(paper(hand), solver="nullspace").session(robot, DT)
    state = robot.state()
    goal = state.position("r_palm") + [0.0, 0.0, 0.01]
    tick = session.step(state, hand.at(goal))
    assert tick.status is Status.OPTIMAL
    assert tick.command.shape == (51,)
    assert tick.solution is not None
    assert np.array_equal(tick.command, tick.solution.x[robot.actuated])
    hand_rate = robot.state().jacobian("r_palm")[:3] @ tick.solution.x
    assert np.allclose(hand_rate, [0.0, 0.0, 0.05], atol=1e-9)


def test_without_references_everything_holds_still(robot: Robot) -> None:
    tick = hqp.Controller(paper(Position(frame="r_palm")), solver="nullspace").session(robot, DT).step(robot.state())
    assert np.abs(tick.command).max() < 1e-9


def test_a_reference_is_good_for_one_tick(robot: Robot) -> None:
    hand = Position(frame="r_palm", law=P(5.0))
    session = hqp.Controller(paper(hand), solver="nullspace").session(robot, DT)
    state = robot.state()
    session.step(state, hand.at(state.position("r_palm") + 0.01, velocity=[1.0, 0.0, 0.0]))
    assert np.abs(session.step(robot.state()).command).max() < 1e-9


def test_feedforward_alone_keeps_the_hold_value(robot: Robot) -> None:
    hand = Position(frame="r_palm", law=P(5.0))
    session = hqp.Controller(paper(hand), solver="nullspace").session(robot, DT)
    tick = session.step(robot.state(), hand.at(velocity=[0.0, 0.1, 0.0]))
    assert tick.solution is not None
    assert np.allclose(robot.state().jacobian("r_palm")[:3] @ tick.solution.x, [0.0, 0.1, 0.0], atol=1e-9)


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()], ids=["velocity", "acceleration"])
def test_weights_change_the_problem_but_not_a_feasible_answer(robot: Robot, formulation: Any) -> None:
    rng = np.random.default_rng(0)
    q, v = robot.integrate(robot.home, 0.05 * rng.standard_normal(robot.nv), 1.0), 0.1 * rng.standard_normal(robot.nv)
    answers = []
    for weight in (1.0, 7.0):
        stack = Stack(
            Level(*feet(), Com(axes="xy", weight=weight, name="com_xy")),
            Level(Position(frame="r_palm", weight=weight)),
            Level(Posture(weight=weight)),
        )
        session = hqp.Controller(stack, formulation, solver="nullspace", price=0).session(robot, DT)
        session.step(robot.state())
        tick = session.step(robot.state(q, v))
        assert tick.solution is not None
        answers.append(tick.solution.x)
        hand = session.problem.levels[1]
        plain = robot.state(q, v).jacobian("r_palm")[:3]
        assert np.allclose(hand.A, weight * plain, atol=1e-12)  # type: ignore[arg-type]
    assert np.allclose(*answers, atol=1e-8)


def test_acceleration_level_matches_forward_kinematics(robot: Robot) -> None:
    """J x + dJ/dt v equals the demanded acceleration by finite differences of the palm's velocity."""
    rng = np.random.default_rng(1)
    hand = Position(frame="r_palm", law=hqp.PD(100.0, 20.0))
    stack = Stack(Level(*feet()), Level(hand), Level(Posture()))
    session = hqp.Controller(stack, hqp.Acceleration(), solver="nullspace").session(robot, DT)
    q = robot.integrate(robot.home, 0.1 * rng.standard_normal(robot.nv), 1.0)
    v = 0.3 * rng.standard_normal(robot.nv)
    goal, rate, push = q[:3] + 0.3, rng.standard_normal(3), rng.standard_normal(3)
    state = robot.state(q, v)
    session.step(state, hand.at(goal, velocity=rate, acceleration=push))
    state = robot.state(q, v)
    tick = session.step(state, hand.at(goal, velocity=rate, acceleration=push))
    assert tick.solution is not None
    p, pd = state.position("r_palm"), state.velocity("r_palm")[:3]
    demanded = push - 100.0 * (p - goal) - 20.0 * (pd - rate)
    h, a = 1e-6, tick.solution.x
    moved = [robot.state(robot.integrate(q, v * s + 0.5 * a * s * abs(s), 1.0), v + s * a) for s in (h, -h)]
    rates = []
    for other in moved:
        robot.current = other
        rates.append(other.velocity("r_palm")[:3])
    assert np.allclose((rates[0] - rates[1]) / (2 * h), demanded, rtol=1e-6, atol=1e-5 * np.abs(demanded).max())


def test_advance_is_semi_implicit(robot: Robot) -> None:
    session = hqp.Controller(Stack(Level(Posture(law=hqp.PD(10.0)))), hqp.Acceleration(), solver="nullspace").session(
        robot, DT
    )
    rng = np.random.default_rng(2)
    q, v = robot.home, 0.1 * rng.standard_normal(robot.nv)
    tick = session.step(robot.state(q, v))
    assert tick.solution is not None
    q1, v1 = tick.advance()
    assert np.allclose(v1, v + DT * tick.solution.x)
    assert np.allclose(q1, robot.integrate(q, v1, DT))


# errors before the loop -------------------------------------------------------------------------------------------


def test_names_are_resolved_before_the_loop(robot: Robot) -> None:
    with pytest.raises(FrameNotFound, match="r_palm"):
        hqp.Controller(Stack(Level(Position(frame="r_plam"))), solver="nullspace").session(robot, DT)


def test_laws_of_the_wrong_order_are_refused_by_both_names(robot: Robot) -> None:
    stack = Stack(Level(Position(frame="r_palm", law=hqp.PD(100.0))))
    with pytest.raises(DeclarationError, match=r"r_palm.*Velocity.*PD"):
        hqp.Controller(stack, solver="nullspace").session(robot, DT)


def test_solver_capabilities_are_checked_before_the_loop(robot: Robot) -> None:
    with pytest.raises(UnsupportedProblem, match="inequalities"):
        hqp.Controller(paper(Position(frame="r_palm"), subject_to=[JointLimits()]), solver="nullspace").session(
            robot, DT
        )


def test_unknown_solver_and_bad_dt(robot: Robot) -> None:
    stack = Stack(Level(Posture()))
    with pytest.raises(DeclarationError, match="nullspace"):
        hqp.Controller(stack, solver="nullspcae")
    for dt in (0.0, -1.0, np.nan, np.inf, "2ms"):
        with pytest.raises(DeclarationError, match=r"0 < dt <= 0\.1"):
            hqp.Controller(stack, solver="nullspace").session(robot, dt)  # type: ignore[arg-type]


def test_program_errors_raise_in_the_loop(robot: Robot) -> None:
    hand = Position(frame="r_palm")
    session = hqp.Controller(paper(hand), solver="nullspace").session(robot, DT)
    with pytest.raises(UnknownReference, match="r_palm"):
        session.step(robot.state(), Position(frame="l_palm").at([0.0, 0.0, 0.0]))
    with pytest.raises(DeclarationError, match="shape"):
        hand.at([0.0, 0.0])
    posture = session.stack.find("posture", Posture)
    for short in (posture.at(np.zeros(3)), posture.at(velocity=[1.0])):  # only the robot knows how many joints
        with pytest.raises(DeclarationError, match=r"shape \(51,\)"):
            session.step(robot.state(), short)
    stale = robot.state()
    robot.state()
    with pytest.raises(StaleState):
        session.step(stale)
    with pytest.raises(ModelError, match="belongs to"):
        session.step(robot.copy().state())


# data in the loop -------------------------------------------------------------------------------------------------


def checked(robot: Robot, tick: hqp.Tick) -> None:
    """Check that the command is finite and the feet do not move."""
    assert np.isfinite(tick.command).all()
    assert tick.solution is not None
    for foot in ("l_sole", "r_sole"):
        assert np.abs(robot.state(tick._state.q).jacobian(foot) @ tick.solution.x).max() < 1e-8


@pytest.mark.parametrize("solver", ["nullspace", "daqp", "weighted", "lexicographic"])
def test_a_solver_without_prices_is_noted_once(robot: Robot, solver: str) -> None:
    session = hqp.Controller(paper(Position(frame="r_palm")), solver=solver).session(robot, DT)
    told = [[str(note) for note in session.step(robot.state()).notes if "priced" in str(note)] for _ in range(2)]
    assert [len(notes) for notes in told] == [solver != "lexicographic", 0]
    assert all(f"{solver} cannot solve priced levels: every level is exact" in note for note in told[0])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_bad_reference_leaves_its_element_out(robot: Robot, bad: float) -> None:
    hand = Position(frame="r_palm")
    session = hqp.Controller(paper(hand), solver="nullspace").session(robot, DT)
    tick = session.step(robot.state(), hand.at([bad, 0.0, 1.0]))
    assert tick.status is Status.INVALID_REFERENCE
    assert [note.element for note in tick.notes if note.status is not Status.OPTIMAL] == ["r_palm"]
    checked(robot, tick)
    with pytest.raises(NotSolved, match="r_palm"):
        tick.unwrap()
    assert session.step(robot.state()).status is Status.OPTIMAL


@dataclasses.dataclass(frozen=True, kw_only=True)
class Broken(Position):
    """User task with a Jacobian that fails at runtime."""

    def jacobian(self, state: Any) -> Any:
        return super().jacobian(state) * np.nan


@WITH_LIMITS
def test_a_task_that_writes_nan_is_named_and_left_out(robot: Robot, solver: str) -> None:
    stack = Stack(Level(*feet()), Level(Broken(frame="r_palm", name="broken")), Level(Posture()))
    session = hqp.Controller(stack, solver=solver, price=0).session(robot, DT)
    for _ in range(2):
        tick = session.step(robot.state())
        assert tick.status is Status.INVALID_ELEMENT
        assert [note.element for note in tick.notes] == ["broken"]
        checked(robot, tick)


def test_a_bad_state_slows_the_last_safe_command_down(robot: Robot) -> None:
    hand = Position(frame="r_palm", law=P(5.0))
    session = hqp.Controller(paper(hand), solver="nullspace").session(robot, DT)
    first = session.step(robot.state(np.full(robot.nq, np.nan)))
    assert first.status is Status.INVALID_STATE
    assert np.array_equal(first.command, np.zeros(51))
    state = robot.state()
    good = session.step(state, hand.at(state.position("r_palm") + 0.01))
    held = session.step(robot.state(v=np.full(robot.nv, np.inf)))
    assert held.status is Status.INVALID_STATE
    assert held.held == 1
    fastest = np.abs(good.command).max()
    assert np.allclose(held.command, good.command * max(0.0, 1.0 - 50.0 * DT / fastest), atol=1e-12)
    with pytest.raises(NotSolved):
        held.unwrap()


@WITH_LIMITS
def test_an_unreachable_hand_leaves_the_feet_alone(robot: Robot, solver: str) -> None:
    hand = Position(frame="r_palm", law=P(5.0))
    session = hqp.Controller(paper(hand, subject_to=[JointLimits()]), solver=solver, price=0, deadline=np.inf).session(
        robot, DT
    )
    session.step(robot.state())
    tick = session.step(robot.state(), hand.at([9.0, 0.0, 1.0]))
    assert tick.status in (Status.OPTIMAL, Status.NOT_CERTIFIED)
    assert np.all(np.abs(tick.command) <= robot.velocity_limit[robot.actuated] + 1e-9)
    checked(robot, tick)
    account = tick.explain()["r_palm"]
    assert not account.met
    assert {loss.element for loss in account.losses} & {"joint_limits", "l_sole", "r_sole", "com_xy"}


def test_contradictory_contacts_are_named(robot: Robot) -> None:
    contacts = [*feet(), FixedContact(frame="r_sole", name="pulled")]
    stack = Stack(Level(Posture()), subject_to=contacts)
    session = hqp.Controller(stack, solver="nullspace").session(robot, DT)
    session.step(robot.state())
    pulled = stack.find("pulled", FixedContact)
    pose = pulled.value(robot.state())
    tick = session.step(robot.state(), pulled.at(velocity=[0.1, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert pose is not None
    assert tick.status is Status.CONSTRAINTS_VIOLATED
    assert {note.element for note in tick.notes} == {"r_sole", "pulled"}
    assert np.isfinite(tick.command).all()


def test_rows_that_are_off_are_told_by_their_joints() -> None:
    """A row needs more of each joint than the limits allow: the note has the worst three, worst first."""
    arm = hqp.robots.load("ur5")
    slow = Stack(subject_to=[Posture(law=P(200.0), name="servo"), JointLimits()])
    home = arm.state(arm.home)
    servo = slow.find("servo", Posture)
    goal = servo.at(arm.home + [0.3, 0.0, 0.0, 0.2, -0.4, 0.1])
    tick = hqp.Controller(slow).session(arm, DT).step(home, goal)
    (note,) = [n for n in tick.notes if n.element == "servo"]
    assert note.status is Status.CONSTRAINTS_VIOLATED
    amounts = re.findall(r"(\w+_joint) ([\d.]+)", note.detail)
    assert [name for name, _ in amounts] == ["wrist_2_joint", "shoulder_pan_joint", "wrist_1_joint"]
    assert note.detail.endswith("and 1 more")
    assert f"violated by up to {amounts[0][1]}:" in note.detail


def test_the_same_task_twice_changes_nothing(robot: Robot) -> None:
    hand = Position(frame="r_palm", law=P(5.0))
    twin = Position(frame="r_palm", law=P(5.0), name="twin")
    commands = []
    for level in (Level(hand), Level(hand, twin)):
        session = hqp.Controller(Stack(Level(*feet()), level, Level(Posture())), solver="nullspace").session(robot, DT)
        session.step(robot.state())
        q = robot.integrate(robot.home, 0.02 * np.ones(robot.nv), 1.0)
        commands.append(session.step(robot.state(q)).command)
    assert np.allclose(*commands, atol=1e-9)


@pytest.mark.long
@WITH_LIMITS
def test_start_outside_the_limits_comes_back(robot: Robot, solver: str) -> None:
    stack = Stack(Level(Posture(law=P(0.0))), subject_to=[JointLimits()])
    session = hqp.Controller(stack, solver=solver).session(robot, DT)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    knee = int(robot.joints("R_KFE")[0])
    q[knee + 1] = robot.lower[knee] - 0.05
    tick = session.step(robot.state(q, v))
    assert tick.status in (Status.OPTIMAL, Status.CONSTRAINTS_VIOLATED)
    for _ in range(400):
        tick = session.step(robot.state(q, v))
        assert np.isfinite(tick.command).all()
        q, v = tick.advance()
    assert q[knee + 1] > robot.lower[knee] - 1e-6


def test_explain_tells_of_the_latest_tick_only(robot: Robot) -> None:
    session = hqp.Controller(paper(Position(frame="r_palm")), solver="nullspace").session(robot, DT)
    tick = session.step(robot.state())
    assert "critical" in str(tick.explain())
    session.step(robot.state())
    with pytest.raises(HqpError, match="latest"):
        tick.explain()


def test_change_keeps_what_survives(robot: Robot) -> None:
    hand = Position(frame="r_palm", law=P(5.0))
    session = hqp.Controller(paper(hand), solver="nullspace").session(robot, DT)
    session.step(robot.state())
    q = robot.integrate(robot.home, 0.02 * np.ones(robot.nv), 1.0)
    before = session.step(robot.state(q))
    session.change(paper(hand).without("com_z"))
    after = session.step(robot.state(q))
    palm = robot.state(q).jacobian("r_palm")[:3]
    assert before.solution is not None
    assert after.solution is not None
    assert np.allclose(palm @ before.solution.x, palm @ after.solution.x, atol=1e-9)  # same hold value
    with pytest.raises(FrameNotFound):
        session.change(Stack(Level(Position(frame="nowhere"))))
    assert np.allclose(session.step(robot.state(q)).command, after.command)


@pytest.mark.parametrize("kind", ["velocity", "torque"])
def test_a_workspace_is_bound_before_the_first_tick(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Binding took half of CBi's first tick; the workspace of a changed stack is bound early as well."""
    robot, late, ticking = hqp.robots.load("cbi"), list[Any](), False
    bind = StagedWorkspace._bind

    def watched(self: Any, problem: Any) -> None:
        late.extend([problem] if ticking else [])
        bind(self, problem)

    monkeypatch.setattr(StagedWorkspace, "_bind", watched)
    whole = stack(robot, kind)
    run = hqp.Controller(whole, formulation(kind), deadline=np.inf).session(robot, 0.002)
    for declared in (whole, whole.without("hand")):
        run.change(declared)
        ticking = True
        run.step(robot.state())
        ticking = False
    assert not late


def test_stacks_are_rehearsed_on_one_copy_of_the_robot_as_it_stands() -> None:
    robot = hqp.robots.load("ur5")
    made: list[Robot] = []
    copy = robot.copy

    def counted() -> Robot:
        made.append(copy())
        return made[-1]

    robot.copy = counted  # type: ignore[method-assign]
    for k, moved in enumerate((False, False, True)):
        if moved:
            robot.set_home(robot.home + 0.1)
        rehearse(hqp.Velocity(), Stack(Level(Posture(name=f"posture {k}"))), robot, 0.01)
    assert len(made) == 2
    assert made[-1].home == pytest.approx(robot.home)
