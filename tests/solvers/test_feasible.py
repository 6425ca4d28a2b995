"""Long rows and a large x leave more rounding than 1e-8 of 1 + |bound|: rows that an x meets are not violated."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import Generator

import hqp
from hqp import Hierarchy, Rows, Status

SOLVERS = ("lexicographic", "cascade", "reference")


def constrained(rng: Generator, off: float = 0.0) -> Hierarchy:
    """Rows of 1e3 to 1e7 with bounds near zero, which an x of 1e3 meets, and a task; off: a second bound that excludes
    all such x by this share of the row's length times |x|."""
    n, lengths = 8, 10.0 ** rng.uniform(3.0, 7.0, size=(3, 1))
    A, x = rng.normal(size=(3, n)), 1e3 * rng.normal(size=n)
    A = lengths * A / np.linalg.norm(A, axis=1)[:, None]
    x -= np.linalg.lstsq(A, A @ x, rcond=None)[0]
    b, task = A @ x, rng.normal(size=(4, n))
    upper = np.where(rng.random(3) < 0.5, b, np.inf)
    held = Rows(np.vstack((A, A[:1])), np.append(b, -np.inf), np.append(upper, b[0]))
    if off:
        held.upper[3] -= off * lengths[0, 0] * float(np.linalg.norm(x))
    target = task @ x + 1e3 * rng.normal(size=4)
    return Hierarchy((held, Rows(task, target, target)), n=n, constraints=1)


@pytest.mark.parametrize("name", SOLVERS)
def test_constraints_that_some_x_meets_are_not_violated(name: str) -> None:
    solver = hqp.solvers.load(name)
    for seed in range(30):
        status = solver.solve(constrained(np.random.default_rng(seed))).status
        assert status is not Status.CONSTRAINTS_VIOLATED, seed


@pytest.mark.parametrize("name", SOLVERS)
def test_constraints_that_no_x_meets_are_violated(name: str) -> None:
    solver = hqp.solvers.load(name)
    for seed in range(30):
        status = solver.solve(constrained(np.random.default_rng(seed), 1e-9)).status
        assert status is Status.CONSTRAINTS_VIOLATED, (seed, status)
