"""Dreamer at torque level: references, gravity normals, self motion, couplings, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from hqp import PD, Level, SelfMotion, Stack
from hqp.arrays import Vec
from hqp.errors import DeclarationError, StaleState
from hqp.robots import Robot
from hqp.tasks import (
    Com,
    FrictionCone,
    JointLimits,
    Position,
    Posture,
    TorqueLimits,
    UnilateralContact,
)
from hqp.torque.gravity import holding_torque
from hqp.torque.program import TorqueProgram
from tests.scenes.sentis2012 import CONTACTS as WHEELS
from tests.scenes.sentis2012 import HELD

HAND = Position(frame="hand", relative_to="base", law=PD(30.0, 11.0))
POSTURE = Posture(joints="upper_body", law=PD(100.0), name="posture")
LEVELS = (Level(Com(axes="xy", subtree="torso_yaw", relative_to="base", name="com")), Level(HAND), Level(POSTURE))


def session_of(robot: Robot, *extra: hqp.Element, hold: bool = False) -> hqp.Session:
    stack = Stack(*LEVELS, subject_to=[*HELD, *extra])
    return hqp.Controller(stack, hqp.Torque(gravity_compensation=hold), solver="lexicographic").session(robot, 0.001)


def program(session: hqp.Session) -> TorqueProgram:
    assert isinstance(session.program, TorqueProgram)
    return session.program


def test_at_rest_on_goal_the_torque_holds_gravity(dreamer: Robot) -> None:
    session = session_of(dreamer)
    state = dreamer.state()
    tick = session.step(state)
    J = program(session).dynamics.J.copy()
    held = holding_torque(J, dreamer.state().gravity_force(), dreamer.actuation)
    assert tick.status is hqp.Status.OPTIMAL
    assert np.abs(tick.command - held).max() < 1e-8
    forces = program(session).contact_forces(tick.command)
    assert sum(forces[w.name][1] for w in WHEELS) == pytest.approx(dreamer.mass * 9.81, rel=1e-9)


def test_gravity_normals_change_the_holding_torque_only(dreamer: Robot) -> None:
    session = session_of(dreamer, hold=True)
    slope = np.array([math.sin(0.12), 0.0, math.cos(0.12)])
    plain = session.step(dreamer.state())
    J_flat = program(session).assembly.J[:7].copy()
    rows = program(session).A.copy()
    tilted = session.step(dreamer.state(), *(w.at(gravity_normal=slope) for w in WHEELS))
    assert np.array_equal(program(session).A, rows)
    session.step(dreamer.state(), *(w.at(normal=slope) for w in WHEELS))
    J_slope = program(session).assembly.J[:7].copy()
    g = dreamer.state().gravity_force()
    expected = holding_torque(J_slope, g, dreamer.actuation) - holding_torque(J_flat, g, dreamer.actuation)
    assert np.abs(expected).max() > 1.0
    assert np.abs(tilted.command - plain.command - expected).max() < 1e-8


@pytest.mark.parametrize("hold", [True, False])
def test_goals_that_move_with_the_robot_let_it_roll_unless_gravity_is_compensated(dreamer: Robot, hold: bool) -> None:
    session = session_of(dreamer, hold=hold)
    slope = np.array([math.sin(0.12), 0.0, math.cos(0.12)])
    tick = session.step(dreamer.state(), *(w.at(normal=slope) for w in WHEELS))
    rolling = float(np.linalg.norm(program(session).acceleration(tick.command)[:3]))
    assert rolling < 1e-9 if hold else rolling > 0.5


def test_coupled_joints_stay_coupled(dreamer: Robot) -> None:
    session = session_of(dreamer, TorqueLimits())
    state = dreamer.state()
    goal = HAND.value(state) + np.array([0.1, 0.05, -0.1])
    q, v = state.q, state.v
    for _ in range(200):
        tick = session.step(dreamer.state(q, v), HAND.at(goal))
        assert tick.status is hqp.Status.OPTIMAL
        q, v = tick.advance()
    angles = dreamer.state(q, v).angles
    hip, thorax = dreamer.joints(["torso_hip", "torso_thorax"])
    assert abs(angles[hip] - angles[thorax]) < 1e-9
    assert abs(angles[hip]) > 1e-3
    assert np.abs(HAND.value(dreamer.state(q, v)) - goal).max() < 0.12


def test_joint_limits_hold_at_torque_level(dreamer: Robot) -> None:
    limits = JointLimits(joints="arm", acceleration=40.0, margin=0.02)
    session = session_of(dreamer, limits)
    state = dreamer.state()
    q, v = state.q, state.v
    arm = dreamer.joints("arm")
    goal = np.zeros(9)
    goal[2:] = 10.0  # far beyond every limit
    for _ in range(1500):
        tick = session.step(dreamer.state(q, v), POSTURE.at(goal))
        q, v = tick.advance()
    angles = dreamer.state(q, v).angles[arm]
    assert np.all(angles <= dreamer.upper[arm] - 0.02 + 1e-6)
    assert np.all(np.abs(v[arm]) <= dreamer.velocity_limit[arm] + 1e-6)


def test_a_saturated_law_asks_for_no_more_than_its_acceleration(dreamer: Robot) -> None:
    com = Com(axes="xy", subtree="torso_yaw", relative_to="base", law=PD(400.0, 40.0, max_acceleration=2.5), name="com")
    stack = Stack(Level(com), *LEVELS[1:], subject_to=HELD)
    session = hqp.Controller(stack, hqp.Torque(), solver="nullspace").session(dreamer, 0.001)
    state = dreamer.state()
    tick = session.step(state, com.at(com.value(state) + np.array([0.3, 0.4])))
    acceleration = com.jacobian(state) @ program(session).acceleration(tick.command)
    assert np.linalg.norm(acceleration) == pytest.approx(2.5, rel=1e-9)
    assert acceleration[1] / acceleration[0] == pytest.approx(4.0 / 3.0, rel=1e-9)


def test_self_motion_falls_as_its_lyapunov_function(dreamer: Robot) -> None:
    """V decays as exp(-2 ke t) in closed loop through the session, to first order in the control period."""
    law = SelfMotion(4.0, 4.0, 2.0)
    hand = Position(frame="hand", law=PD(100.0), name="hand")
    posture = Posture(joints=dreamer.joint_names, law=law, name="self")
    stack = Stack(Level(hand), Level(posture), subject_to=HELD)

    def deviation(dt: float) -> float:
        session = hqp.Controller(stack, hqp.Torque(), solver="nullspace").session(dreamer, dt)
        q, v = dreamer.home, np.zeros(dreamer.nv)
        goal = posture.value(dreamer.state(q, v)) + 0.3
        energies = []
        for _ in range(round(0.2 / dt)):
            state = dreamer.state(q, v)
            tick = session.step(state, posture.at(goal))
            energies.append(_energy(program(session), dreamer, posture.value(state) - goal, v))
            q, v = tick.advance()
        times = dt * np.arange(len(energies))
        return float(np.abs(np.array(energies) / energies[0] / np.exp(-2.0 * law.ke * times) - 1.0).max())

    coarse, fine = deviation(0.004), deviation(0.002)
    assert fine < 0.02
    assert fine < 0.6 * coarse


def _energy(compiled: TorqueProgram, robot: Robot, error: Vec, v: Vec) -> float:
    rows = compiled.assembly
    above = np.vstack((rows.J[:7], rows.J[rows.members["hand"].part]))
    _, sizes, Vt = np.linalg.svd(above)
    left, shares, _ = np.linalg.svd(Vt[sizes.size :, robot.actuated].T, full_matrices=False)
    basis = left[:, shares > 1e-9]
    E = basis.T @ (-4.0 * error - 4.0 * v[robot.actuated])
    return 0.5 * float(E @ E)


def test_friction_of_a_wheel_is_along_its_rolling_direction(dreamer: Robot) -> None:
    limits = [FrictionCone(contact=w.name, mu=0.02) for w in WHEELS] + [
        UnilateralContact(contact=w.name) for w in WHEELS
    ]
    com = Com(axes="xy", law=PD(25.0), name="com")
    stack = Stack(Level(com), *LEVELS[1:], subject_to=[*HELD, *limits])
    session = hqp.Controller(stack, hqp.Torque(), deadline=np.inf).session(dreamer, 0.001)
    state = dreamer.state()
    tick = session.step(state, com.at(com.value(state) + 0.02))
    forces = program(session).contact_forces(tick.command)
    excess = [abs(forces[w.name][0]) - 0.02 * forces[w.name][1] for w in WHEELS]
    assert max(excess) == pytest.approx(0.0, abs=1e-7)
    assert min(forces[w.name][1] for w in WHEELS) > -1e-9
    assert tick.solution is not None
    assert hqp.certificate(session.problem, tick.solution.x).ok


def test_what_does_not_fit_is_refused(dreamer: Robot) -> None:
    with pytest.raises(DeclarationError, match="order 2"):
        hqp.Controller(Stack(Level(Com(law=hqp.P(1.0))), subject_to=HELD), hqp.Torque()).session(dreamer, 0.001)
    with pytest.raises(DeclarationError, match=r"rank \[J_constr; U\] = "):
        hqp.Controller(Stack(*LEVELS, subject_to=HELD[:3]), hqp.Torque()).session(dreamer, 0.001)
    with pytest.raises(DeclarationError, match="a contact in subject_to"):
        session_of(dreamer, FrictionCone(contact="wheel_7", mu=0.5))
    shared = Level(Posture(joints="arm", law=SelfMotion(1.0, 1.0, 1.0), name="a"), Posture(joints="torso", name="b"))
    with pytest.raises(DeclarationError, match="alone in its level"):
        hqp.Controller(Stack(shared, subject_to=HELD), hqp.Torque()).session(dreamer, 0.001)
    session = session_of(dreamer)
    tick = session.step(dreamer.state())
    session.step(dreamer.state())
    with pytest.raises(StaleState):
        tick.advance()


def test_a_reference_that_is_not_finite_leaves_its_rows_out_and_the_wheels_in(dreamer: Robot) -> None:
    session = session_of(dreamer)
    good = session.step(dreamer.state())
    bad = session.step(dreamer.state(), HAND.at([np.nan, 0.0, 0.0]), WHEELS[0].at([np.nan, 0.0, 0.0]))
    assert bad.status is hqp.Status.INVALID_REFERENCE
    assert {note.element for note in bad.notes} >= {"hand", "wheel_0"}
    assert np.isfinite(bad.command).all()
    again = session.step(dreamer.state())
    assert np.abs(again.command - good.command).max() < 1e-8
