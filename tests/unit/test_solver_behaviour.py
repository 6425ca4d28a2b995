"""Particulars of each solver: formulas, options, failures of a back end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp.solvers
from hqp import Hierarchy, Rows, Selection, Status, certificate
from hqp.errors import BackendError
from hqp.lab.problem_families import FAMILIES, bounds, equality, low_rank
from hqp.solvers.backends import QpAnswer, load
from hqp.solvers.cascade import Cascade
from hqp.solvers.recursion import Recursion
from tests.scenes import problems

pinv = np.linalg.pinv


def three_levels(rng: np.random.Generator, n: int = 9) -> tuple[list[np.ndarray], list[np.ndarray]]:
    J = [rng.normal(size=(m, n)) for m in (3, 2, 3)]
    return J, [rng.normal(size=j.shape[0]) for j in J]


def hierarchy(J: list[np.ndarray], b: list[np.ndarray]) -> Hierarchy:
    return Hierarchy(tuple(equality(j, t) for j, t in zip(J, b, strict=True)))


class TestRecursion:
    def test_ranks_projector_and_point(self) -> None:
        rng = np.random.default_rng(0)
        J, b = three_levels(rng)
        A, stops = np.vstack(J), [3, 5, 8]
        recursion = Recursion(9, 1e-9)
        recursion.solve(A, np.concatenate(b), stops)
        assert recursion.ranks == [3, 2, 3]
        assert recursion.free == 1
        v = rng.normal(size=9)
        for levels, stop in ((1, 3), (2, 5), (3, 8)):
            N = np.eye(9) - pinv(A[:stop]) @ A[:stop]
            np.testing.assert_allclose(recursion.project(v, levels), N @ v, atol=1e-12)
        np.testing.assert_allclose(recursion.point(), pinv(A) @ np.concatenate(b), atol=1e-12)

    @pytest.mark.parametrize("rank", [1, 2, 3])
    def test_multipliers_balance_every_level(self, rank: int) -> None:
        rng = np.random.default_rng(rank)
        A = np.vstack([low_rank(rng, 4, 6, rank), low_rank(rng, 3, 6, 2), rng.normal(size=(8, 6))])
        b, stops = rng.normal(size=15), [4, 7, 15]
        recursion = Recursion(6, 1e-9)
        recursion.solve(A, b, stops)
        w = A @ recursion.point() - b
        L = recursion.multipliers(w, stops)
        assert np.abs(A.T @ L).max() < 1e-10
        np.testing.assert_allclose(L[:4, 0], w[:4])
        assert np.all(L[4:, 0] == 0.0)

    def test_the_rank_is_judged_against_the_unprojected_rows(self) -> None:
        row = np.array([[1.0, 2.0, 3.0]])
        recursion = Recursion(3, 1e-9)
        recursion.solve(np.vstack([row, row + 1e-13]), np.array([1.0, 5.0]), [1, 2])  # the remainder is rounding
        assert recursion.ranks == [1, 0]
        assert np.abs(recursion.point()).max() < 1.0

    def test_a_pivot_near_the_tolerance_is_reported(self) -> None:
        for tiny, uncertain in ((1e-4, False), (3e-9, True), (3e-10, True), (1e-13, False)):
            recursion = Recursion(2, 1e-9)
            recursion.solve(np.array([[1.0, 0.0], [1.0, tiny]]), np.ones(2), [1, 2])
            assert recursion.uncertain is uncertain

    def test_extending_is_one_more_level(self) -> None:
        rng = np.random.default_rng(4)
        A, b = rng.normal(size=(5, 9)), rng.normal(size=5)
        F, t = rng.normal(size=(2, 9)), rng.normal(size=2)
        one, two = Recursion(9, 1e-9), Recursion(9, 1e-9)
        one.solve(A, b, [3, 5])
        one.extend(F, t)
        two.solve(np.vstack([A, F]), np.concatenate([b, t]), [3, 5, 7])
        np.testing.assert_allclose(one.point(), two.point(), atol=1e-12)


class TestNullspace:
    def test_the_recursive_projector_of_the_literature(self) -> None:
        J, b = three_levels(np.random.default_rng(1))
        x, N = np.zeros(9), np.eye(9)
        for j, t in zip(J, b, strict=True):
            x, N = x + pinv(j @ N) @ (t - j @ x), N - pinv(j @ N) @ (j @ N)
        np.testing.assert_allclose(hqp.solvers.load("nullspace").solve(hierarchy(J, b)).x, x, atol=1e-12)

    def test_the_prioritised_torque_law_is_it_with_the_metric(self) -> None:
        # tau = sum J_k|' F_k, F_k = (J_k| phi J_k|')^+ (a_k - J_k phi tau), J_k| = J_k N_k (Sentis 2012), phi singular
        rng = np.random.default_rng(2)
        root = rng.normal(size=(7, 6))
        phi = root @ root.T
        tasks, goals = [rng.normal(size=(m, 7)) for m in (2, 3, 4)], [rng.normal(size=m) for m in (2, 3, 4)]
        tau, above = np.zeros(7), np.zeros((0, 7))
        for J, a in zip(tasks, goals, strict=True):
            lam = pinv(above @ phi @ above.T, rcond=1e-9) if above.size else np.zeros((0, 0))
            prior = J - J @ phi @ above.T @ lam @ above
            tau = tau + prior.T @ pinv(prior @ phi @ prior.T, rcond=1e-9) @ (a - J @ phi @ tau)
            above = np.vstack([above, J])
        levels = tuple(equality(J @ phi, a) for J, a in zip(tasks, goals, strict=True))
        found = hqp.solvers.load("nullspace").solve(Hierarchy(levels, metric=phi))
        np.testing.assert_allclose(phi @ found.x, phi @ tau, atol=1e-9)
        for rows, w in zip(levels, found.residuals, strict=True):
            np.testing.assert_allclose(w, rows.slack(tau), atol=1e-9)

    def test_ignored_inequalities_are_optimal_only_where_they_hold(self) -> None:
        solver = hqp.solvers.load("nullspace", ignore_inequalities=True)
        task = equality(np.eye(2), np.array([1.0, 1.0]))
        assert solver.solve(Hierarchy((bounds(2, 2.0), task))).status is Status.OPTIMAL
        hit = solver.solve(Hierarchy((bounds(2, 0.5), task)))
        assert hit.status is Status.NOT_CERTIFIED
        np.testing.assert_allclose(hit.x, [1.0, 1.0])

    def test_an_uncertain_rank_is_a_status(self) -> None:
        close = Hierarchy((equality(np.array([[1.0, 0.0]]), np.ones(1)), equality(np.array([[1.0, 3e-9]]), np.ones(1))))
        assert hqp.solvers.load("nullspace").solve(close).status is Status.RANK_UNCERTAIN


class TestChiaverini:
    @pytest.mark.parametrize("damping", [0.0, 1e-3, 0.3])
    def test_equations_16_and_17_and_footnote_3_as_printed(self, damping: float) -> None:
        (A, B, E), (a, b, e) = three_levels(np.random.default_rng(6))
        N_A = np.eye(9) - pinv(A) @ A
        AB = np.vstack([A, B])
        N_AB = np.eye(9) - AB.T @ np.linalg.inv(AB @ AB.T + damping**2 * np.eye(5)) @ AB
        third = N_A @ N_AB if damping else N_AB
        printed = pinv(A) @ a + N_A @ pinv(B) @ b + third @ pinv(E) @ e
        found = hqp.solvers.load("chiaverini", damping=damping).solve(hierarchy([A, B, E], [a, b, e]))
        np.testing.assert_allclose(found.x, printed, atol=1e-12)
        assert found.status is Status.NOT_STRICT
        np.testing.assert_allclose(found.residuals[0], 0.0, atol=1e-12)

    def test_it_is_the_hierarchical_optimum_for_orthogonal_tasks(self) -> None:
        Q, _ = np.linalg.qr(np.random.default_rng(7).normal(size=(9, 8)))
        J, b = [Q.T[:3], Q.T[3:5], Q.T[5:8]], [np.ones(3), np.ones(2), np.ones(3)]
        found = hqp.solvers.load("chiaverini").solve(hierarchy(J, b))
        assert found.status is Status.OPTIMAL
        assert certificate(hierarchy(J, b), found.x).ok

    def test_its_second_level_is_never_better(self) -> None:
        for seed in range(20):
            problem = hierarchy(*three_levels(np.random.default_rng(seed)))
            printed, exact = (hqp.solvers.load(name).solve(problem) for name in ("chiaverini", "nullspace"))
            np.testing.assert_allclose(printed.norms[0], exact.norms[0], atol=1e-12)
            assert printed.norms[1] >= exact.norms[1] - 1e-12


class Broken:
    """Back end with every failure of a package."""

    def __init__(self, how: str) -> None:
        self.how = how

    def workspace(self, n: int, m: int) -> Broken:
        return self

    def solve(self, H: Any, g: Any, C: Any, lower: Any, upper: Any) -> QpAnswer:
        if self.how == "raises":
            raise BackendError("broken: it raised")
        value = np.nan if self.how == "nan" else 0.0
        return QpAnswer(np.full(H.shape[0], value), np.zeros(C.shape[0]), False, 1, "GAVE_UP")


class TestCascade:
    @pytest.mark.parametrize("how", ["raises", "nan", "stops"])
    def test_a_failing_back_end_is_a_status_that_names_the_level(self, how: str) -> None:
        rng = np.random.default_rng(0)
        problem = Hierarchy((bounds(4, 0.3), equality(rng.normal(size=(4, 4)), np.ones(4))))
        workspace = Cascade(refine=False).workspace(problem.shape)
        workspace._backend = Broken(how)
        solution = workspace.solve(problem)
        assert solution.status is Status.NOT_CERTIFIED
        assert "level 1" in solution.detail
        assert np.isfinite(solution.x).all()

    def test_refining_repairs_or_the_status_says_so(self) -> None:
        rng = np.random.default_rng(0)
        problem = Hierarchy((bounds(4, 0.3), equality(rng.normal(size=(4, 4)), np.ones(4))))
        workspace = Cascade().workspace(problem.shape)
        workspace._backend = Broken("raises")
        solution = workspace.solve(problem)
        assert solution.status is Status.OPTIMAL
        assert certificate(problem, solution.x, Cascade.accuracy).ok

    def test_an_unrefined_answer_is_judged_and_never_called_optimal_beyond_its_accuracy(self) -> None:
        statuses = set()
        for name in ("cascade:osqp", "cascade:proxqp"):
            solver = hqp.solvers.load(name, refine=False)
            for problem in problems.load("rand12", 15):
                solution = solver.solve(problem)
                statuses.add(solution.status)
                assert certificate(problem, solution.x, solver.accuracy).ok is solution.status.solved
        assert Status.OPTIMAL in statuses

    def test_a_loose_first_order_answer_says_so(self) -> None:
        solver = hqp.solvers.load("cascade:osqp", refine=False, tolerance=1e-3)
        outcomes = [solver.solve(problem) for problem in problems.load("b15_38", 5)]
        assert all(solution.status is Status.NOT_CERTIFIED for solution in outcomes)
        assert all("gap" in solution.detail for solution in outcomes)

    @pytest.mark.parametrize("name", ["proxqp", "osqp", "piqp", "daqp", "clarabel"])
    def test_a_back_end_meets_the_conditions_of_a_program(self, name: str) -> None:
        if f"cascade:{name}" not in hqp.solvers.available():
            pytest.skip(f"{name} is not installed")
        rng = np.random.default_rng(8)
        workspace = load(name, 1e-9, 20000).workspace(6, 5)
        for _ in range(4):
            root, g, C = rng.normal(size=(6, 6)), rng.normal(size=6), rng.normal(size=(5, 6))
            H = root.T @ root + 0.1 * np.eye(6)
            lower, upper = np.full(5, -0.2), np.array([0.2, 0.2, 0.2, np.inf, 0.2])
            lower[1] = -np.inf
            answer = workspace.solve(H, g, C, lower, upper)
            assert answer.solved
            z, value = answer.multipliers, C @ answer.x
            np.testing.assert_allclose(H @ answer.x + g + C.T @ z, 0.0, atol=1e-5)
            assert np.all(value <= upper + 1e-6)
            assert np.all(value >= lower - 1e-6)
            assert np.all(z[value < upper - 1e-4] <= 1e-5)
            assert np.all(z[value > lower + 1e-4] >= -1e-5)


class TestDaqp:
    def test_rows_of_different_length_are_not_normalised(self) -> None:
        daqp = pytest.importorskip("daqp")
        assert daqp is not None
        # x = 0 against 10 x = 10: plain norms give 100/101, unit rows would give 1/2
        rows = equality(np.array([[1.0], [10.0]]), np.array([0.0, 10.0]))
        solution = hqp.solvers.load("daqp", refine=False).solve(Hierarchy((rows,)))
        np.testing.assert_allclose(solution.x, [100.0 / 101.0], atol=1e-5)


class TestWeighted:
    def test_a_level_outweighs_the_next_by_the_ratio_squared(self) -> None:
        opposed = (equality(np.eye(1), np.ones(1)), equality(np.eye(1), np.zeros(1)))
        for ratio in (3.0, 10.0, 100.0):
            x = hqp.solvers.load("weighted", ratio=ratio, regularisation=1e-6).solve(Hierarchy(opposed)).x
            np.testing.assert_allclose(x, ratio**2 / (1.0 + ratio**2), atol=1e-6)

    def test_constraints_are_hard_and_the_answer_is_marked(self) -> None:
        problem = Hierarchy((bounds(3, 0.1), equality(np.eye(3), np.ones(3))), constraints=1)
        solution = hqp.solvers.load("weighted").solve(problem)
        np.testing.assert_allclose(solution.x, 0.1, atol=1e-7)
        assert solution.status is Status.NOT_STRICT
        assert "weighted" in solution.detail

    def test_constraints_that_cannot_hold_are_softened(self) -> None:
        problem = FAMILIES["infeasible_constraints"](np.random.default_rng(0))
        solution = hqp.solvers.load("weighted").solve(problem)
        assert "softened" in solution.detail
        strict = hqp.solvers.load("cascade").solve(problem)
        assert strict.status is Status.CONSTRAINTS_VIOLATED
        assert np.abs(solution.x - strict.x).max() < 0.5

    def test_it_is_not_strict(self) -> None:
        problem = Hierarchy((equality(np.array([[1.0, 1.0]]), np.ones(1)), equality(np.eye(2), -np.ones(2))))
        assert hqp.solvers.load("weighted").solve(problem).norms[0] > 1e-3
        assert hqp.solvers.load("nullspace").solve(problem).norms[0] < 1e-12


def test_a_clipped_projector_loses_what_the_hierarchy_keeps() -> None:
    rng = np.random.default_rng(11)
    feet, hand = (
        equality(rng.normal(size=(3, 8)), 0.1 * rng.normal(size=3)),
        equality(rng.normal(size=(3, 8)), np.ones(3)),
    )
    limits = Rows(Selection(np.arange(8)), np.full(8, -0.2), np.full(8, 0.2))
    free = hqp.solvers.load("nullspace").solve(Hierarchy((feet, hand)))
    clipped = np.clip(free.x, -0.2, 0.2)
    strict = hqp.solvers.load("cascade").solve(Hierarchy((limits, feet, hand), constraints=1))
    assert np.linalg.norm(feet.slack(clipped)) > 1e-2
    assert strict.norms[1] < 1e-12
