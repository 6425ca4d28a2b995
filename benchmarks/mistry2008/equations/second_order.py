"""Eqs. (18) to (22): accelerations, semi-implicit integration, measured velocities made consistent."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

import hqp
from benchmarks.mistry2008.equations.algebra import largest, projector, skew
from benchmarks.mistry2008.equations.levels import Evaluated, paper_levels, states
from benchmarks.reports.checks import CONTROL, Check, at_most, seen_to_fail
from hqp import PD, Level, Stack
from hqp.arrays import Vec
from hqp.floating_base import consistent_velocity
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, Orientation, Position, Posture
from tests.scenes.mistry2008 import roles

SEED = 18

STEP = 1e-6
"""Step of the central differences [s]."""

FEEDFORWARD_ONLY = PD(0.0, 0.0)


def checks(robot: Robot, count: int) -> Iterator[Check]:
    """Every row on one robot at ``count`` random states."""
    yield from _drift(robot, count)
    yield from _accelerations(robot, count)
    yield from _energy(robot)
    yield from _filtered(robot, count)


def _drift(robot: Robot, count: int) -> Iterator[Check]:
    """dJ/dt v against differences of J v along v; M11: in world-axes base velocities it is another vector."""
    frames = roles(robot)
    library = Evaluated(
        robot,
        [
            FixedContact(frame=frames.left),
            Com(name="com"),
            Position(frame=frames.hand),
            Orientation(frame=frames.base, name="R"),
        ],
        order=2,
    )
    own, world = [], []
    for q, v in states(robot, count, SEED):
        library.at(q, v)
        drift = np.concatenate(library.drift())
        ahead, behind = (
            np.concatenate([J @ v for J in library.at(robot.integrate(q, s * v, STEP), v)]) for s in (1.0, -1.0)
        )
        own.append(largest(drift - (ahead - behind) / (2.0 * STEP)))
        # world axes: the base's linear velocity is constant in them, dv_b/dt = -omega x v_b in base axes
        R = _base_rotation(robot, q)
        turned = []
        for s in (1.0, -1.0):
            there = robot.integrate(q, s * v, STEP)
            nu = v.copy()
            nu[:3] = _base_rotation(robot, there).T @ R @ v[:3]
            turned.append(np.concatenate([J @ nu for J in library.at(there, nu)]))
        slope = (turned[0] - turned[1]) / (2.0 * STEP)
        world.append(largest(drift - slope))
        J = np.concatenate(library.at(q, v))
        own.append(largest(drift - J[:, :3] @ skew(v[3:6]) @ v[:3] - slope))
    name = robot.name
    yield at_most("M(18)", "dJ/dt qd against differences, base velocity in base or world axes", name, 1e-6, own)
    note = "erratum M11: the base's own axes turn"
    yield seen_to_fail("M(18)", "base-axes drift used with world-axes base velocities", name, 1e-6, world, note)


def _base_rotation(robot: Robot, q: Vec) -> Vec:
    robot.state(q).kinematics()
    return np.array(robot.data.oMi[1].rotation)


def _accelerations(robot: Robot, count: int) -> Iterator[Check]:
    """Eq. (18) through Acceleration and `chiaverini`; the accelerations come back by forward kinematics."""
    frames = roles(robot)
    com, hand = Com(axes="xy", name="com_xy"), Position(frame=frames.hand, name="hand")
    stack = Stack(
        Level(FixedContact(frame=frames.left), FixedContact(frame=frames.right), com, name="critical"),
        Level(hand, name="functional"),
        Level(Orientation(frame=frames.base, name="base"), Com(axes="z", name="com_z"), name="extraneous"),
    )
    stack = stack.with_laws({element.name: FEEDFORWARD_ONLY for element in stack})
    rng = np.random.default_rng([SEED, 1])
    sessions = {
        name: hqp.Controller(stack, hqp.Acceleration(), solver=name, price=0, deadline=math.inf).session(
            robot, dt=0.002
        )
        for name in ("chiaverini", "nullspace")
    }
    rows, feet, centre, hands = [], [], [], []
    data = robot.model.createData()
    for q, v in states(robot, count, SEED + 1):
        goal, reach = rng.standard_normal(2), rng.standard_normal(3)
        for solver, session in sessions.items():
            tick = session.step(robot.state(q, v), com.at(acceleration=goal), hand.at(acceleration=reach))
            qdd = tick.solution.x
            problem = session.problem
            rows.append(largest(problem.levels[0].dense(robot.nv) @ qdd - problem.levels[0].lower))
            pin.forwardKinematics(robot.model, data, q, v, qdd)
            pin.updateFramePlacements(robot.model, data)
            for frame in (frames.left, frames.right):
                motion = pin.getFrameClassicalAcceleration(
                    robot.model, data, robot.frame(frame), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
                )
                feet.append(largest(motion.vector))
            if solver == "nullspace":
                motion = pin.getFrameClassicalAcceleration(
                    robot.model, data, robot.frame(frames.hand), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
                )
                hands.append(largest(motion.linear - reach))
            pin.centerOfMass(robot.model, data, q, v, qdd)
            centre.append(largest(data.acom[0][:2] - goal))
    name = robot.name
    yield at_most("M(18)", "J_A qdd + dJ_A/dt qd = xdd_A", name, 1e-10, rows)
    yield at_most("M(18)", "acceleration of both feet by forward kinematics = 0", name, 1e-10, feet)
    yield at_most("M(18)", "acceleration of the CoM over the ground by forward kinematics", name, 1e-10, centre)
    yield at_most("M(18)", "hand acceleration by forward kinematics (nullspace)", name, 1e-10, hands)


def _energy(robot: Robot) -> Iterator[Check]:
    """Eqs. (21), (22) undamped: with qd^t energy stays, with the old qd (explicit) it grows as exp(kp dt T), M10."""
    kp, seconds = 100.0, 5.0
    posture = Posture(law=PD(kp, 0.0))
    joints = robot.joints(None)
    name = robot.name
    for dt in (0.002, 0.010):
        session = hqp.Controller(
            Stack(Level(posture)), hqp.Acceleration(), solver="nullspace", price=0, deadline=math.inf
        ).session(robot, dt)
        q, v = robot.home, np.zeros(robot.nv)
        session.step(robot.state(q, v))
        v[joints] = 0.1 * np.random.default_rng(SEED).standard_normal(joints.size)
        start, kept = v @ v, []
        old_q, old_v = np.zeros(joints.size), v[joints]
        for _ in range(round(seconds / dt)):
            q, v = session.step(robot.state(q, v)).advance()
            e = robot.difference(robot.home, q)
            kept.append((v @ v + kp * (e @ e)) / start)
            old_q, old_v = old_q + dt * old_v, old_v - dt * kp * old_q
        explicit = (old_v @ old_v + kp * (old_q @ old_q)) / start
        swing = np.sqrt(kp) * dt  # a symplectic Euler step's energy swings by about half of omega dt
        text = f"energy excess within omega dt, dt {1e3 * dt:g} ms, 5 s, kp 100"
        yield at_most("M(21),(22)", text, name, swing, [max(kept) - 1.0])
        growth = float(explicit) - 1.0
        note = f"negative control: must exceed 1; erratum M10, exp(kp dt T) = {np.exp(kp * dt * seconds):.3g}"
        text = f"the same with the old qd in (22), dt {1e3 * dt:g} ms"
        yield Check("M(21),(22)", text, name, swing, growth, growth > 1.0, note, CONTROL)


def _filtered(robot: Robot, count: int) -> Iterator[Check]:
    """Below eq. (22): a measured velocity through N_C keeps the CoM's motion, through N_A it does not (M9)."""
    rng = np.random.default_rng([SEED, 22])
    still, kept, erased = [], [], []
    for levels in paper_levels(robot, count, SEED + 2):
        v = rng.standard_normal(robot.nv)
        filtered = consistent_velocity(levels.J_C, v)
        still.append(largest(levels.J_C @ filtered))
        J_com = levels.J_A[12:]
        moving = projector(levels.J_C) @ v
        kept.append(largest(J_com @ (consistent_velocity(levels.J_C, moving) - moving)))
        erased.append(largest(J_com @ (consistent_velocity(levels.J_A, moving) - moving)))
    name = robot.name
    yield at_most("M after (22)", "J_C N_C nu = 0", name, 1e-11, still)
    yield at_most("M after (22)", "N_C keeps the CoM velocity of a consistent nu", name, 1e-11, kept)
    yield seen_to_fail("M after (22)", "N_A keeps it", name, 1e-11, erased, "erratum M9")
