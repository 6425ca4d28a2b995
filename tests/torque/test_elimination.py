"""Native elimination of constraint forces against the dense one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
import hqp.torque.dynamics
from hqp.arrays import Mat
from hqp.torque.dynamics import ConstrainedDynamics, coordinate_parents
from hqp.torque.gravity import holding_torque
from hqp.torque.motor_axes import passive_motions
from tests.torque.dense_elimination import DenseDynamics

pytestmark = pytest.mark.skipif(hqp.torque.dynamics.native is None, reason="no native assembly here")

FRAMES = {"dreamer": ["wheel_0", "hand"], "talos": [], "cbi": ["l_sole", "r_sole"], "panda": ["panda_hand"]}


def both(robot: Any, m: int, given: Mat | None = None) -> tuple[ConstrainedDynamics, DenseDynamics]:
    """Native elimination on the tree, and the dense one."""
    U: Mat = robot.actuation if given is None else given
    return ConstrainedDynamics(robot.nv, m, U, coordinate_parents(robot)), DenseDynamics(m, U)


def tendons(U: Mat, rng: np.random.Generator) -> Mat:
    """The motors of U, some of which pull one to three further coordinates."""
    U = U.copy()
    for row in U[rng.random(len(U)) < 0.4]:
        row[rng.choice(U.shape[1], rng.integers(1, 4))] += rng.uniform(-2.0, 2.0)
    return U


def compare(fast: ConstrainedDynamics, slow: DenseDynamics, tau: Any) -> None:
    assert fast.rank == slow.rank
    pairs = [(getattr(fast, name), getattr(slow, name)) for name in ("X", "c", "phi")]
    pairs += list(zip(fast.force_map(), slow.force_map(), strict=True))
    pairs += [(fast.forces(tau), slow.forces(tau)), (fast.acceleration(tau), slow.acceleration(tau))]
    if fast.m:
        pairs += [(getattr(fast, name), getattr(slow, name)) for name in ("Lambda_constr", "Jbar_constr", "N_constr")]
    for x, y in pairs:
        assert np.abs(x - y).max(initial=0.0) < 1e-9 * max(1.0, np.abs(y).max(initial=0.0))


@pytest.mark.parametrize("pulls", [False, True])
@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("name", ["dreamer", "talos", "cbi", "panda"])
def test_native_elimination_equals_the_dense_one(name: str, count: int, pulls: bool) -> None:
    if name not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    robot, rng = hqp.robots.load(name), np.random.default_rng(5)
    frames = (FRAMES[name] or list(robot.landmarks["soles"]))[:count]
    m = 6 * len(frames) if name != "dreamer" else 3 * len(frames)
    fast, slow = both(robot, m, tendons(robot.actuation, rng) if pulls else None)
    for _ in range(10):
        state = robot.state(robot.random_configuration(rng), rng.normal(size=robot.nv))
        jacobians = [state.jacobian(f) if name != "dreamer" else state.jacobian(f)[:3] for f in frames]
        J = np.vstack(jacobians) if frames else np.zeros((0, robot.nv))
        gamma, A, bias = rng.normal(size=m), state.inertia(), state.bias_force()
        for dynamics in (fast, slow):
            dynamics.update(A, bias, J, gamma)
        assert fast.rank == m
        compare(fast, slow, rng.normal(size=robot.actuated.size))


def test_dependent_constraints_then_independent_ones() -> None:
    """Dependent constraints get the forces of least norm; earlier states do not affect later ones."""
    robot, rng = hqp.robots.load("cbi"), np.random.default_rng(6)
    fast, slow = both(robot, 12)
    for k in range(6):
        state = robot.state(robot.random_configuration(rng), rng.normal(size=robot.nv))
        left, right = state.jacobian("l_sole"), state.jacobian("r_sole")
        J = np.vstack((left, left if k % 2 else right))
        gamma = J @ rng.normal(size=robot.nv)
        for dynamics in (fast, slow):
            dynamics.update(state.inertia(), state.bias_force(), J, gamma)
        assert fast.rank == (6 if k % 2 else 12)
        compare(fast, slow, rng.normal(size=robot.actuated.size))


def test_parents_are_the_pattern_of_the_inertia() -> None:
    robot = hqp.robots.load("cbi")
    state = robot.state(robot.random_configuration(np.random.default_rng(7)), None)
    parents, A = coordinate_parents(robot), state.mass_matrix()
    found = np.abs(A) > 1e-12
    carried = np.zeros_like(found)
    for i in range(robot.nv):
        j = i
        while j >= 0:
            carried[i, j] = carried[j, i] = True
            assert parents[j] < j
            j = parents[j]
    assert not (found & ~carried).any()
    assert carried.sum() < 0.6 * carried.size


@pytest.mark.parametrize("pulls", [False, True])
@pytest.mark.parametrize("constraints", [3, 5, 12])
def test_native_holding_torque_equals_the_dense_one(constraints: int, pulls: bool) -> None:
    rng, U, tau = np.random.default_rng(3), np.eye(7)[[1, 3, 4, 6]], np.empty(4)
    U = tendons(U, rng) if pulls else U
    holding = ConstrainedDynamics(7, constraints, U).native
    for _ in range(20):
        J, g = rng.normal(size=(constraints, 7)), rng.normal(size=7)
        J[0, 0] = 0.0  # another row becomes the pivot
        J[4:] = J[:1]  # duplicate rows share the load
        assert holding.hold(J, g, tau)
        expected = holding_torque(J, g, U)
        assert np.abs(tau - expected).max() < 1e-9 * np.abs(expected).max()
    J -= np.outer(J @ passive_motions(U)[:, 1], passive_motions(U)[:, 1]) / np.square(passive_motions(U)[:, 1]).sum()
    assert not holding.hold(J, g, tau)
