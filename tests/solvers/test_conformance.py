"""Every available solver on every family and every stored set."""

from __future__ import annotations

import numpy as np
import pytest

from hqp import Hierarchy, Rows, Selection, Status, certificate
from hqp.errors import ProblemError
from hqp.lab.problem_families import FAMILIES, equality
from hqp.solvers import Solver
from tests.scenes import problems
from tests.solvers.conformance import Subject, check, check_form, check_share, subjects, supports

SEEDS = 12
FEW = 1


@pytest.fixture(params=subjects(), ids=str)
def solver(request: pytest.FixtureRequest) -> Solver:
    subject: Subject = request.param
    return subject.load()


def draw(family: str, seeds: range) -> tuple[Hierarchy, ...]:
    return tuple(FAMILIES[family](np.random.default_rng([seed, len(family)])) for seed in seeds)


@pytest.mark.parametrize(
    "seeds", [range(SEEDS // 2), pytest.param(range(SEEDS), marks=pytest.mark.slow)], ids=["few", "many"]
)
@pytest.mark.parametrize("family", FAMILIES)
def test_family(solver: Solver, family: str, seeds: range) -> None:
    check_share(solver, draw(family, seeds))


@pytest.mark.parametrize("name", problems.names())
def test_stored_set(solver: Solver, name: str) -> None:
    check_share(solver, problems.load(name, FEW))


@pytest.mark.slow
@pytest.mark.parametrize("name", problems.names())
def test_whole_stored_set(solver: Solver, name: str) -> None:
    check_share(solver, problems.load(name))


@pytest.mark.parametrize("name", ["a38", "b0_38", "f62eq"])
def test_equal_to_the_projector_with_no_active_limit(solver: Solver, name: str) -> None:
    import hqp.solvers

    projector = hqp.solvers.load("nullspace", ignore_inequalities=True)
    compared, drawn = 0, problems.load(name, 10)
    for problem in drawn:
        expected = projector.solve(problem)
        if expected.status is not Status.OPTIMAL or not solver.strict or not supports(solver, problem):
            continue  # a limit is active, or the comparison does not apply
        compared += 1
        np.testing.assert_allclose(solver.solve(problem).x, expected.x, rtol=0.0, atol=1e-9)
    assert compared or not solver.strict or not supports(solver, drawn[-1])


def test_a_selection_solves_as_its_matrix(solver: Solver) -> None:
    rng = np.random.default_rng(5)
    task = equality(rng.normal(size=(2, 4)), rng.normal(size=2))
    answers = []
    for limits in (Selection(np.arange(4)), Selection(np.arange(4)).dense(4)):
        problem = Hierarchy((Rows(limits, np.full(4, -0.2), np.full(4, 0.2)), task), constraints=1)
        if supports(solver, problem):
            answers.append(solver.solve(problem).x)
            np.testing.assert_allclose(answers[-1], np.clip(answers[-1], -0.2, 0.2), atol=1e-7)
            np.testing.assert_allclose(answers[-1], answers[0], atol=1e-7)


@pytest.mark.parametrize(
    "family", ["middle_inequality", "random_equalities", "bounds_active", "infeasible_constraints"]
)
def test_a_kept_workspace_solves_a_sequence_as_a_fresh_one(solver: Solver, family: str) -> None:
    first = draw(family, range(1))[0]
    if not supports(solver, first):
        pytest.skip("not supported")
    rng = np.random.default_rng(1)
    workspace, problem = solver.workspace(first.shape), first
    for tick in range(8):
        shift = [0.05 * tick * rng.normal(size=rows.m) for rows in first.levels]
        levels = [Rows(r.A, r.lower + s, r.upper + s) for r, s in zip(first.levels, shift, strict=True)]
        problem = Hierarchy(tuple(levels), constraints=first.constraints)
        warm, cold = workspace.solve(problem), solver.solve(problem)
        check_form(problem, warm)
        if warm.status.solved:
            assert certificate(problem, warm.x, solver.accuracy).ok
            if cold.status.solved:
                np.testing.assert_allclose(warm.x, cold.x, atol=1e-6)
    workspace.reset()
    check_form(problem, workspace.solve(problem))


def test_a_solution_outlives_the_next_solve(solver: Solver) -> None:
    one, two = draw("random_equalities", range(2))
    levels = tuple(Rows(r.A, r.lower + 1.0, r.upper + 1.0) for r in one.levels)
    workspace = solver.workspace(one.shape)
    kept = workspace.solve(one)
    x, residuals = kept.x.copy(), [w.copy() for w in kept.residuals]
    workspace.solve(Hierarchy(levels))
    np.testing.assert_array_equal(kept.x, x)
    for w, old in zip(kept.residuals, residuals, strict=True):
        np.testing.assert_array_equal(w, old)
    with pytest.raises(ProblemError, match="this workspace solves"):
        workspace.solve(Hierarchy((*two.levels, *two.levels)))


def test_live_rows_that_turn_bad_are_a_status_not_an_exception(solver: Solver) -> None:
    A, b = np.random.default_rng(0).normal(size=(3, 5)), np.ones(3)
    problem = Hierarchy((Rows(A, b, b), equality(np.eye(5), np.ones(5))))
    workspace = solver.workspace(problem.shape)
    good = workspace.solve(problem).x
    for spoil in (np.nan, np.inf):
        A[1, 2], saved = spoil, A[1, 2]
        bad = workspace.solve(problem)
        assert not bad.status.solved
        assert bad.detail
        assert np.isfinite(bad.x).all()
        assert not any(np.isnan(w).any() for w in bad.residuals)
        A[1, 2] = saved
    b[0] = np.nan
    bad = workspace.solve(problem)
    assert not bad.status.solved
    assert np.isfinite(bad.x).all()
    b[0] = 1.0
    np.testing.assert_allclose(workspace.solve(problem).x, good, atol=1e-8)  # the invalid ticks leave no trace


def test_no_level_at_all(solver: Solver) -> None:
    np.testing.assert_allclose(solver.solve(Hierarchy((), n=3)).x, np.zeros(3), atol=1e-12)


def test_huge_targets_stay_finite(solver: Solver) -> None:
    problem = Hierarchy((equality(np.eye(3)[:2], np.array([1e6, -1e6])), equality(np.ones((1, 3)), np.zeros(1))))
    check(solver, problem)


@pytest.mark.filterwarnings("error")
def test_a_row_of_zeros_at_its_bound_divides_nothing(solver: Solver) -> None:
    """An interior-point back end gives it a multiplier."""
    walls = Rows(np.array([[1.0, 0.0], [0.0, 0.0]]), np.full(2, -np.inf), np.array([0.5, 0.0]))
    line, place = equality(np.ones((1, 2)), np.ones(1)), equality(np.eye(2), np.array([1.0, 0.0]))
    problem = Hierarchy((walls, line, place), constraints=1)
    if supports(solver, problem):
        solution = solver.solve(problem)
        if solution.status.solved:
            np.testing.assert_allclose(solution.x, [0.5, 0.5], atol=1e-6)
