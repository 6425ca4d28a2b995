"""Eqs. (2) to (6) and (14): the Jacobians of a floating base, and the printed base blocks that must fail."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from benchmarks.mistry2008.equations.algebra import largest, rates_to_angular, rotation_vector, rpy, skew
from benchmarks.mistry2008.equations.levels import Evaluated, states
from benchmarks.reports.checks import Check, at_most, seen_to_fail
from hqp.arrays import Mat, Vec
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, Orientation, Position
from tests.scenes.mistry2008 import roles

STEP = 1e-6
"""Step of the central differences [m, rad]."""

SEED = 2008


def checks(robot: Robot, count: int) -> Iterator[Check]:
    """Every row on one robot at ``count`` random states."""
    yield from _geometric(robot, count)
    yield from _base_blocks(robot, count)
    yield from _centre_of_mass(robot, count)
    yield from _roll_pitch_yaw(robot, count)


def _geometric(robot: Robot, count: int) -> Iterator[Check]:
    frames = roles(robot)
    named = (frames.left, frames.right, frames.hand, frames.base)
    library = Evaluated(
        robot,
        [
            *(Position(frame=f, name=f"p {f}") for f in named),
            *(Orientation(frame=f, name=f"R {f}") for f in named),
            FixedContact(frame=frames.left),
            Com(name="com"),
        ],
    )
    errors = []
    for q, _ in states(robot, count, SEED):
        J = library.at(q)
        position, rotation = _differences(robot, q, named)
        errors += [largest(J[i] - position[i]) for i in range(len(named))]
        errors += [largest(J[len(named) + i] - rotation[i]) for i in range(len(named))]
        errors.append(largest(J[-2] - np.concatenate((position[0], rotation[0]))))
        errors.append(largest(J[-1] - position[-1]))
    text = "J of soles, palm, base, contact, CoM against central differences, every column"
    yield at_most("M(2)", text, robot.name, 1e-7, errors)


def _differences(robot: Robot, q: Vec, named: tuple[str, ...]) -> tuple[list[Mat], list[Mat]]:
    """Positions (the CoM's last) and rotations of frames differentiated along every tangent coordinate."""
    position = [np.zeros((3, robot.nv)) for _ in (*named, "com")]
    rotation = [np.zeros((3, robot.nv)) for _ in named]
    for j in range(robot.nv):
        step = np.zeros(robot.nv)
        step[j] = STEP
        seen = []
        for sign in (1.0, -1.0):
            state = robot.state(robot.integrate(q, sign * step, 1.0))
            seen.append((
                [*(state.position(f) for f in named), state.com()], [state.rotation(f) for f in named]
            ))  # fmt: skip
        (p_plus, R_plus), (p_minus, R_minus) = seen
        for i in range(len(position)):
            position[i][:, j] = (p_plus[i] - p_minus[i]) / (2.0 * STEP)
        for i in range(len(named)):
            rotation[i][:, j] = rotation_vector(R_plus[i] @ R_minus[i].T) / (2.0 * STEP)
    return position, rotation


def _base_blocks(robot: Robot, count: int) -> Iterator[Check]:
    """J^xb in both readings of M1.  Pinocchio's free flyer moves in base axes: columns are turned by R_b first."""
    frames = roles(robot)
    library = Evaluated(
        robot,
        [Position(frame=frames.hand, name="p"), Orientation(frame=frames.hand, name="R"), Com(name="com")],
    )
    root = robot.model.frames[robot.model.getFrameId(robot.model.names[1])].name
    errors: dict[str, list[float]] = {key: [] for key in ("base", "world", "I", "mixed", "order", "com", "com3", "J_b")}
    for q, _ in states(robot, count, SEED):
        p, R, com = library.at(q)
        state = robot.state(q)
        R_b, x_b = _root(q)
        blocks = np.concatenate((p[:, :6], R[:, :6]))
        r = state.position(frames.hand) - x_b
        c = state.com() - x_b
        in_base = blocks @ np.block([[R_b.T, np.zeros((3, 3))], [np.zeros((3, 3)), np.eye(3)]])
        in_world = blocks @ np.block([[R_b.T, np.zeros((3, 3))], [np.zeros((3, 3)), R_b.T]])
        columnwise = np.cross(R_b.T, r).T  # column i: R_b e_i x r
        zero, one = np.zeros((3, 3)), np.eye(3)
        errors["base"].append(largest(in_base - np.block([[one, columnwise], [zero, R_b]])))
        errors["world"].append(largest(in_world - np.block([[one, -skew(r)], [zero, one]])))
        errors["I"].append(largest(in_base - np.block([[one, columnwise], [zero, one]])))
        errors["mixed"].append(largest(in_world - np.block([[one, columnwise], [zero, one]])))
        errors["order"].append(largest(in_base[:3, 3:] - np.cross(r, R_b.T).T))
        in_base_com = com[:, :6] @ np.block([[R_b.T, zero], [zero, one]])
        errors["com"].append(largest(in_base_com - np.block([one, np.cross(R_b.T, c).T])))
        in_world_com = com[:, :6] @ np.block([[R_b.T, zero], [zero, R_b.T]])
        errors["com"].append(largest(in_world_com - np.block([one, -skew(c)])))
        errors["com3"].append(largest(in_world_com[:, 3:] - np.cross(R_b.T, c).T))
        J_b = robot.state(q).jacobian(root)
        turned = np.kron(np.eye(2), R_b.T) @ J_b
        errors["J_b"].append(largest(turned - np.eye(6, robot.nv)))
    name = robot.name
    yield at_most("M(3)", "base block [I, R_b x r; 0, R_b], base-axes angular velocity", name, 1e-12, errors["base"])
    yield at_most("M(3)", "base block [I, -[r]x; 0, I], world-axes angular velocity", name, 1e-12, errors["world"])
    yield seen_to_fail("M(3)", "printed block, base axes: lower right I", name, 1e-12, errors["I"], "erratum M1")
    yield seen_to_fail("M(3)", "printed block, world axes: top right", name, 1e-12, errors["mixed"], "erratum M1")
    yield seen_to_fail("M(3)", "opposite order r x R_b", name, 1e-12, errors["order"], "erratum M1")
    yield at_most("M(4)", "J_b = [0 I] (base twist in its own axes)", name, 1e-12, errors["J_b"])
    yield at_most("M(5)", "base block of J_cog in both axes", name, 1e-12, errors["com"])
    yield seen_to_fail("M(5)", "printed block with world axes", name, 1e-12, errors["com3"], "erratum M2")


def _root(q: Vec) -> tuple[Mat, Vec]:
    """Rotation and position of the free base from its quaternion xyzw, by the textbook formula."""
    x, y, z, w = q[3:7]
    vector = np.array([x, y, z])
    R = (w * w - vector @ vector) * np.eye(3) + 2.0 * np.outer(vector, vector) + 2.0 * w * skew(vector)
    return R, q[:3].copy()


def _centre_of_mass(robot: Robot, count: int) -> Iterator[Check]:
    """Eq. (6) from the links' own Jacobians; the base link moves nothing in dx/dq_r but weighs (M12)."""
    library = Evaluated(robot, [Com(name="com")])
    model, data = robot.model, robot.model.createData()
    right, wrong = [], []
    for q, _ in states(robot, count, SEED):
        (J,) = library.at(q)
        pin.computeJointJacobians(model, data, q)
        total, mass = np.zeros((3, robot.nv)), 0.0
        for i in range(1, model.njoints):
            inertia = model.inertias[i]
            J_i = pin.getJointJacobian(model, data, i, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            arm = data.oMi[i].rotation @ inertia.lever
            total += inertia.mass * (J_i[:3] - skew(arm) @ J_i[3:])
            mass += inertia.mass
        right.append(largest(J - total / mass))
        wrong.append(largest((J - total / (mass - model.inertias[1].mass))[:, 6:]))
    name = robot.name
    yield at_most("M(6)", "mass-weighted average of the links' Jacobians = J_cog", name, 1e-12, right)
    yield seen_to_fail("M(6)", "base link left out of the denominator", name, 1e-12, wrong, "erratum M12")


def _roll_pitch_yaw(robot: Robot, count: int) -> Iterator[Check]:
    """Eq. (14): the rows of J_rpy are rates of angles, E^-1 J_omega, not the angular velocity (M3)."""
    base = roles(robot).base
    library = Evaluated(
        robot, [Orientation(frame=base, axes=("roll", "pitch", "yaw"), name="rpy"), Orientation(frame=base, name="R")]
    )
    differences, closed, geometric = [], [], []
    for q, v in states(robot, count, SEED):
        J, J_omega = library.at(q)
        state = robot.state(q)
        angles = rpy(state.rotation(base))
        if abs(np.cos(angles[1])) < 0.2:
            continue  # eq. (14) is singular at pitch 90 deg
        E = rates_to_angular(angles)
        closed.append(largest(E @ J - J_omega))
        slopes = np.zeros((3, robot.nv))
        for j in range(robot.nv):
            step = np.zeros(robot.nv)
            step[j] = STEP
            plus, minus = (
                rpy(robot.state(robot.integrate(q, sign * step, 1.0)).rotation(base)) for sign in (1.0, -1.0)
            )
            turn = plus - minus
            slopes[:, j] = (turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))) / (2.0 * STEP)
        differences.append(largest(J - slopes))
        geometric.append(largest((J_omega - slopes) @ v))
    name = robot.name
    yield at_most("M(14)", "J_rpy against central differences of the angles", name, 1e-6, differences)
    yield at_most("M(14)", "E(rpy) J_rpy = J_omega", name, 1e-11, closed)
    yield seen_to_fail("M(14)", "angular velocity taken for rates of rpy", name, 1e-6, geometric, "erratum M3")
