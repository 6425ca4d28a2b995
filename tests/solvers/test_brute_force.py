"""Small hierarchies against every possible active set: the kernel, the reference and the certificate."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp import Hierarchy, Rows, Selection, certificate
from tests.solvers import brute_force

SOLVERS = [name for name in ("lexicographic", "reference") if name in (*hqp.solvers.available(), "reference")]


def small(seed: int, n: int) -> Hierarchy:
    """A box and two levels; in half of them integers, so that rows repeat, conflict and meet in a vertex."""
    rng = np.random.default_rng([n, seed])
    whole = rng.random() < 0.6
    limit = rng.integers(1, 3, n).astype(float)
    levels = [Rows(Selection(np.arange(n)), -limit, limit)]
    for _ in range(2):
        m = int(rng.integers(1, 3))
        A = rng.integers(-1, 2, (m, n)).astype(float) if whole else rng.normal(size=(m, n))
        b = rng.integers(-3, 4, m).astype(float) if whole else 2.0 * rng.normal(size=m)
        kind = rng.integers(0, 3, m)
        levels.append(Rows(A, np.where(kind == 1, -np.inf, b), np.where(kind == 2, b + 1.0, b)))
    return Hierarchy(tuple(levels), constraints=1)


def check(n: int, seeds: range) -> None:
    solvers = [hqp.solvers.load(name) for name in SOLVERS]
    for seed in seeds:
        problem = small(seed, n)
        exact = brute_force.norms(problem)
        for solver in solvers:
            solution = solver.solve(problem)
            np.testing.assert_allclose(solution.norms, exact, atol=1e-7, err_msg=f"{solver.name} n {n} seed {seed}")
            assert certificate(problem, solution.x, 1e-8).ok, f"{solver.name} n {n} seed {seed}"
        for direction in np.concatenate([np.eye(n), -np.eye(n)]):
            moved = solution.x + 1e-2 * direction
            norms = np.array([np.linalg.norm(w) for w in problem.slacks(moved)])
            worse = np.flatnonzero(np.abs(norms - exact) > 1e-4)
            if worse.size and norms[worse[0]] > exact[worse[0]]:
                assert not certificate(problem, moved, 1e-6).ok, f"a worse point passes: n {n} seed {seed}"


@pytest.mark.long
@pytest.mark.parametrize("n", [1, 2, 3])
def test_every_active_set_of_small_problems(n: int) -> None:
    check(n, range(20))


@pytest.mark.slow
@pytest.mark.parametrize(("n", "seeds"), [(1, range(20, 80)), (2, range(20, 80)), (3, range(20, 80)), (4, range(120))])
def test_every_active_set_of_many_problems(n: int, seeds: range) -> None:
    check(n, seeds)
