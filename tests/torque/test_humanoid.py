"""Humanoids in double and single support against a full inverse-dynamics hierarchy built independently."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from hqp import PD, Level, Stack
from hqp.arrays import Vec
from hqp.loop.session import Session
from hqp.problem.completion import Choice
from hqp.robots import Robot
from hqp.tasks import (
    CenterOfPressure,
    Com,
    ContactForce,
    FixedContact,
    FrictionCone,
    JointTorque,
    Orientation,
    Position,
    Posture,
    TorqueLimits,
)
from hqp.torque.program import TorqueProgram
from tests.torque.inverse_dynamics import InverseDynamics, on_level_ground

MU, HALF = 0.6, (0.05, 0.04)
DT = 0.001


def consistent(robot: Robot, feet: tuple[str, ...], seed: int, speed: float = 0.3) -> tuple[Vec, Vec]:
    """A configuration near home and a velocity that keeps the feet still."""
    rng = np.random.default_rng(seed)
    step = 0.05 * rng.normal(size=robot.nv)
    q = robot.integrate(robot.home, step, 1.0)
    state = robot.state(q)
    J = np.vstack([state.jacobian(f) for f in feet])
    v = rng.normal(size=robot.nv)
    v -= np.linalg.lstsq(J, J @ v, rcond=None)[0]
    return q, speed * v / np.linalg.norm(v)


def stack(robot: Robot, feet: tuple[str, ...], *, limited: bool = True) -> Stack:
    """Stack: feet that only push, free foot, CoM and base over the hand over the posture."""
    base = robot.landmarks["base"][0]
    hand = robot.landmarks["palms"][0]
    free = [f for f in robot.landmarks["soles"] if f not in feet]
    x, y = HALF
    limits = [TorqueLimits()] if limited else []
    for foot in feet if limited else ():
        limits += [
            FrictionCone(contact=foot, mu=MU, torsion=math.inf),
            CenterOfPressure(contact=foot, rectangle=(-x, x, -y, y)),
        ]
    return Stack(
        Level(*(FixedContact(frame=f, law=PD(100.0, 20.0)) for f in free), Com(name="com", law=PD(50.0, 10.0))),
        Level(Position(frame=hand, name="hand", law=PD(80.0, 15.0)), Orientation(frame=base, name="base")),
        Level(Posture(name="posture", law=PD(30.0, 8.0))),
        subject_to=[*(FixedContact(frame=f) for f in feet), *limits],
    )


def program(session: Session) -> TorqueProgram:
    assert isinstance(session.program, TorqueProgram)
    return session.program


def full_problem(robot: Robot, session: Session, q: Vec, v: Vec, feet: tuple[str, ...], limited: bool) -> hqp.Hierarchy:
    """Independent hierarchy for the demands (a - kp e - kd J v - dJ/dt v) of the session."""
    full = InverseDynamics(robot, q, v, feet)
    rows = program(session).assembly
    base, hand = robot.landmarks["base"][0], robot.landmarks["palms"][0]
    parts = {"com": full.com(), "hand": full.frame(hand), "base": full.frame(base)}
    free = [f for f in robot.landmarks["soles"] if f not in feet]

    def demand(name: str) -> Vec:
        return rows.lower[rows.members[name].part].copy()

    posture = np.eye(robot.nv)[robot.joints(None)]
    levels = (
        full.motion(*((full.frame(f)[0], demand(f)) for f in free), (parts["com"][0], demand("com"))),
        full.motion((parts["hand"][0][:3], demand("hand")), (parts["base"][0][3:], demand("base"))),
        full.motion((posture, demand("posture"))),
    )
    # the drifts in the demands are compared with this module's
    for name, (J, drift) in (("com", full.com()), ("hand", full.frame(hand)), ("base", full.frame(base))):
        picked = {"com": slice(0, 3), "hand": slice(0, 3), "base": slice(3, 6)}[name]
        assert np.abs(rows.drift[rows.members[name].part] - drift[picked]).max() < 1e-9
        assert np.abs(rows.J[rows.members[name].part] - J[picked]).max() < 1e-11
    return full.hierarchy(full.limits(MU, HALF) if limited else None, *levels)


@pytest.mark.parametrize("support", ["double", "single"])
@pytest.mark.parametrize("push", [0.0, 0.6])
def test_torques_are_optimal_in_the_full_problem(humanoid: Robot, support: str, push: float) -> None:
    feet = humanoid.landmarks["soles"] if support == "double" else humanoid.landmarks["soles"][:1]
    whole = stack(humanoid, feet)
    session = hqp.Controller(whole, hqp.Torque(), price=0, deadline=math.inf).session(humanoid, dt=DT)
    com = whole.find("com", Com)
    bound = 0
    for seed in range(3):
        q, v = consistent(humanoid, feet, seed)
        state = humanoid.state(q, v)
        goal = com.value(state) + push * np.array([1.0, -0.5, 0.2])
        if support == "single":
            goal[:2] = state.position(feet[0])[:2] + push * np.array([0.3, 0.1])
        tick = session.step(state, com.at(goal))
        assert tick.solution is not None
        x = tick.solution.x
        bound += sum(int(np.count_nonzero(np.abs(marks) == 1)) for marks in tick.solution.active[:2])
        problem = full_problem(humanoid, session, q, v, feet, True)
        x = next(Choice(session.problem, x).within())  # the choice among optima exceeds rows of forces
        force = np.concatenate(list(program(session).contact_forces(x, world=True).values()))
        z = np.concatenate((program(session).acceleration(x), force, x))
        w = problem.slacks(z)
        assert np.abs(w[0]).max() < 1e-8
        certificate = hqp.certificate(problem, z)
        gaps = certificate.gaps[: len(problem.levels)]  # the completion is judged elsewhere
        assert np.max(gaps) < 1e-6, str(certificate)
        for mine, theirs in zip(tick.solution.norms[-3:], [float(np.linalg.norm(r)) for r in w[-3:]], strict=True):
            assert mine == pytest.approx(theirs, rel=1e-6, abs=1e-7)
    if push:
        assert bound > 0, "no limit was active: the test would show nothing"


@pytest.mark.parametrize("support", ["double", "single"])
def test_all_strict_solvers_agree_without_limits(humanoid: Robot, support: str) -> None:
    feet = humanoid.landmarks["soles"] if support == "double" else humanoid.landmarks["soles"][:1]
    q, v = consistent(humanoid, feet, 4)
    found = {}
    for name in hqp.solvers.available():
        solver = hqp.solvers.load(name)
        if not (solver.strict and solver.metric):
            continue
        whole = stack(humanoid, feet, limited=False)
        session = hqp.Controller(whole, hqp.Torque(), price=0, solver=solver, deadline=math.inf).session(
            humanoid, dt=DT
        )
        com = whole.find("com", Com)
        goal = com.value(humanoid.state(q, v)) + 0.02
        found[name] = session.step(humanoid.state(q, v), com.at(goal)).command
    reference = found.pop("nullspace")
    assert found
    for name, command in found.items():
        assert np.abs(command - reference).max() <= 1e-8 * np.abs(reference).max(), name


def test_redundant_contacts_leave_internal_forces_that_a_last_level_settles(humanoid: Robot) -> None:
    soles = humanoid.landmarks["soles"]
    q, v = consistent(humanoid, soles, 5)
    bare = stack(humanoid, soles, limited=False)
    centred = [ContactForce(contact=f, components=("fx", "fy", "mx", "my", "mz")) for f in soles]
    least = Stack(*bare.levels, Level(JointTorque()), subject_to=bare.subject_to)
    forced = Stack(*bare.levels, Level(*centred), subject_to=bare.subject_to)
    commands, sideways, motion = {}, {}, {}
    for name, whole in (("gauss", bare), ("least", least), ("forced", forced)):
        session = hqp.Controller(whole, hqp.Torque(), price=0, deadline=math.inf).session(humanoid, dt=DT)
        tick = session.step(humanoid.state(q, v))
        commands[name] = tick.command
        forces = program(session).contact_forces(tick.command)
        sideways[name] = sum(float(forces[f][[0, 1, 3, 4, 5]] @ forces[f][[0, 1, 3, 4, 5]]) for f in soles)
        for f in soles:
            axes = on_level_ground(humanoid.placement(humanoid.frame(f))[1])
            assert np.allclose(program(session).contact_axes()[f], axes, atol=1e-12)
        motion[name] = program(session).acceleration(tick.command)
        metric = session.problem.metric
        assert metric is not None
        sizes = np.linalg.eigvalsh(metric)
        assert int(np.count_nonzero(sizes > 1e-9 * sizes.max())) == humanoid.actuated.size - 6
    assert np.abs(motion["least"] - motion["forced"]).max() < 1e-6
    assert np.linalg.norm(commands["least"]) <= np.linalg.norm(commands["gauss"]) + 1e-6
    assert np.linalg.norm(commands["least"]) < np.linalg.norm(commands["forced"]) - 1e-3
    assert sideways["forced"] < sideways["least"] - 1e-3


def test_unloading_a_foot_first_bounds_the_jump_of_the_torques(humanoid: Robot) -> None:
    left, right = humanoid.landmarks["soles"]
    com = Com(axes="xy", name="com", law=PD(50.0, 14.0))
    height = Com(axes="z", name="height")
    arms = Posture(name="posture", law=PD(50.0, 14.0))
    both = [FixedContact(frame=left), FixedContact(frame=right)]
    unload = ContactForce(contact=right, components=("fx", "fy", "fz", "mx", "my", "mz"), name="unload")
    levels = (Level(com, height), Level(arms))
    double = Stack(*levels, subject_to=both)
    unloaded = Stack(Level(unload), *levels, subject_to=both)
    single = Stack(Level(FixedContact(frame=right, law=PD(100.0, 20.0))), *levels, subject_to=both[:1])
    q, v = humanoid.home, np.zeros(humanoid.nv)
    state = humanoid.state(q, v)
    goal = com.at(state.position(left)[:2])
    jumps = {}
    for name, before in (("loaded", double), ("unloaded", unloaded)):
        session = hqp.Controller(before, hqp.Torque(), price=0, deadline=math.inf).session(humanoid, dt=DT)
        last = session.step(humanoid.state(q, v), goal).command
        session.change(single)
        released = session.step(humanoid.state(q, v), goal).command
        session.change(before)
        again = session.step(humanoid.state(q, v), goal).command
        assert np.abs(again - last).max() < 1e-6
        jumps[name] = float(np.abs(released - last).max())
    assert jumps["unloaded"] < 0.05 * jumps["loaded"], jumps


def test_a_robot_without_enough_contacts_is_refused(humanoid: Robot) -> None:
    com = Com(name="com")
    with pytest.raises(hqp.HqpError, match=r"rank \[J_constr; U\] = "):
        hqp.Controller(Stack(Level(com)), hqp.Torque()).session(humanoid, dt=DT)
