"""The lexicographic solver: certified answers, warm starts, caps, statuses, options; against the textbook reference."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hqp.solvers
from hqp import Hierarchy, Rows, Selection, Solution, Status, certificate
from hqp.errors import DeclarationError, SolverNotInstalled
from hqp.solvers import lexicographic
from hqp.solvers.lexicographic import Lexicographic, NativeWorkspace
from hqp.solvers.reference import Reference
from tests.scenes import problems, random_hierarchies
from tests.scenes.kinds import problem as drawn_problem

RANDOM = 10_000

if lexicographic.kernel() == "" and os.environ.get("HQP_REQUIRE_NATIVE", "") in ("", "0"):
    pytest.skip("built without the native kernel", allow_module_level=True)


def certified(problem: Hierarchy, solution: Solution) -> None:
    assert solution.status.solved, solution.status
    verdict = certificate(problem, solution.x)
    assert verdict.gap < 1e-8, verdict


def test_the_kernel_is_there_where_it_must_be() -> None:
    assert lexicographic.kernel(), "HQP_REQUIRE_NATIVE is set, and hqp was built without its kernel"


def test_without_the_kernel_it_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lexicographic, "_native", None)
    for make in (Lexicographic, lambda: hqp.solvers.load("lexicographic")):
        with pytest.raises(SolverNotInstalled, match=r"C\+\+ compiler.*cascade"):
            make()
    with pytest.raises(SolverNotInstalled, match=r"C\+\+ compiler"):
        hqp.solve_many(problems.load("b5_38", 2))


@pytest.mark.parametrize("name", problems.names())
def test_every_stored_problem_cold_and_warm(name: str) -> None:
    solver = Lexicographic()
    for problem in problems.load(name):
        workspace = solver.workspace(problem.shape)
        cold = workspace.solve(problem)
        certified(problem, cold)
        warm = workspace.solve(problem)
        assert warm.stats.factorisations == 1
        np.testing.assert_allclose(warm.x, cold.x, rtol=0.0, atol=1e-9 * (1.0 + abs(cold.x).max()))


@pytest.mark.parametrize("name", ["e38", "e57"])
def test_sequences_warm_from_the_problem_before(name: str) -> None:
    sequence = problems.load(name)
    workspace = Lexicographic().workspace(sequence[0].shape)
    for problem in sequence:
        certified(problem, workspace.solve(problem))


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_hard_random_hierarchies(part: int) -> None:
    solver = Lexicographic()
    for seed in range(part * RANDOM // 10, (part + 1) * RANDOM // 10):
        problem = random_hierarchies.hierarchy(seed)
        solution = solver.solve(problem)
        verdict = certificate(problem, solution.x)
        assert solution.status.solved, (seed, solution.status)
        assert verdict.ok or solution.status is Status.RANK_UNCERTAIN, (seed, verdict)


@pytest.mark.parametrize("seed", [312603, 8084])
def test_problems_that_were_wrong_once(seed: int) -> None:
    problem = random_hierarchies.hierarchy(seed)
    certified(problem, Lexicographic().solve(problem))


@pytest.mark.slow
def test_the_textbook_reference_agrees() -> None:
    compared = 0
    for seed in range(200):
        problem = random_hierarchies.hierarchy(seed, largest=20)
        kernel, reference = Lexicographic().solve(problem), Reference().solve(problem)
        if kernel.status is Status.RANK_UNCERTAIN:
            continue  # pivots differ between the two
        assert kernel.status is reference.status, seed
        np.testing.assert_allclose(kernel.x, reference.x, rtol=0.0, atol=1e-6 * (1.0 + abs(reference.x).max()))
        compared += 1
    assert compared > 150


@pytest.mark.long
def test_the_reference_solves_levels_whose_rows_differ_in_length() -> None:
    for seed in range(60):
        problem = drawn_problem("row_scales", seed)[0]
        reference = Reference().solve(problem)
        assert reference.status.solved, seed
        assert certificate(problem, reference.x, 1e-8).ok, seed


def test_bounds_hold_exactly() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        n = int(rng.integers(1, 9))
        scale = rng.choice([-3.0, 0.1, 1.0, 7.0], size=n)
        lower = -rng.random(n)
        upper = lower + rng.random(n)
        goal = 9.0 * rng.normal(size=(n, n))
        problem = Hierarchy(
            (Rows(Selection(rng.permutation(n), scale), lower, upper), Rows(goal, np.ones(n), np.ones(n)))
        )
        solution = Lexicographic().solve(problem)
        value = problem.levels[0].A @ solution.x
        assert np.all(value >= lower)
        assert np.all(value <= upper)


def test_a_long_row_along_a_long_x_is_held_to_its_own_terms() -> None:
    """900 x_1 <= 27 is not exceeded by 3e-7 because x_0 is 90: the row of a light joint among large torques."""
    limit = Rows(np.array([[1e-3, 900.0]]), np.array([-np.inf]), np.array([27.0]))
    large = Rows(np.array([[1.0, 0.0]]), np.array([90.0]), np.array([90.0]))
    beyond = Rows(np.array([[1e-3, 900.0]]), np.array([27.0 + 3e-7]), np.array([27.0 + 3e-7]))
    answer = Lexicographic().solve(Hierarchy((limit, large, beyond), constraints=1))
    assert answer.status is Status.OPTIMAL
    assert answer.residuals[0][0] <= 1e-9


def test_multipliers_are_those_of_the_optimum() -> None:
    solver = Lexicographic(multipliers=True)
    drawn = [
        *problems.load("b5_38", 3),
        *problems.load("rand12", 10),
        *(random_hierarchies.hierarchy(seed, 20) for seed in range(60)),
    ]
    for problem in drawn:
        solution = solver.solve(problem)
        if solution.status not in (Status.OPTIMAL, Status.CONSTRAINTS_VIOLATED):
            continue
        assert solution.multipliers is not None
        rows = [level.dense(problem.n) for level in problem.levels]
        for k, found in enumerate(solution.multipliers):
            A = np.vstack(rows[: k + 1])
            size = 1.0 + np.linalg.norm(rows[k], axis=1).max(initial=0.0) * np.linalg.norm(solution.residuals[k])
            force = abs(A) * abs(found)[:, None]
            assert abs(A.T @ found).max(initial=0.0) <= 1e-8 * (size + force.max(initial=0.0))
            np.testing.assert_array_equal(found[found.size - rows[k].shape[0] :], solution.residuals[k])


def test_arrays_refilled_in_place_are_read_again() -> None:
    problem = problems.load("b5_38", 1)[0].copy()
    workspace = Lexicographic().workspace(problem.shape)
    first = workspace.solve(problem)
    problem.levels[2].lower[:] += 0.05
    problem.levels[2].upper[:] = problem.levels[2].lower
    second = workspace.solve(problem)
    certified(problem, second)
    assert not np.array_equal(first.x, second.x)
    kept = second.x.copy()
    workspace.solve(problems.load("b5_38", 2)[1])
    np.testing.assert_array_equal(second.x, kept)  # a solution owns its arrays


def test_arrays_that_are_not_contiguous() -> None:
    rng = np.random.default_rng(0)
    A, b = np.asfortranarray(rng.normal(size=(4, 6))), rng.normal(size=8)[::2]
    problem = Hierarchy((Rows(A, b, b),))
    workspace = Lexicographic().workspace(problem.shape)
    workspace.solve(problem)
    b[0] += 1.0
    certified(problem, workspace.solve(problem))


def test_the_same_bits_again() -> None:
    for name in ("c38", "d38", "rand20"):
        for problem in problems.load(name, 4):
            first, second = (Lexicographic().solve(problem) for _ in range(2))
            assert first.x.tobytes() == second.x.tobytes()


def test_iteration_cap_returns_the_best_point_so_far() -> None:
    seen = 0
    for problem in (*problems.load("d38", 8), problems.load("f62", 2)[1]):
        worst = np.full(len(problem.levels), np.inf)
        for cap in range(2, 30, 3):
            solution = Lexicographic(max_iterations=cap).solve(problem)
            assert np.all(abs(solution.residuals[0]) == 0.0)
            if solution.status is Status.ITERATION_LIMIT:
                seen += 1
                assert solution.stats.factorisations <= cap
            if cap > 8:  # past block exchange the levels descend in lexicographic order
                changed = np.flatnonzero(abs(solution.norms - worst) > 1e-6 * (1.0 + worst))
                assert not changed.size or solution.norms[changed[0]] < worst[changed[0]]
                worst = solution.norms
    assert seen > 5


def test_time_limit() -> None:
    solution = Lexicographic(deadline=1e-9).solve(problems.load("d38", 5)[4])
    assert solution.status is Status.TIME_LIMIT
    assert np.all(solution.residuals[0] == 0.0)


@pytest.mark.parametrize(("goal", "status"), [([1.0, 1.0], Status.RANK_UNCERTAIN), ([0.0, 0.0], Status.OPTIMAL)])
def test_a_rank_decision_near_the_tolerance_is_told(goal: list[float], status: Status) -> None:
    """Report it if it changes x: with a goal of 1, 1e-12 moves x by 3e-4 along the second row; with 0, not at all."""
    A = np.array([[1.0, 0.0], [1.0, 3e-9]])
    problem = Hierarchy((Rows(A, np.array(goal), np.array(goal)),))
    for ticks in (False, True):
        workspace = Lexicographic().workspace(problem.shape)
        assert isinstance(workspace, NativeWorkspace)
        if ticks:
            workspace.limit(np.inf)
        solution = workspace.solve(problem)
        assert solution.status is status
        assert not solution.detail


def test_unusable_numbers_are_a_status() -> None:
    problem = problems.load("b5_38", 1)[0].copy()
    workspace = Lexicographic().workspace(problem.shape)
    good = workspace.solve(problem)
    dense: Any = problem.levels[1].A
    for array, where in ((dense, (2, 3)), (problem.levels[1].lower, 1), (problem.levels[0].upper, 0)):
        for value in (np.nan, -np.inf if where == 0 else np.inf):
            old = array[where]
            array[where] = value
            bad = workspace.solve(problem)
            assert bad.status is Status.NOT_CERTIFIED
            assert bad.detail
            assert np.isfinite(bad.x).all()
            array[where] = old
    np.testing.assert_allclose(workspace.solve(problem).x, good.x, atol=1e-12)


@pytest.mark.parametrize(
    "options",
    [{"rank_tolerance": 0.0}, {"multiplier_tolerance": 1.0}, {"feasibility_tolerance": -1.0}, {"max_iterations": 0},
     {"deadline": 0.0}, {"max_failed_exchanges": -1}, {"damping": 0.1}, {"native": False}],
)  # fmt: skip
def test_options_out_of_range(options: dict[str, object]) -> None:
    with pytest.raises(DeclarationError):
        hqp.solvers.load("lexicographic", **options)


def test_contradictory_bounds_on_a_variable_are_least_violated() -> None:
    bounds = Rows(Selection(np.array([0, 0])), np.array([2.0, -np.inf]), np.array([np.inf, 1.0]))
    problem = Hierarchy((bounds, Rows(np.eye(2), np.zeros(2), np.zeros(2))), constraints=1)
    solution = Lexicographic().solve(problem)
    np.testing.assert_allclose(solution.x, [1.5, 0.0], atol=1e-12)
    assert solution.status is Status.CONSTRAINTS_VIOLATED


def test_metric_and_origin_complete() -> None:
    rng = np.random.default_rng(5)
    for rank in (6, 3):
        root = rng.normal(size=(6, rank))
        A, b = rng.normal(size=(2, 6)), rng.normal(size=2)
        problem = Hierarchy((Rows(A, b, b),), metric=root @ root.T, origin=rng.normal(size=6))
        certified(problem, Lexicographic().solve(problem))
        certified(replace(problem, metric=None), Lexicographic().solve(replace(problem, metric=None)))
