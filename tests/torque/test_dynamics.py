"""Constrained dynamics on any robot, with independent and with dependent constraints, against a KKT solve."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp.arrays import Mat, Vec
from hqp.errors import ModelError
from hqp.robots import Robot
from hqp.torque.dynamics import ConstrainedDynamics, symmetric_pinv
from hqp.torque.reactions import actuation

CORNERS = ((0.1, 0.05, 0.0), (0.1, -0.05, 0.0), (-0.1, 0.05, 0.0), (-0.1, -0.05, 0.0))


def corner_rows(robot: Robot, q: Vec, v: Vec) -> tuple[Mat, Vec]:
    """Four points of each sole: 24 rows of rank 12, and a feasible right-hand side."""
    state = robot.state(q, v)
    rows, drifts = [], []
    for foot in robot.landmarks["soles"]:
        J, drift, R = state.jacobian(foot), state.drift(foot), state.rotation(foot)
        omega = J[3:] @ v
        for corner in CORNERS:
            d = R @ np.array(corner)
            cross = np.cross(np.eye(3), d)  # rows e_i x d: omega x d = cross' omega
            rows.append(J[:3] + cross.T @ J[3:])
            drifts.append(drift[:3] + np.cross(drift[3:], d) + np.cross(omega, np.cross(omega, d)))
    return np.vstack(rows), -np.concatenate(drifts)


def kkt(A: Mat, bias: Vec, J: Mat, gamma: Vec, effort: Vec) -> tuple[Vec, Vec]:
    """qdd and J^T lambda of the whole system by least squares."""
    nv, m = A.shape[0], J.shape[0]
    system = np.block([[A, J.T], [J, np.zeros((m, m))]])
    z = np.linalg.lstsq(system, np.concatenate((effort - bias, gamma)), rcond=1e-12)[0]
    return z[:nv], J.T @ z[nv:]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("points", [False, True])
def test_motion_and_forces_are_those_of_the_whole_system(humanoid: Robot, seed: int, points: bool) -> None:
    rng = np.random.default_rng(seed)
    q, v = humanoid.random_configuration(rng, 0.3), rng.normal(size=humanoid.nv)
    state = humanoid.state(q, v)
    A, bias = state.mass_matrix().copy(), state.bias_force().copy()
    if points:
        J, gamma = corner_rows(humanoid, q, v)
    else:
        J = np.vstack([state.jacobian(f) for f in humanoid.landmarks["soles"]])
        gamma = -np.concatenate([state.drift(f) for f in humanoid.landmarks["soles"]])
    tau = 30.0 * rng.normal(size=humanoid.actuated.size)
    d = ConstrainedDynamics(humanoid.nv, J.shape[0], humanoid.actuation)
    d.update(np.triu(A), bias, J, gamma)
    qdd, force = kkt(A, bias, J, gamma, humanoid.actuation.T @ tau)
    assert d.rank == 12
    assert np.abs(d.acceleration(tau) - qdd).max() < 1e-9 * np.abs(qdd).max()
    assert np.abs(J.T @ d.forces(tau) - force).max() < 1e-9 * np.abs(force).max()
    F, f = d.force_map()
    assert np.abs(F @ tau + f - d.forces(tau)).max() < 1e-8
    # least norm among the forces that give this motion
    assert np.abs(d.forces(tau) - np.linalg.pinv(J.T) @ force).max() < 1e-7 * np.abs(force).max()
    N = d.N_constr
    assert np.abs(N @ N - N).max() < 1e-9
    assert np.abs(J @ N).max() < 1e-9
    assert np.abs(d.X - np.linalg.solve(A, (humanoid.actuation @ N).T)).max() < 1e-9 * np.abs(d.X).max()


def test_without_constraints_it_is_the_free_robot(humanoid: Robot) -> None:
    state = humanoid.state(humanoid.home, 0.1 * np.ones(humanoid.nv))
    A, bias = state.mass_matrix().copy(), state.bias_force().copy()
    d = ConstrainedDynamics(humanoid.nv, 0, humanoid.actuation)
    d.update(A, bias, np.zeros((0, humanoid.nv)), np.zeros(0))
    tau = np.ones(humanoid.actuated.size)
    expected = np.linalg.solve(A, humanoid.actuation.T @ tau - bias)
    assert np.abs(d.acceleration(tau) - expected).max() < 1e-9 * np.abs(expected).max()
    assert d.forces(tau).shape == (0,)


def test_an_inertia_that_is_not_positive_definite_is_an_error() -> None:
    d = ConstrainedDynamics(3, 1, np.eye(3)[1:])
    with pytest.raises(ModelError, match="not positive definite"):
        d.update(np.diag([1.0, -1.0, 1.0]), np.zeros(3), np.ones((1, 3)), np.zeros(1))


def test_actuation_tells_ranks_and_conditioning() -> None:
    U = np.eye(4)[2:]
    good = actuation(np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 1e-3, 0.0, 1.0]]), U)
    assert (good.rank, good.full_rank, good.complete) == (2, 4, True)
    assert 1e-4 < good.full_smallest < 1e-2
    same = actuation(np.array([[1.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 1.0]]), U)
    assert (same.rank, same.full_rank, same.complete) == (2, 3, False)
    assert "rank [J_constr; U] = 3 of 4" in str(same)


def test_pseudo_inverse_keeps_small_directions_that_are_real() -> None:
    rng = np.random.default_rng(3)
    Q, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    sizes = np.array([1.0, 0.3, 1e-3, 1e-7, 1e-13, 0.0])
    M = (Q * sizes) @ Q.T
    kept = np.where(sizes > 1e-9, sizes, np.inf)
    assert np.abs(symmetric_pinv(M) - (Q / kept) @ Q.T).max() < 1e-6 * 1e7


def test_the_public_name_is_lazy() -> None:
    assert hqp.Torque is hqp.torque.Torque
