"""Properties of every strict solver, on random hierarchies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hqp import Hierarchy, Rows, Solution, certificate
from hqp.lab.problem_families import FAMILIES
from hqp.solvers import Solver
from tests.solvers.conformance import Subject, subjects, supports

NAMES = sorted(set(FAMILIES) - {"zero_rows"})  # except zero rows, every family is well scaled enough to compare answers
CLOSE = 1e-6


@pytest.fixture(params=subjects(), ids=str, scope="module")
def solver(request: pytest.FixtureRequest) -> Solver:
    subject: Subject = request.param
    loaded = subject.load()
    if not loaded.strict:
        pytest.skip("makes no promise of strictness")
    return loaded


drawn = st.builds(
    lambda family, seed: FAMILIES[family](np.random.default_rng(seed)),
    st.sampled_from(NAMES),
    st.integers(0, 2**32 - 1),
)
some = settings(max_examples=25, suppress_health_check=list(HealthCheck))


def solved(solver: Solver, problem: Hierarchy) -> Solution | None:
    """The solution, if the solver accepts the problem and reports it solved."""
    if not supports(solver, problem):
        return None
    solution = solver.solve(problem)
    return solution if solution.status.solved else None


def size(problem: Hierarchy, *solutions: Solution) -> float:
    return 1.0 + max(float(np.abs(solution.x).max()) for solution in solutions)


def same_slacks(problem: Hierarchy, one: Solution, two: Solution, levels: int) -> None:
    """The optimal slack of a level is unique for any x."""
    for rows, w, v in zip(problem.levels[:levels], one.residuals, two.residuals, strict=False):
        length = 1.0 + np.abs(rows.dense(problem.n)).sum(axis=1).max(initial=0.0)
        np.testing.assert_allclose(w, v, rtol=0.0, atol=CLOSE * length * size(problem, one, two))


@some
@given(problem=drawn, seed=st.integers(0, 1000), pick=st.integers(0, 5))
def test_a_lower_level_never_moves_a_higher_slack(solver: Solver, problem: Hierarchy, seed: int, pick: int) -> None:
    before = solved(solver, problem)
    if before is None or not problem.levels:
        return
    k = pick % len(problem.levels)
    rows, rng = problem.levels[k], np.random.default_rng(seed)
    shift = 3.0 * rng.normal(size=rows.m)
    moved = Rows(rows.A, rows.lower + shift, rows.upper + shift)
    after = solved(solver, replace(problem, levels=(*problem.levels[:k], moved, *problem.levels[k + 1 :])))
    if after is not None:
        same_slacks(problem, before, after, k)


@some
@given(problem=drawn, seed=st.integers(0, 1000))
def test_the_order_of_rows_in_a_level_does_not_matter(solver: Solver, problem: Hierarchy, seed: int) -> None:
    before = solved(solver, problem)
    if before is None:
        return
    rng = np.random.default_rng(seed)
    levels = []
    for rows in problem.levels:
        order = rng.permutation(rows.m)
        levels.append(Rows(rows.dense(problem.n)[order], rows.lower[order], rows.upper[order]))
    after = solved(solver, replace(problem, levels=tuple(levels)))
    if after is not None:
        assert certificate(problem, after.x, max(CLOSE, solver.accuracy)).ok
        np.testing.assert_allclose(after.norms, before.norms, rtol=CLOSE, atol=1e3 * CLOSE)


@some
@given(problem=drawn, pick=st.integers(0, 5), exponent=st.floats(-3.0, 3.0))
def test_the_scale_of_a_level_does_not_matter(solver: Solver, problem: Hierarchy, pick: int, exponent: float) -> None:
    before = solved(solver, problem)
    if before is None or not problem.levels:
        return
    k, scale = pick % len(problem.levels), 10.0**exponent
    rows = problem.levels[k]
    lengths = [float(np.linalg.norm(r.dense(problem.n), axis=1).max(initial=0.0)) for r in problem.levels]
    if lengths[k] <= 1e-9 * max(lengths):  # rounding, until a factor enlarges it
        return
    scaled = Rows(scale * rows.dense(problem.n), scale * rows.lower, scale * rows.upper)
    after = solved(solver, replace(problem, levels=(*problem.levels[:k], scaled, *problem.levels[k + 1 :])))
    if after is not None:
        assert certificate(problem, after.x, max(CLOSE, solver.accuracy)).ok


@pytest.mark.long
@some
@given(problem=drawn, seed=st.integers(0, 1000))
def test_a_warm_start_does_not_matter(solver: Solver, problem: Hierarchy, seed: int) -> None:
    if not supports(solver, problem):
        return
    rng = np.random.default_rng(seed)
    workspace = solver.workspace(problem.shape)
    for _ in range(3):
        shifts = [0.3 * rng.normal(size=rows.m) for rows in problem.levels]
        levels = tuple(Rows(r.A, r.lower + s, r.upper + s) for r, s in zip(problem.levels, shifts, strict=True))
        tick = replace(problem, levels=levels)
        warm, cold = workspace.solve(tick), solver.solve(tick)
        if warm.status.solved and cold.status.solved:
            same_slacks(tick, warm, cold, len(levels))
