"""Priced answers against cone programs written from the equations alone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import Generator

import hqp.solvers
from hqp import Hierarchy, Motion, Rows, Selection, certificate
from hqp.arrays import Vec
from tests.solvers.cones import Oracle

pytest.importorskip("clarabel")

COUNT = 16
"""Number of drawn problems; 5 000 take an hour."""


def draw(rng: Generator) -> Hierarchy:
    """Levels with and without a price, inequalities, flat motion, tiny singular values, rows of different length."""
    n = int(rng.integers(4, 9))
    levels = [Rows(Selection(np.arange(n)), -(box := rng.uniform(0.5, 3.0, n)), box)] if rng.random() < 0.6 else []
    constraints = len(levels)
    F = rng.standard_normal((int(rng.integers(1, n)), n)) if rng.random() < 0.25 else rng.uniform(0.3, 3.0, n)
    motion = Motion(F, rng.standard_normal(len(F)) if rng.random() < 0.5 else None) if rng.random() < 0.6 else None
    prices = [0.0] * constraints
    for _ in range(int(rng.integers(2, 5))):
        m = int(rng.integers(1, 4))
        A = 0.5 * rng.standard_normal((m, n))
        draws = rng.random(4)
        if draws[0] < 0.3:
            U, sigma, Vt = np.linalg.svd(A, full_matrices=False)
            sigma[-1] = 10.0 ** rng.uniform(-5.0, -2.0)
            A = U * sigma @ Vt
        if draws[1] < 0.2:
            A *= 10.0 ** rng.uniform(-2.0, 1.0, (m, 1))
        lower = rng.standard_normal(m) * (4.0 if draws[2] < 0.5 else 0.5)
        upper = lower.copy()
        one_sided = rng.random(m) < 0.3
        upper[one_sided] = np.where(rng.random(int(one_sided.sum())) < 0.5, np.inf, lower[one_sided] + 0.3)
        levels.append(Rows(A, lower, upper))
        prices.append(float(10.0 ** rng.uniform(-2.5, 0.0)) if draws[3] < 0.7 else 0.0)
    posture = rng.uniform(-1.0, 1.0, n)
    levels.append(Rows(np.eye(n), posture, posture.copy()))
    turning = np.where(np.array([*prices, 0.0]) > 0.0, 10.0 ** rng.uniform(-1.0, 3.0), 0.0)
    return Hierarchy(
        tuple(levels), constraints=constraints, prices=np.array([*prices, 0.0]), motion=motion, turning=turning
    )


def _apart(problem: Hierarchy, x: Vec, y: Vec) -> float:
    """Largest difference of the rows at two points, relative to their size."""
    dense = [rows.dense(problem.n) for rows in problem.levels]
    return max(float(np.abs(A @ (x - y)).max() / (1.0 + np.abs(A @ x).max())) for A in dense)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["reference"])
def test_answers_are_those_of_the_cone_programs(name: str) -> None:
    solver, unmet = hqp.solvers.load(name), 0
    for seed in range(COUNT):
        problem = draw(np.random.default_rng(seed))
        oracle = Oracle(problem).solve()
        if oracle.doubtful:
            continue
        solution = solver.solve(problem)
        assert solution.status.solved, (seed, solution.status)
        assert _apart(problem, solution.x, oracle.points[-1]) < 1e-5, seed
        verdict = certificate(problem, solution.x, 1e-8, solution.stage_points)
        assert verdict.ok, f"{seed}: {verdict}"
        off = solution.x + 1e-4 * np.random.default_rng(seed).standard_normal(problem.n)
        assert not certificate(problem, off, 1e-8, solution.stage_points).ok, seed
        unmet += bool(oracle.unmet)
    assert unmet > 0.5 * COUNT


@pytest.mark.parametrize("seed", [131, 360, 553, 2031, 2472, 3823])
def test_answers_far_away_pass_the_certificate(seed: int) -> None:
    """Optima at a distance of 1e3 to 1e5, or at a bound missed by 3e-10; directions without motion cost nothing."""
    problem = draw(np.random.default_rng(seed))
    solution = hqp.solvers.load("lexicographic").solve(problem)
    assert certificate(problem, solution.x, 1e-8, solution.stage_points).ok
