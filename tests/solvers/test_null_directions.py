"""Directions outside the rows of every level get the least norm: rounding along them decides nothing.

tests/data/internal.npz: a torque tick of simple_humanoid on both feet, legs nearly straight, as an exact hierarchy:
torque limits, joint limits, a contact's range, CoM, hand, base, posture (A, l, u), metric.  A row of the base has a
length of 1.2e-9 and entries of 2e-16 along internal forces; it once took 994 N m of them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.random import Generator, default_rng

import hqp
from hqp import Hierarchy, Rows, certificate
from hqp.arrays import Mat
from hqp.problem.null_directions import null_directions, without_rounding
from hqp.solvers import lexicographic

TICK = Path(__file__).parents[1] / "data" / "internal.npz"
LIMIT = 1e3
SOLVERS = [
    pytest.param(
        "lexicographic", marks=pytest.mark.skipif(lexicographic.kernel() == "", reason="built without the kernel")
    ),
    "reference",
]


def tick() -> Hierarchy:
    with np.load(TICK) as data:
        rows = [data[f"A{k}"] if k else np.eye(29) for k in range(7)]
        return Hierarchy(
            tuple(Rows(A, data[f"l{k}"], data[f"u{k}"]) for k, A in enumerate(rows)), metric=data["metric"]
        )


def internal(metric: Mat) -> Mat:
    """Null space of the metric, ``(n, r)``."""
    values, vectors = np.linalg.eigh(metric)
    return np.asarray(vectors[:, values < 1e-12 * values[-1]])


@pytest.mark.parametrize("name", SOLVERS)
def test_internal_forces_of_a_humanoid_are_of_least_norm(name: str) -> None:
    problem = tick()
    assert problem.metric is not None
    Z = internal(problem.metric)
    assert Z.shape == (29, 6)
    workspace = hqp.solvers.load(name).workspace(problem.shape)
    for _ in range(2):
        solution = workspace.solve(problem)
        assert solution.status.solved, solution.detail
        assert np.linalg.norm(solution.x @ Z) < 1e-6
        assert np.linalg.norm(solution.x) == pytest.approx(65.75, abs=0.01)  # 65.755 by cascade:proxqp, 995.9 once
        assert certificate(problem, solution.x, 1e-8).ok


def test_internal_forces_beyond_the_least_norm_are_refused() -> None:
    """Every level and the metric agree to 1e-13: only the last stage can refuse them."""
    problem = tick()
    assert problem.metric is not None
    x = hqp.solvers.load("reference").solve(problem).x
    Z = internal(problem.metric)
    rng = default_rng(0)
    for size in (1e-3, 1.0, 100.0):
        verdict = certificate(problem, x + size * Z @ rng.normal(size=6), 1e-8)
        assert not verdict.ok
        assert np.all(verdict.gaps[:-1] <= 1e-8)


def redundant(rng: Generator) -> tuple[Hierarchy, Mat]:
    """Levels with rows A X up to rounding, below bounds on x; and the null space of X, ``(n, r)``.

    One row of a middle level has a length of 1e-6 to 1e-10, or differs from another by 1e-6 to 1e-9.
    """
    n = int(rng.integers(6, 14))
    r = int(rng.integers(3, n - 1))
    X = rng.normal(size=(r, n))

    def seen(A: Mat) -> Mat:
        return np.asarray(A @ X + 2e-16 * rng.normal(size=(len(A), n)))

    m = int(rng.integers(1, max(2, r // 2) + 1))
    goal, width = rng.normal(size=m), rng.uniform(0.0, 0.1)
    C = rng.normal(size=(3, r))
    if rng.random() < 0.5:
        C[0] *= 10.0 ** rng.uniform(-10.0, -6.0)
    else:
        C[1] = C[0] + rng.normal(size=r) * 10.0 ** rng.uniform(-9.0, -6.0)
    base, posture = C @ rng.normal(scale=0.3, size=r), rng.normal(size=r)
    levels = (
        Rows(np.eye(n), np.full(n, -LIMIT), np.full(n, LIMIT)),
        Rows(seen(np.eye(r)), -rng.uniform(0.1, 2.0, r), rng.uniform(0.1, 2.0, r)),
        Rows(seen(rng.normal(size=(m, r))), goal - width, goal + width),
        Rows(seen(C), base, base),
        Rows(seen(np.eye(r)), posture, posture),
    )
    metric = X.T @ X if rng.random() < 0.7 else None
    Z = np.linalg.svd(X)[2][r:].T
    return Hierarchy(levels, int(rng.integers(0, 3)), None if metric is None else (metric + metric.T) / 2.0), Z


@pytest.mark.slow
@pytest.mark.skipif(lexicographic.kernel() == "", reason="built without the native kernel")
def test_what_no_level_sees_is_zero() -> None:
    """20 of 300 went along such directions up to the bounds, because of rounding in the levels."""
    solver, uncertain = hqp.solvers.load("lexicographic"), 0
    for seed in range(300):
        problem, Z = redundant(default_rng(seed))
        solution = solver.solve(problem)
        if solution.status.solved:
            assert np.linalg.norm(solution.x @ Z) <= 1e-5, seed
            assert certificate(problem, solution.x, 1e-8).ok or certificate(problem, solution.x, 1e-6).ok, seed
        else:
            uncertain += 1
    assert uncertain <= 3


def test_null_directions_and_rows_without_them() -> None:
    problem, Z = redundant(default_rng(3))
    found = null_directions(problem)
    assert found.shape == Z.shape
    np.testing.assert_allclose(found @ found.T, Z @ Z.T, atol=1e-9)
    cleaned = without_rounding(problem)
    assert cleaned.levels[0] is problem.levels[0]
    for rows, given in zip(cleaned.levels[1:], problem.levels[1:], strict=True):
        lengths = np.linalg.norm(given.dense(problem.n), axis=1)
        assert np.all(np.linalg.norm(rows.dense(problem.n) @ found, axis=1) <= 1e-15 * lengths)
        np.testing.assert_allclose(rows.dense(problem.n), given.dense(problem.n), rtol=0.0, atol=1e-14)


def test_rows_that_see_everything_stay_as_they_are() -> None:
    rng = default_rng(1)
    level = Rows(rng.normal(size=(5, 5)), np.zeros(5), np.zeros(5))
    problem = Hierarchy((level,))
    assert without_rounding(problem) is problem
