"""The lexicographic solver, kernel and reference: certified answers, warm starts, caps, statuses, options."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hqp.solvers
from benchmarks.speed import problems, random_hierarchies
from hqp import Hierarchy, Rows, Selection, Solution, Status, certificate
from hqp.errors import DeclarationError
from hqp.solvers import lexicographic
from hqp.solvers.lexicographic import Lexicographic

NATIVE = lexicographic.kernel() != ""
RANDOM = 10_000

needs_kernel = pytest.mark.skipif(not NATIVE, reason="built without the kernel")
kinds = pytest.mark.parametrize("native", [pytest.param(True, marks=needs_kernel), False])


def certified(problem: Hierarchy, solution: Solution) -> None:
    assert solution.status.solved, solution.status
    verdict = certificate(problem, solution.x)
    assert verdict.gap < 1e-8, verdict


def test_the_kernel_is_there_where_it_must_be() -> None:
    if os.environ.get("HQP_REQUIRE_NATIVE", "") not in ("", "0"):
        assert NATIVE, "HQP_REQUIRE_NATIVE is set, and hqp was built without its kernel"
        assert Lexicographic().is_native


@kinds
@pytest.mark.parametrize("name", problems.names())
def test_every_stored_problem_cold_and_warm(name: str, native: bool) -> None:
    solver = Lexicographic(native=native)
    for problem in problems.load(name, None if native else 6):
        workspace = solver.workspace(problem.shape)
        cold = workspace.solve(problem)
        certified(problem, cold)
        warm = workspace.solve(problem)
        assert warm.stats.factorisations == 1
        np.testing.assert_allclose(warm.x, cold.x, rtol=0.0, atol=1e-9 * (1.0 + abs(cold.x).max()))


@needs_kernel
@pytest.mark.parametrize("name", ["e38", "e57"])
def test_sequences_warm_from_the_problem_before(name: str) -> None:
    sequence = problems.load(name)
    workspace = Lexicographic().workspace(sequence[0].shape)
    for problem in sequence:
        certified(problem, workspace.solve(problem))


@pytest.mark.slow
@needs_kernel
@pytest.mark.parametrize("part", range(10))
def test_hard_random_hierarchies(part: int) -> None:
    solver = Lexicographic()
    for seed in range(part * RANDOM // 10, (part + 1) * RANDOM // 10):
        problem = random_hierarchies.hierarchy(seed)
        solution = solver.solve(problem)
        verdict = certificate(problem, solution.x)
        assert solution.status.solved, (seed, solution.status)
        assert verdict.ok or solution.status is Status.RANK_UNCERTAIN, (seed, verdict)


@needs_kernel
@pytest.mark.parametrize("seed", [312603])
def test_problems_that_were_wrong_once(seed: int) -> None:
    problem = random_hierarchies.hierarchy(seed)
    certified(problem, Lexicographic().solve(problem))


@needs_kernel
def test_kernel_and_reference_agree() -> None:
    for seed in range(400):
        problem = random_hierarchies.hierarchy(seed, largest=40)
        kernel, reference = Lexicographic().solve(problem), Lexicographic(native=False).solve(problem)
        if Status.RANK_UNCERTAIN in (kernel.status, reference.status):
            continue  # each judges its own pivots
        assert kernel.status is reference.status, seed
        if kernel.status.solved:
            np.testing.assert_allclose(kernel.x, reference.x, rtol=0.0, atol=1e-6 * (1.0 + abs(reference.x).max()))


@kinds
def test_bounds_hold_exactly(native: bool) -> None:
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
        solution = Lexicographic(native=native).solve(problem)
        value = problem.levels[0].A @ solution.x
        assert np.all(value >= lower)
        assert np.all(value <= upper)


@kinds
def test_multipliers_are_those_of_the_optimum(native: bool) -> None:
    solver = Lexicographic(native=native, multipliers=True)
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


@kinds
def test_arrays_refilled_in_place_are_read_again(native: bool) -> None:
    problem = problems.load("b5_38", 1)[0].copy()
    workspace = Lexicographic(native=native).workspace(problem.shape)
    first = workspace.solve(problem)
    problem.levels[2].lower[:] += 0.05
    problem.levels[2].upper[:] = problem.levels[2].lower
    second = workspace.solve(problem)
    certified(problem, second)
    assert not np.array_equal(first.x, second.x)
    kept = second.x.copy()
    workspace.solve(problems.load("b5_38", 2)[1])
    np.testing.assert_array_equal(second.x, kept)  # a solution owns its arrays


@kinds
def test_arrays_that_are_not_contiguous(native: bool) -> None:
    rng = np.random.default_rng(0)
    A, b = np.asfortranarray(rng.normal(size=(4, 6))), rng.normal(size=8)[::2]
    problem = Hierarchy((Rows(A, b, b),))
    workspace = Lexicographic(native=native).workspace(problem.shape)
    workspace.solve(problem)
    b[0] += 1.0
    certified(problem, workspace.solve(problem))


@kinds
def test_the_same_bits_again(native: bool) -> None:
    for name in ("c38", "d38", "rand20"):
        for problem in problems.load(name, 4):
            first, second = (Lexicographic(native=native).solve(problem) for _ in range(2))
            assert first.x.tobytes() == second.x.tobytes()


@kinds
def test_iteration_cap_returns_the_best_point_so_far(native: bool) -> None:
    seen = 0
    for problem in (*problems.load("d38", 8), problems.load("f62", 2)[1]):
        worst = np.full(len(problem.levels), np.inf)
        for cap in range(2, 30, 3):
            solution = Lexicographic(native=native, max_iterations=cap).solve(problem)
            assert np.all(abs(solution.residuals[0]) == 0.0)
            if solution.status is Status.ITERATION_LIMIT:
                seen += 1
                assert solution.stats.factorisations <= cap
            if cap > 8:  # past block exchange the levels descend in lexicographic order
                changed = np.flatnonzero(abs(solution.norms - worst) > 1e-6 * (1.0 + worst))
                assert not changed.size or solution.norms[changed[0]] < worst[changed[0]]
                worst = solution.norms
    assert seen > 5


@kinds
def test_time_limit(native: bool) -> None:
    solution = Lexicographic(native=native, deadline=1e-9).solve(problems.load("d38", 5)[4])
    assert solution.status is Status.TIME_LIMIT
    assert np.all(solution.residuals[0] == 0.0)


@kinds
def test_damping_never_moves_the_levels_above(native: bool) -> None:
    problem = problems.load("a38", 1)[0]
    plain = Lexicographic(native=native).solve(problem)
    damped = Lexicographic(native=native, damping=(0.0, 0.3, 0.0, 0.0)).solve(problem)
    assert damped.norms[0] < 1e-12
    assert damped.norms[1] > plain.norms[1] + 1e-6  # the undamped residual is told
    assert damped.status is Status.NOT_STRICT
    assert "damping" in damped.detail
    step, target = problem.levels[1].A, problem.levels[1].lower  # the formula, by hand, in an orthonormal null space
    above = problem.levels[0]
    _, _, Vt = np.linalg.svd(above.dense(problem.n))
    Z = Vt[above.m :].T
    start = np.linalg.pinv(above.dense(problem.n)) @ above.lower
    AZ = step @ Z
    y = AZ.T @ np.linalg.solve(AZ @ AZ.T + 0.09 * np.eye(3), target - step @ start)
    np.testing.assert_allclose(damped.residuals[1], step @ (start + Z @ y) - target, atol=1e-10)


@needs_kernel
def test_damping_is_the_same_in_the_reference() -> None:
    for seed in range(40):
        problem = random_hierarchies.hierarchy(seed, 15)
        options: dict[str, Any] = {"damping": 0.2, "max_iterations": 50}
        if not all(level.equality.all() for level in problem.levels):
            continue
        kernel, reference = (
            Lexicographic(**options).solve(problem),
            Lexicographic(native=False, **options).solve(problem),
        )
        np.testing.assert_allclose(kernel.x, reference.x, atol=1e-8 * (1.0 + abs(reference.x).max()))


@kinds
def test_a_rank_decision_near_the_tolerance_is_told(native: bool) -> None:
    A = np.array([[1.0, 0.0], [1.0, 3e-9]])
    solution = Lexicographic(native=native).solve(Hierarchy((Rows(A, np.zeros(2), np.zeros(2)),)))
    assert solution.status is Status.RANK_UNCERTAIN


@kinds
def test_unusable_numbers_are_a_status(native: bool) -> None:
    problem = problems.load("b5_38", 1)[0].copy()
    workspace = Lexicographic(native=native).workspace(problem.shape)
    good = workspace.solve(problem)
    for array, where in ((problem.levels[1].A, (2, 3)), (problem.levels[1].lower, 1), (problem.levels[0].upper, 0)):
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
     {"deadline": 0.0}, {"exchange_credit": -1}, {"damping": -1.0}, {"damping": (0.0, np.nan)}, {"no_such": 1}],
)  # fmt: skip
def test_options_out_of_range(options: dict[str, object]) -> None:
    with pytest.raises(DeclarationError):
        hqp.solvers.load("lexicographic", **options)


def test_damping_for_another_number_of_levels() -> None:
    problem = problems.load("a38", 1)[0]
    with pytest.raises(DeclarationError, match="4 numbers"):
        Lexicographic(damping=(0.1,)).solve(problem)


@kinds
def test_contradictory_bounds_on_a_variable_are_least_violated(native: bool) -> None:
    bounds = Rows(Selection(np.array([0, 0])), np.array([2.0, -np.inf]), np.array([np.inf, 1.0]))
    problem = Hierarchy((bounds, Rows(np.eye(2), np.zeros(2), np.zeros(2))), constraints=1)
    solution = Lexicographic(native=native).solve(problem)
    np.testing.assert_allclose(solution.x, [1.5, 0.0], atol=1e-12)
    assert solution.status is Status.CONSTRAINTS_VIOLATED


@kinds
def test_metric_and_origin_complete(native: bool) -> None:
    rng = np.random.default_rng(5)
    for rank in (6, 3):
        root = rng.normal(size=(6, rank))
        A, b = rng.normal(size=(2, 6)), rng.normal(size=2)
        problem = Hierarchy((Rows(A, b, b),), metric=root @ root.T, origin=rng.normal(size=6))
        certified(problem, Lexicographic(native=native).solve(problem))
        certified(replace(problem, metric=None), Lexicographic(native=native).solve(replace(problem, metric=None)))
