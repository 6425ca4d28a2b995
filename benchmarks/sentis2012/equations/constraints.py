"""Eqs. (2) to (15), (21), (22): the library's constrained dynamics against definitions, differences, a KKT solve."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from benchmarks.reports.checks import Check, at_most, exactly, seen_to_fail
from benchmarks.sentis2012.equations.ground import WHEELS, Ground, Snapshot, largest, relative, skew
from hqp.arrays import Mat, Vec
from hqp.torque.dynamics import ConstrainedDynamics
from hqp.torque.reactions import actuation

SEED = 2012
STEP = 1e-6


def dynamics(s: Snapshot) -> ConstrainedDynamics:
    """The library's constrained dynamics at a snapshot."""
    found = ConstrainedDynamics(s.A.shape[0], s.J.shape[0], s.ground.robot.actuation)
    found.update(s.A, s.bias, s.J, -s.dJ @ s.v)
    return found


@dataclass(frozen=True)
class Reduced:
    """Eqs. (3), (4), (14), (15), (22) by their definitions, from a snapshot."""

    phi: Mat
    h: Vec
    g: Vec

    @staticmethod
    def of(s: Snapshot) -> Reduced:
        """phi*, b* + g* and g*."""
        inverse = np.linalg.inv(s.A)
        Lambda = np.linalg.inv(s.J @ inverse @ s.J.T)
        N = np.eye(s.A.shape[0]) - inverse @ s.J.T @ Lambda @ s.J
        UN = s.ground.U @ N
        phi = UN @ inverse @ UN.T
        phi = 0.5 * (phi + phi.T)
        moving = s.ground.U @ inverse @ (N.T @ s.bias + s.J.T @ Lambda @ (s.dJ @ s.v))
        resting = s.ground.U @ inverse @ (N.T @ s.gravity)
        return Reduced(phi, np.linalg.solve(phi, moving), np.linalg.solve(phi, resting))


def checks(ground: Ground, count: int) -> Iterator[Check]:
    """Every row on one slope at ``count`` random states."""
    yield from _equation_of_motion(ground, count)
    yield from _ranks(ground, count)
    yield from _wheels(ground, count)
    yield from _forces(ground, count)
    yield from _projectors(ground, count)
    yield from _actuated(ground, count)
    yield from _static(ground, max(count // 10, 3))


def _equation_of_motion(ground: Ground, count: int) -> Iterator[Check]:
    errors = []
    for s in ground.free_states(count, SEED):
        qdd = s.rng.normal(size=s.v.size)
        errors.append(largest(s.A @ qdd + s.bias - pin.rnea(s.model, s.model.createData(), s.q, s.v, qdd)))
    yield at_most("S(2)", "A qdd + b + g = inverse dynamics", ground.label, 1e-9, errors)


def _ranks(ground: Ground, count: int) -> Iterator[Check]:
    robot, label = ground.robot, ground.label
    U = ground.U
    motors = [*robot.groups["wheels"], "torso_yaw", "torso_hip", *robot.groups["arm"]]
    expected = np.eye(19)[robot.joints(sorted(motors, key=robot.joint_names.index))]
    yield at_most("S(6) erratum 1", "U: wheels, yaw, hip and arm, 12 by 19", label, 0.0, [largest(U - expected)])
    good, whole, least, axle, nearly, coupled = [], [], [], [], [], []
    hip, thorax = robot.joints(["torso_hip", "torso_thorax"])
    for s in ground.states(count, SEED):
        found = actuation(s.J, robot.actuation)
        good.append(found.rank)
        whole.append(found.full_rank)
        least.append(found.full_smallest)
        axle.append(actuation(_along_the_axle(s), robot.actuation))
        parallel = {w: np.array([1.0, 1e-9 * i, 0.0]) for i, w in enumerate(WHEELS)}
        nearly.append(actuation(s.assemble(parallel)[0], robot.actuation))
        N = dynamics(s).N_constr
        coupled.append(largest(N[hip] - N[thorax]))
    yield exactly("S(5)", "rank J_constr", label, 7, good)
    text = f"least singular value {min(least):.3f}"
    yield exactly("S(12)", "rank [J_constr; U]", label, 19, whole, text)
    yield exactly("S(10) erratum 3", "u along the axle: rank J_constr", label, 6, [a.rank for a in axle])
    yield exactly("S(10) erratum 3", "u along the axle: rank [J_constr; U]", label, 18, [a.full_rank for a in axle])
    yield exactly("S(12) erratum 5", "parallel axles: as many rows, rank J_constr", label, 7, [a.rank for a in nearly])
    yield exactly("S(12) erratum 5", "parallel axles: rank [J_constr; U]", label, 18, [a.full_rank for a in nearly])
    yield at_most("S(6)", "hip or thorax in U: U N_constr the same", label, 1e-10, coupled)


def _along_the_axle(s: Snapshot) -> np.ndarray:
    """J_constr with the rolling direction read as the direction of the wheel axis."""
    J = s.J.copy()
    _, R, _, _ = s.frame("base")
    for i, wheel in enumerate(WHEELS):
        about = s.ground.robot.wheels[wheel]
        _, _, J_wheel, _ = s.frame(wheel)
        contact = J_wheel[:3] - skew(-about.radius * s.ground.normal) @ J_wheel[3:]
        J[1 + 2 * i] = R @ np.array(about.axle) @ contact
    return J


def _wheels(ground: Ground, count: int) -> Iterator[Check]:
    """The contact point is moved by hand: velocities of wheel centre and wheel from differences of placements."""
    label = ground.label
    errors, swapped, normals, rates, ranks = [], [], [], [], []
    for s in ground.free_states(count, SEED + 1):
        ahead, behind = s.at(s.v, STEP), s.at(s.v, -STEP)
        rates.append(largest((ahead.J - behind.J) / (2.0 * STEP) - s.dJ))
        printed = s.J.copy()
        for i, wheel in enumerate(WHEELS):
            about = ground.robot.wheels[wheel]
            u = _rolling_direction(s, wheel)
            (p, Ra, _, _), (m, Rm, _, _) = ahead.frame(wheel), behind.frame(wheel)
            turn = pin.log3(Ra @ Rm.T) / (2.0 * STEP)
            delta = -about.radius * ground.normal
            velocity = (p - m) / (2.0 * STEP) + np.cross(turn, delta)
            rows = s.J[1 + 2 * i : 3 + 2 * i]
            errors.append(largest(rows @ s.v - np.array([u, ground.normal]) @ velocity))
            _, _, J, _ = s.frame(wheel)
            normals.append(largest(ground.normal @ J[:3] - rows[1]))
            printed[1 + 2 * i] = u @ (J[3:] - skew(delta) @ J[:3])
            swapped.append(abs(float(printed[1 + 2 * i] @ s.v - u @ velocity)))
        ranks.append(actuation(printed, ground.robot.actuation).full_rank)
    yield at_most("S(9),(10)", "contact point velocity vs differences", label, 1e-7, errors)
    yield seen_to_fail("S(10) erratum 2", "J_w - delta x J_v as printed vs differences", label, 1e-7, swapped)
    yield exactly("S(10) erratum 2", "as printed: rank [J_constr; U]", label, 18, ranks)
    yield at_most("S(11) erratum 4", "u_n^T J_v: centre and contact point alike", label, 1e-10, normals)
    yield at_most("S(3)", "dJ_constr/dt vs differences, any velocity", label, 1e-6, rates)


def _rolling_direction(s: Snapshot, wheel: str) -> Vec:
    _, R, _, _ = s.frame("base")
    u = np.cross(s.ground.normal, R @ np.array(s.ground.robot.wheels[wheel].axle))
    return np.asarray(u / np.linalg.norm(u))


def _forces(ground: Ground, count: int) -> Iterator[Check]:
    forces, motion, constraint, kkt, dropped = [], [], [], [], []
    for s in ground.free_states(count, SEED + 2):
        d = dynamics(s)
        tau = 20.0 * s.rng.normal(size=d.n)
        qdd, lam = d.acceleration(tau), d.forces(tau)
        true_qdd, true_lam = s.kkt(tau)
        F, f = d.force_map()
        forces += [relative(lam - true_lam, true_lam), relative(F @ tau + f - true_lam, true_lam)]
        kkt.append(relative(qdd - true_qdd, true_qdd))
        right = ground.U.T @ tau
        motion.append(relative(s.A @ qdd + s.bias + s.J.T @ lam - right, s.bias))
        constraint.append(relative(s.J @ qdd + s.dJ @ s.v, s.dJ @ s.v))
        d.update(s.A, s.bias, s.J, np.zeros(s.J.shape[0]))
        dropped.append(largest(s.J @ d.acceleration(tau) + s.dJ @ s.v))
    label = ground.label
    yield at_most("S(3)", "lambda vs KKT, relative", label, 1e-9, forces)
    yield at_most("S(4)", "qdd vs KKT, relative", label, 1e-9, kkt)
    yield at_most("S(4)", "residual of the equation of motion, relative", label, 1e-9, motion)
    yield at_most("S(4)", "J qdd + dJ/dt qd, relative, any velocity", label, 1e-9, constraint)
    yield seen_to_fail("S(4)", "drift left out, any velocity", label, 1e-9, dropped)


def _projectors(ground: Ground, count: int) -> Iterator[Check]:
    errors, symmetric, inverse = [], [], []
    for s in ground.states(count, SEED):
        d = dynamics(s)
        N, J, Jbar = d.N_constr, s.J, d.Jbar_constr
        errors += [largest(N @ N - N), largest(J @ N), largest(N @ Jbar)]
        inverse.append(largest(J @ Jbar - np.eye(7)))
        NA = N @ np.linalg.inv(s.A)
        symmetric.append(relative(NA - NA.T, NA))
    text = "N^2 = N, J N = 0, N Jbar = 0"
    yield at_most("S(4)", text, ground.label, 1e-10, errors)
    yield at_most("S(4)", "J Jbar = I", ground.label, 1e-10, inverse)
    yield at_most("S(4)", "N A^-1 symmetric, relative", ground.label, 1e-10, symmetric)


def _actuated(ground: Ground, count: int) -> Iterator[Check]:
    velocity, identity, inverse, inertia, base, kkt, definition = [], [], [], [], [], [], []
    U, label = ground.U, ground.label
    for s in ground.states(count, SEED):
        d = dynamics(s)
        UNbar, phi = d.UNbar, d.phi
        velocity.append(largest(UNbar @ s.q_act - s.v))
        identity += [largest(d.UN @ UNbar - np.eye(12)), largest(U @ UNbar - np.eye(12)), largest(s.J @ UNbar)]
        inverse.append(largest(UNbar - s.UNbar))
        inertia.append(relative(np.linalg.inv(phi) - UNbar.T @ s.A @ UNbar, UNbar.T @ s.A @ UNbar))
        T = np.eye(19)
        T[:6, :6] = s.rng.normal(size=(6, 6))
        moved = ConstrainedDynamics(19, 7, ground.robot.actuation)
        moved.update(T.T @ s.A @ T, T.T @ s.bias, s.J @ T, -s.dJ @ s.v)
        base.append(relative(moved.phi - phi, phi))
        tau = 20.0 * s.rng.normal(size=12)
        true = U @ s.kkt(tau)[0]
        kkt.append(relative(phi @ (tau - d.h) - true, true))
        definition += [relative(Reduced.of(s).phi - phi, phi), relative(Reduced.of(s).h - d.h, d.h)]
    yield at_most("S(13)", "UNbar q_act = qd on Null(J)", label, 1e-10, velocity)
    yield at_most("S(14)", "U N UNbar = U UNbar = I, J UNbar = 0", label, 1e-9, identity)
    yield at_most("S(14)", "UNbar = [J; U]^-1 [0; I]", label, 1e-9, inverse)
    yield at_most("S(15)", "phi*^-1 = UNbar^T A UNbar, relative", label, 1e-10, inertia)
    yield at_most("S(15)", "phi* in other base velocities, relative", label, 1e-10, base)
    yield at_most("S(15),(22)", "phi* and b* + g* vs their definitions, relative", label, 1e-9, definition)
    yield at_most("S(21),(22)", "qdd_act = phi* (tau - b* - g*) vs KKT, relative", label, 1e-9, kkt)


def _static(ground: Ground, count: int) -> Iterator[Check]:
    weight = ground.robot.mass * 9.81
    up = np.array([0.0, 0.0, 1.0])
    normal, vector = [], []
    for moving in ground.states(count, SEED):
        s = Snapshot(ground, moving.q, 0.0 * moving.v)
        d = dynamics(s)
        lam = d.forces(d.h)
        force = sum(
            -lam[1 + 2 * i] * _rolling_direction(s, w) - lam[2 + 2 * i] * ground.normal for i, w in enumerate(WHEELS)
        )
        normal.append(abs(-lam[2::2].sum() - weight * float(ground.normal @ up)))
        vector.append(largest(force - weight * up))
    yield at_most("S(3)", "at rest: sum of normal forces = M g cos(slope) [N]", ground.label, 1e-8, normal)
    yield at_most("S(3)", "at rest: all contact forces = M g upward [N]", ground.label, 1e-8, vector)
