"""The library's stack on Dreamer: its rows against independently derived ones, its torque against the paper's law."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import hqp
from benchmarks.reports.checks import Check, at_most, seen_to_fail
from benchmarks.sentis2012.equations.ground import Ground, Snapshot, largest, relative
from benchmarks.sentis2012.equations.law import (
    orthogonal_projector,
    posture_demand,
    projector_rate,
)
from hqp import PD, Level, SelfMotion, Stack
from hqp.declare.reference import Reference
from hqp.errors import DeclarationError
from hqp.loop.session import Session
from hqp.solvers.base import Solver
from hqp.tasks import (
    Com,
    FrictionCone,
    OmniWheelContact,
    Position,
    Posture,
    TorqueLimits,
    UnilateralContact,
)
from hqp.torque.program import TorqueProgram
from tests.scenes.sentis2012 import COM, CONTACTS, EXACT, HAND, HELD, POSTURE, WHEELS, paper_stack

SEED = 2013


def checks(ground: Ground, count: int) -> Iterator[Check]:
    """Every row on one slope at ``count`` random states."""
    yield from _rows(ground, count)
    yield from _self_motion(ground, max(count // 4, 3))
    yield from _limits(ground, max(count // 4, 3))
    yield from _friction(ground)
    yield from _refusal(ground)


def at_states(
    ground: Ground, stack: Stack, solver: str | Solver, count: int, seed: int, speed: float = 1.0
) -> Iterator[tuple[Snapshot, Session, hqp.Tick]]:
    """Steps of one session at random states, goals a little off the state's values."""
    session = hqp.Controller(stack, hqp.Torque(loop_law=EXACT), solver=solver, price=0, deadline=math.inf).session(
        ground.robot, dt=0.001
    )
    for s in ground.states(count, seed, speed):
        given = references(ground, s, stack)
        yield s, session, session.step(ground.robot.state(s.q, s.v), *given)


def references(ground: Ground, s: Snapshot, stack: Stack) -> list[Reference]:
    """Ground normals for the wheels, and goals near the state, equal for every solver."""
    state = ground.robot.state(s.q, s.v)
    rng = np.random.default_rng(int(1e6 * abs(s.q[7])) % 2**31)
    found: list[Reference] = [w.at(normal=ground.normal) for w in CONTACTS]
    for task, size in ((COM, 0.002), (HAND, 0.05), (POSTURE, 0.1)):
        if task.name in stack:
            value = task.value(state)
            found.append(task.at(value + size * rng.normal(size=value.shape)))
    return found


def _program(session: Session) -> TorqueProgram:
    program = session.program
    if not isinstance(program, TorqueProgram):
        raise TypeError("the session was not compiled for torques")
    return program


def _rows(ground: Ground, count: int) -> Iterator[Check]:
    label, robot = ground.label, ground.robot
    session = hqp.Controller(
        paper_stack(), hqp.Torque(loop_law=EXACT), solver="nullspace", price=0, deadline=math.inf
    ).session(robot, dt=0.001)
    rows, drift, forces, absolute = [], [], [], []
    for s in ground.free_states(count, SEED):
        given = references(ground, s, session.stack)
        session.step(robot.state(s.q, s.v), *given)
        program = _program(session)
        rows.append(largest(program.dynamics.J - s.J))
        drift.append(largest(program.assembly.lower[:7] + s.dJ @ s.v))
        tau = 20.0 * s.rng.normal(size=12)
        true = s.kkt(tau)[1]
        found = np.concatenate([program.contact_forces(tau)[e.name] for e in HELD])
        forces.append(relative(found + true, true))
    for s in ground.states(count, SEED):
        state = robot.state(s.q, s.v)
        J = np.vstack((COM.jacobian(state), HAND.jacobian(state)))
        world = np.vstack((s.com[0], s.hand[0]))
        absolute.append(largest(J @ s.v - world @ s.v))
    text = "J_constr of JointCoupling and OmniWheelContact vs by hand"
    yield at_most("S(8)-(11)", text, label, 1e-12, rows)
    yield at_most("S(3)", "their drift vs by hand, any velocity", label, 1e-11, drift)
    yield at_most("S(3)", "the session's contact forces = -lambda of KKT, relative", label, 1e-9, forces)
    text = "absolute velocities where the goal moves with the body [m/s]"
    yield seen_to_fail("S(57),(58) erratum 20", text, label, 1e-7, absolute)


def _self_motion(ground: Ground, count: int) -> Iterator[Check]:
    """Posture(law=SelfMotion) under an absolute hand task: v of eq. (41), sign corrected, by differences of Phi."""
    hand = Position(frame="hand", law=PD(100.0, 20.0))
    actuated = Posture(joints=ground.robot.joint_names, law=SelfMotion(4.0, 4.0, 1.0), name="self")
    stack = Stack(Level(hand), Level(actuated), subject_to=HELD)
    session = hqp.Controller(stack, hqp.Torque(loop_law=EXACT), solver="nullspace", price=0, deadline=math.inf).session(
        ground.robot, dt=0.001
    )
    off = []
    for s in ground.states(count, SEED + 2):
        state = ground.robot.state(s.q, s.v)
        goal = actuated.value(state) + 0.3 * s.rng.normal(size=12)
        aim = hand.at(hand.value(state) + 0.01)
        state = ground.robot.state(s.q, s.v)
        session.step(state, aim, actuated.at(goal), *(w.at(normal=ground.normal) for w in CONTACTS))
        J, dJ = s.star(*s.hand)
        Phi, dPhi = orthogonal_projector(J), projector_rate(J, dJ)
        error = actuated.value(ground.robot.state(s.q, s.v)) - goal
        v = posture_demand(Phi, dPhi, error, s.q_act, (4.0, 4.0, 1.0))
        program = _program(session)
        off.append(relative(program.assembly.lower[program.assembly.members["self"].part] - v, v))
    yield at_most("S(40),(41)", "Posture(law=SelfMotion): v vs analytic dPhi/dt, relative", ground.label, 1e-8, off)


def _limits(ground: Ground, count: int) -> Iterator[Check]:
    """Torque limits at a fraction of the projector's torque: upper levels hold, the posture deviates."""
    label = ground.label
    for share in (0.8, 0.6, 0.4):
        kept, gaps, clipped, posture = [], [], [], []
        for _, session, tick in at_states(ground, paper_stack(), "nullspace", count, SEED + 3):
            problem, tau = session.problem.copy(), tick.command
            limit = np.full(12, share * largest(tau))
            bounds = hqp.Rows(hqp.Selection(np.arange(12)), -limit, limit)
            bounded = hqp.Hierarchy((bounds, *problem.levels), constraints=1, metric=problem.metric)
            solution = hqp.solvers.load("lexicographic").solve(bounded)
            residuals = bounded.slacks(solution.x)
            kept += [largest(residuals[0]), largest(residuals[1]), largest(residuals[2])]
            gaps.append(max(hqp.certificate(bounded, solution.x).gaps))
            posture.append(largest(residuals[3]))
            clipped.append(largest(bounded.slacks(np.clip(tau, -limit, limit))[1]))
        text = f"torques bounded to {share} of the projector's: limits, com and hand kept [m/s^2]"
        yield at_most("S beyond", text, label, 1e-8, kept, f"posture gives way by {np.median(posture):.3g} rad/s^2")
        yield at_most("S beyond", f"the same, gap of the certificate, {share}", label, 1e-6, gaps)
        yield seen_to_fail("S beyond", f"projector clipped at {share}: com off by [m/s^2]", label, 1e-8, clipped)


def _friction(ground: Ground) -> Iterator[Check]:
    """Standing, in the world, with a friction coefficient below the slope's tangent."""
    if ground.degrees == 0.0:
        return
    label = ground.label
    mu = 0.1
    com = Com(axes="xy", subtree="torso_yaw", law=PD(400.0, 40.0), name="com")
    hand = Position(frame="hand", law=PD(30.0, 11.0))
    limits = [
        *(FrictionCone(contact=w, mu=mu) for w in WHEELS),
        *(UnilateralContact(contact=w) for w in WHEELS),
        TorqueLimits(),
    ]
    slipping, kept, residuals = [], [], []
    for s in ground.states(5, SEED + 4, speed=1e-9):
        loads = []
        for extra, solver in (((), "nullspace"), (limits, "lexicographic")):
            stack = paper_stack(extra, com=com, hand=hand)
            session = hqp.Controller(
                stack, hqp.Torque(loop_law=EXACT), solver=solver, price=0, deadline=math.inf
            ).session(ground.robot, dt=0.001)
            state = ground.robot.state(s.q, s.v)
            goals = [task.at(task.value(state)) for task in (com, hand, POSTURE)]
            state = ground.robot.state(s.q, s.v)
            tick = session.step(state, *(w.at(normal=ground.normal) for w in CONTACTS), *goals)
            forces = _program(session).contact_forces(tick.command)
            excess = [abs(forces[w][0]) - mu * forces[w][1] for w in WHEELS]
            loads.append((max(excess), min(forces[w][1] for w in WHEELS)))
            if tick.solution is not None and solver == "lexicographic":
                residuals += [largest(w) for w in tick.solution.residuals[:-1]]
        slipping.append(loads[0][0])
        kept += [loads[1][0], -loads[1][1]]
    text = f"standing, mu = {mu}: projector needs more friction than there is, by [N]"
    yield seen_to_fail("S beyond", text, label, 1e-2, slipping)
    yield at_most("S beyond", "the same with FrictionCone and UnilateralContact: excess [N]", label, 1e-6, kept)
    yield at_most("S beyond", "the same: limits, com and hand kept [m/s^2]", label, 1e-6, residuals)


class _AlongTheAxle(OmniWheelContact):
    """Rolling direction along the wheel axis, as the print words it; the library must refuse it."""

    _picked = (1, 2)


def _refusal(ground: Ground) -> Iterator[Check]:
    refused = 0
    wrong = [_AlongTheAxle(wheel=w) for w in WHEELS]
    try:
        hqp.Controller(paper_stack(contacts=wrong), hqp.Torque(loop_law=EXACT), price=0, deadline=math.inf).session(
            ground.robot, dt=0.001
        )
    except DeclarationError as error:
        refused = int("rank [J_constr; U] = 18 of 19" in str(error))
    text = "rolling rows along the axle: stack refused, naming rank 18 of 19"
    yield at_most("S(12) erratum 3", text, ground.label, 0.0, [float(1 - refused)])
