"""A level of rank-deficient rows with noise is solved to the accuracy of its rows, within bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp.solvers
from hqp import Status, certificate
from hqp.problem import Hierarchy, Motion, Rows, Selection


def joints_that_hold_each_other(seed: int, noise: float) -> Hierarchy:
    """Torque rows of legs on the ground: eight rows of rank five, one of them tiny."""
    rng = np.random.default_rng(seed)
    n, directions = 8, 5
    mix = rng.standard_normal((n, directions)) * 10.0 ** rng.uniform(-1.0, 1.0, (n, 1))
    mix[rng.integers(n)] *= 10.0 ** rng.uniform(-10.0, -7.0)
    A = mix @ rng.standard_normal((directions, n)) + noise * rng.standard_normal((n, n))
    target, far = rng.standard_normal(n), 50.0 * rng.standard_normal(2)
    return Hierarchy(
        (
            Rows(Selection(np.arange(n), np.ones(n)), np.full(n, -5.0), np.full(n, 5.0)),
            Rows(rng.standard_normal((2, n)), far, far),
            Rows(A, target, target),
        ),
        constraints=1,
        n=n,
        prices=np.array([0.0, 0.01, 0.0]),
        motion=Motion(A, np.zeros(n)),
    )


@pytest.mark.parametrize("noise", [4e-15, 1e-12, 1e-10])
@pytest.mark.parametrize("seed", range(8))
def test_noise_is_no_direction(seed: int, noise: float) -> None:
    problem = joints_that_hold_each_other(seed, noise)
    workspace = hqp.solvers.load("lexicographic").workspace(problem.shape)
    workspace.limit(math.inf)  # type: ignore[attr-defined]
    solution = workspace.solve(problem)
    assert solution.status in (Status.OPTIMAL, Status.RANK_UNCERTAIN)
    assert np.abs(solution.x).max() <= 5.0 + 1e-9
    if solution.status is Status.OPTIMAL:
        assert certificate(problem, solution.x, 1e-8, solution.stage_points)


def rows_that_hardly_differ(seed: int) -> Hierarchy:
    """The last level repeats rows of levels above, one of their directions 1e-6 to 1e-8 as long as the others."""
    rng, n = np.random.default_rng(seed), 10
    shared, own = rng.normal(size=(3, n)), rng.normal(size=(2, n))
    U, sigma, Vt = np.linalg.svd(shared, full_matrices=False)
    sigma[-1] *= 10.0 ** rng.uniform(-8.0, -6.0)
    far, above = 3.0 * rng.normal(size=(4, 3)), np.array([0.0, np.inf, 0.0])
    levels = (
        Rows(shared, far[0], far[0] + above),
        Rows(own, far[1, :2], far[1, :2]),
        Rows(shared, far[2], far[2]),
        Rows(1e-3 * rng.normal(size=(1, n)), far[1, 2:], far[1, 2:]),
        Rows(U * sigma @ Vt, far[3], far[3]),
    )
    turning = np.array([0.0, 0.0, 10.0, 10.0, 0.0])
    motion = Motion(rng.normal(size=(3, n)))
    return Hierarchy(levels, constraints=1, prices=np.array([0.0, 0.0, 1.0, 1.0, 0.0]), turning=turning, motion=motion)


@pytest.mark.long
def test_no_row_sees_the_error_of_directions_without_motion() -> None:
    """The error is rounding over the share that remains of the rows: 1e-8, which would take x 1e8 to 1e12 away."""
    right = 0
    for seed in range(60):
        problem = rows_that_hardly_differ(seed)
        workspace = hqp.solvers.load("lexicographic").workspace(problem.shape)
        workspace.limit(math.inf)  # type: ignore[attr-defined]
        solution = workspace.solve(problem)
        passes = certificate(problem, solution.x, 1e-6, solution.stage_points).ok
        assert passes or solution.status is not Status.OPTIMAL, f"{seed}: |x| = {np.linalg.norm(solution.x):.3g}"
        right += passes
    assert right > 45
