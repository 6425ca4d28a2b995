"""Storage, order and sign of a level's rows do not change the answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import Generator

import hqp.solvers
from hqp import Hierarchy, Motion, Rows, Selection, Status
from tests.scenes.kinds import KINDS, problem
from tests.scenes.priced import is_unsure, priced_problem

LARGEST = 40


def selections(rng: Generator) -> Hierarchy:
    """Coordinate levels among dense ones, priced or not, within and beyond the reach of their price."""
    n = int(rng.integers(2, 10))
    levels, prices = [], []
    for k in range(int(rng.integers(1, 5))):
        if rng.random() < 0.7:
            picked = np.sort(rng.permutation(n)[: int(rng.integers(1, n + 1))])
            b = rng.normal(size=picked.size) * float(rng.choice([0.1, 1.0, 10.0]))
            loose = rng.random(picked.size) < 0.3
            rows = Rows(Selection(picked, rng.uniform(0.01, 3.0, picked.size)), np.where(loose, -np.inf, b), b)
        else:
            m = int(rng.integers(1, 4))
            b = rng.normal(size=m)
            rows = Rows(rng.normal(size=(m, n)), b, b)
        levels.append(rows)
        prices.append(float(rng.choice([0.0, 0.01, 0.3, 3.0])) if rng.random() < 0.8 or k == 0 else 0.0)
    levels.append(Rows(Selection(np.arange(n)), np.zeros(n), np.zeros(n)))
    weights = rng.uniform(0.3, 3.0, n) if rng.random() < 0.5 else None
    motion = None if weights is None else Motion(weights, np.zeros(n))
    return Hierarchy(tuple(levels), n=n, prices=np.array([*prices, 0.0]), motion=motion)


def stored(rows: Rows, n: int, rng: Generator) -> Rows:
    """The rows as a matrix, permuted and with random signs."""
    A = np.array(rows.dense(n))
    lower, upper = rows.lower.copy(), rows.upper.copy()
    order = rng.permutation(len(A))
    A, lower, upper = A[order], lower[order], upper[order]
    turned = rng.random(len(A)) < 0.5
    A[turned] *= -1.0
    lower[turned], upper[turned] = -upper[turned], -lower[turned]
    return Rows(A, lower, upper)


def check(case: Hierarchy, rng: Generator, tolerance: float = 1e-9) -> bool:
    """Compare the answers of the problem and its other forms; return true if all are certain."""
    solver = hqp.solvers.load("lexicographic")
    every = replace(case, levels=tuple(stored(rows, case.n, rng) for rows in case.levels), stacked=None)
    one = int(rng.integers(len(case.levels)))
    some = replace(
        case, levels=tuple(stored(r, case.n, rng) if k == one else r for k, r in enumerate(case.levels)), stacked=None
    )
    first, *others = (solver.solve(form) for form in (case, every, some))
    if any(s.status is not Status.OPTIMAL or is_unsure(s) for s in (first, *others)):
        return False
    size = max(1.0, float(np.abs(first.x).max()))
    for other in others:
        assert np.abs(other.x - first.x).max() < tolerance * size
    return True


@pytest.mark.parametrize("seeds", [range(200), pytest.param(range(1500), marks=pytest.mark.slow)], ids=["few", "many"])
def test_levels_that_pick_coordinates(seeds: range) -> None:
    sure = 0
    for seed in seeds:
        rng = np.random.default_rng([seed, 45])
        sure += check(selections(rng), rng)
    assert sure > 0.9 * len(seeds)


@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(40), marks=pytest.mark.slow)], ids=["few", "many"])
@pytest.mark.parametrize("kind", sorted({*KINDS} - {"large", "near_parallel", "zero_rows", "row_scales"}))
def test_every_kind_of_problem(kind: str, seeds: range) -> None:
    for seed in seeds:
        rng = np.random.default_rng([seed, 46])
        for case in (problem(kind, seed)[0], priced_problem(kind, seed, False)):
            if case.n <= LARGEST:
                check(case, rng, 1e-6)
