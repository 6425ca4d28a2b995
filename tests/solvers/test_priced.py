"""Levels with a price: stored optima, one family for all solvers, the certificate, and continuity beside exact ones."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp.solvers
from benchmarks.calm import continuity
from hqp import Hierarchy, Motion, Rows, Selection, Status, certificate
from hqp.arrays import Mat, Vec
from hqp.errors import ProblemError, UnsupportedProblem
from hqp.pricing import is_met, stage_price
from hqp.solvers.stages import multiplier

STORED = np.load(Path(__file__).parents[1] / "data" / "calm20.npz")
SOLVERS = [name for name in (*hqp.solvers.available(), "reference") if hqp.solvers.load(name).priced]
FAMILIES = tuple(continuity.FAMILIES)


def stored(i: int) -> tuple[Hierarchy, Vec]:
    """One of twenty problems whose optimum two other implementations agree on; made without the guard."""
    p = f"p{i:02d}_"
    box, count = STORED[p + "box"], int(STORED[p + "levels"])
    levels = [Rows(Selection(np.arange(box.size)), -box, box)]
    levels += [Rows(STORED[f"{p}A{k}"], STORED[f"{p}lower{k}"], STORED[f"{p}upper{k}"]) for k in range(count)]
    prices = [0.0, *(float(STORED[f"{p}c{k}"]) * bool(STORED[f"{p}priced{k}"]) for k in range(count))]
    shares = np.full(count + 1, float(STORED[p + "eta"]))
    problem = Hierarchy(tuple(levels), constraints=1, prices=np.array(prices), shares=shares, guard=False)
    return problem, STORED[p + "x"]


def random_problem(rng: np.random.Generator, family: str, inequalities: bool = True) -> Hierarchy:
    """Levels of a family with random prices; without inequalities no share is handed down."""
    levels = continuity.levels(rng, family, inequalities)
    prices = np.array([*[0.0] * inequalities, *rng.uniform(0.02, 0.2, len(levels) - 1 - inequalities), 0.0])
    shares = np.full(len(levels), 1e-3 if inequalities else 0.0)
    return Hierarchy(tuple(levels), constraints=int(inequalities), prices=prices, shares=shares)


@pytest.mark.parametrize("name", [s for s in SOLVERS if s != "nullspace"])
def test_stored_optima(name: str) -> None:
    solver = hqp.solvers.load(name)
    within = 1e-8 if name in ("lexicographic", "reference") else 1e-6
    for i in range(20):
        problem, x = stored(i)
        solution = solver.solve(problem)
        if within == 1e-8 or solution.status.solved:
            assert solution.status is Status.OPTIMAL, (i, solution.status)
            np.testing.assert_allclose(solution.x, x, rtol=0.0, atol=within, err_msg=str(i))


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("name", SOLVERS)
def test_every_solver_meets_the_conditions_of_every_stage(name: str, family: str) -> None:
    solver, solved = hqp.solvers.load(name), 0
    seeds = 12 if name == "lexicographic" else 3
    for seed in range(seeds):
        problem = random_problem(np.random.default_rng([seed, len(family)]), family, solver.inequalities)
        solution = solver.solve(problem)
        verdict = certificate(problem, solution.x, solver.accuracy, solution.stage_points)
        if solution.status.solved:
            solved += 1
            assert verdict.ok, f"{family} {seed}: {solution.status.name}, but {verdict}"
        else:
            assert solution.detail
    assert solved >= 0.6 * seeds


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("name", SOLVERS)
def test_postures_below_an_unmet_level_are_slowed(name: str, family: str) -> None:
    """The conditions of the slowed problem hold, and where a level is unmet those of the problem as asked do not."""
    solver, told = hqp.solvers.load(name), set[bool]()
    for seed in range(4):
        rng = np.random.default_rng([seed, len(family)])
        problem = random_problem(rng, family, solver.inequalities)
        eager = rng.uniform(-3.0, 3.0, problem.n)
        posture = Rows(Selection(np.arange(problem.n), rng.uniform(0.5, 2.0, problem.n)), eager, eager)
        above = [_without_last(rows, problem.n) for rows in problem.levels[:-1]] if seed % 2 else problem.levels[:-1]
        problem = replace(problem, levels=(*above, posture), pace=0.3)
        solution = solver.solve(problem)
        if seed % 2 and solution.status.solved:  # a coordinate that no row above has
            assert solution.x[-1] == pytest.approx(eager[-1] / posture.A.scale[-1], abs=10 * solver.accuracy)
        if solution.status.solved and solution.stage_points is not None:
            stages = solution.stage_points
            assert certificate(problem, solution.x, solver.accuracy, stages).ok, seed
            told.add(certificate(replace(problem, pace=math.inf), solution.x, 1e-6, stages).ok)
    assert told <= {True} if family == "plain" else False in told  # all levels of that family are met


@pytest.mark.parametrize("name", SOLVERS)
def test_below_an_unmet_level_one_without_a_coordinate_of_its_own_pays_more(name: str) -> None:
    """A base (coordinates 0, 1) below a hand out of reach (0 to 3); a second hand (3, 4) pays what it did."""
    solver = hqp.solvers.load(name)
    hand = _asked([[1.0, 0.2, 0.5, 0.3, 0.0], [1.0, 0.2, 0.5, 0.301, 0.0]], [2.0, -1.0])
    base, other = _asked([[0.3, 1.0, 0.0, 0.0, 0.0]], [40.0]), _asked([[0.0, 0.0, 0.0, 0.2, 1.0]], [1.5])
    shares = np.full(3, 0.0 if name == "nullspace" else 1e-3)
    prices = np.array([0.05, 0.1, 0.05])
    problem = Hierarchy((hand, base, other), prices=prices, shares=shares, pace=0.3)
    solution = solver.solve(problem)
    stages = solution.stage_points
    assert solution.status.solved
    assert stages is not None
    assert [stage_price(problem, stages, k) for k in (0, 2)] == [0.05, 0.05]
    assert stage_price(problem, stages, 1) > 1.5 * 0.1
    assert certificate(problem, solution.x, solver.accuracy, stages).ok
    np.testing.assert_allclose(solution.x, hqp.solvers.load("reference").solve(problem).x, atol=1e2 * solver.accuracy)
    fast = solver.solve(replace(problem, pace=math.inf))
    assert not certificate(problem, fast.x, 1e-6, fast.stage_points).ok
    assert solution.residuals[1][0] < 1.1 * fast.residuals[1][0] < 0.0
    second = replace(problem, motion=Motion(np.ones(5), np.zeros(5)))  # accelerations: rest costs something
    assert stage_price(second, stages, 1) == 0.1


def _asked(A: list[list[float]], b: list[float]) -> Rows:
    return Rows(np.array(A), np.array(b), np.array(b))


def _without_last(rows: Rows, n: int) -> Rows:
    A = rows.dense(n).copy()
    A[:, -1] = 0.0
    return Rows(A, rows.lower, rows.upper)


def test_solvers_agree_where_motion_is_flat_and_a_metric_chooses() -> None:
    solvers = [hqp.solvers.load(name) for name in ("nullspace", "lexicographic", "reference")]
    for seed in range(12):
        rng = np.random.default_rng(seed)
        problem = random_problem(rng, ("plain", "beyond", "contradictory")[seed % 3], inequalities=False)
        n = problem.n
        motion = Motion(rng.standard_normal((n - 1, n)), rng.standard_normal(n - 1))
        # rows of motion, as J X at torque level: they see no direction in which nothing moves
        moved = [Rows(r.dense(n) @ np.linalg.pinv(motion.F) @ motion.F, r.lower, r.upper) for r in problem.levels[:-1]]
        factor = rng.standard_normal((n - 1, n))
        assert problem.prices is not None
        assert problem.shares is not None
        problem = replace(
            problem,
            levels=tuple(moved),
            prices=problem.prices[:-1],
            shares=problem.shares[:-1],
            motion=motion,
            metric=factor.T @ factor,
            origin=rng.standard_normal(n),
        )
        points = [solver.solve(problem).x for solver in solvers]
        for x in points[1:]:
            np.testing.assert_allclose(x, points[0], rtol=0.0, atol=1e-6)


def test_a_level_that_is_met_for_its_price_is_exact_to_the_bit() -> None:
    rng, solver = np.random.default_rng(3), hqp.solvers.load("lexicographic")
    A, b = rng.standard_normal((2, 6)), 1e-3 * rng.standard_normal(2)
    levels = (Rows(A, b, b.copy()), Rows(np.eye(6), np.zeros(6), np.zeros(6)))
    priced = Hierarchy(levels, prices=np.array([0.05, 0.0]))
    solution = solver.solve(priced)
    np.testing.assert_array_equal(solution.x, solver.solve(priced.exact()).x)
    assert solution.stage_points is None


def test_entries_that_rest_have_the_rounding_of_those_that_move() -> None:
    rest = Rows(np.array([[1.0, 0.0]]), np.zeros(1), np.zeros(1))
    assert is_met(rest, np.array([7e-18, 0.3]))
    assert not is_met(rest, np.array([1e-11, 0.3]))
    assert not is_met(rest, np.array([7e-18, 0.0]))


def test_levels_are_settled_without_a_stage_while_limits_bind() -> None:
    """Boxes that exclude standing still, and drift: the working set of the least motion follows them."""
    rng, n = np.random.default_rng(7), 12
    tasks = [0.5 * rng.standard_normal((m, n)) for m in (2, 3)]
    solver, turned = hqp.solvers.load("lexicographic"), 0
    workspace, binding = None, set[bytes]()
    for k in range(200):
        centre = 0.6 * np.sin(0.02 * k + np.arange(n))
        inside = centre + 0.2 * np.cos(0.05 * k * np.arange(1, n + 1))
        levels = [Rows(Selection(np.arange(n)), centre - 0.4, centre + 0.4)]
        levels += [Rows(A, A @ inside, A @ inside) for A in tasks]
        levels.append(Rows(Selection(np.arange(n)), np.zeros(n), np.zeros(n)))
        problem = Hierarchy(tuple(levels), constraints=1, prices=np.array([0.0, 0.01, 0.01, 0.0]))
        workspace = workspace or solver.workspace(problem.shape)
        solution = workspace.solve(problem)
        assert solution.status is Status.OPTIMAL
        assert solution.stage_points is None
        assert solution.stats.iterations < 20
        exact = solver.solve(problem.exact())
        np.testing.assert_allclose(solution.x, exact.x, atol=1e-9)
        stages, _ = workspace.stages
        turned += stages.effort()[0]
        binding.add(solution.active[0].tobytes())
    assert len(binding) > 20
    assert turned == 0, f"{turned} steps of stages that found every level met"


def test_out_of_reach_only_the_levels_above_are_solved_exactly() -> None:
    """A goal that goes out of reach and comes back: as cold at every step, and exact once it is met."""
    rng, n = np.random.default_rng(3), 8
    above, task = rng.standard_normal((2, n)), rng.standard_normal((3, n))
    solver = hqp.solvers.load("lexicographic")
    workspace: Any = None
    step, exact, beyond = [0], [], []
    for k in range(120):
        step[0] = k
        goal = 6.0 * np.sin(np.pi * k / 119) ** 4 * np.array([1.0, -0.5, 0.3])
        levels = (
            Rows(Selection(np.arange(n)), np.full(n, -0.4), np.full(n, 0.4)),
            Rows(above, np.full(2, 0.1), np.full(2, 0.1)),
            Rows(task, goal, goal.copy()),
            Rows(Selection(np.arange(n)), np.zeros(n), np.zeros(n)),
        )
        problem = Hierarchy(levels, constraints=1, prices=np.array([0.0, 0.02, 0.02, 0.0]))
        if workspace is None:
            workspace = solver.workspace(problem.shape)
            bound, solve = problem, workspace._exact.solve
            workspace._exact.solve = lambda p, solve=solve: (exact.append(step[0]), solve(p))[1]
        for own, new in zip(bound.levels, problem.levels, strict=True):  # a session refills its problem in place
            own.lower[:], own.upper[:] = new.lower, new.upper
        warm, cold = workspace.solve(bound), solver.solve(problem)
        assert warm.status is Status.OPTIMAL
        np.testing.assert_allclose(warm.x, cold.x, atol=1e-9, err_msg=str(k))
        if warm.stage_points is None:
            np.testing.assert_allclose(warm.x, solver.solve(problem.exact()).x, atol=1e-12)
        else:
            beyond.append(k)
    assert len(beyond) > 30
    assert len(set(beyond) & set(exact)) == 1  # the step on which the goal went out of reach


def test_levels_of_many_rows_against_the_reference() -> None:
    """From seven rows on the secular equation is solved by Cholesky factors, not by rotations."""
    unmet = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        n, m = int(rng.integers(13, 19)), int(rng.integers(7, 11))
        levels = [Rows(Selection(np.arange(n)), -np.ones(n), np.ones(n))]
        for rows in (m, 5):
            goal = rng.choice([1.0, 10.0]) * rng.standard_normal(rows)
            levels.append(Rows(rng.standard_normal((rows, n)), goal, goal.copy()))
        levels.append(Rows(Selection(np.arange(n)), np.zeros(n), np.zeros(n)))
        prices = np.array([0.0, *10.0 ** rng.uniform(-2.0, 1.0, 2), 0.0])
        problem = Hierarchy(tuple(levels), constraints=1, prices=prices)
        solution = hqp.solvers.load("lexicographic").solve(problem)
        np.testing.assert_allclose(solution.x, hqp.solvers.load("reference").solve(problem).x, atol=1e-9)
        assert certificate(problem, solution.x, 1e-8, solution.stage_points).ok
        unmet += solution.stage_points is not None
    assert unmet > 6


def test_stages_keep_the_deadline() -> None:
    """Stopped at its first step, a stage leaves its point where it is: in the box, levels above as they were."""
    rng, n = np.random.default_rng(5), 40
    above, task = rng.standard_normal((4, n)), rng.standard_normal((12, n))
    levels = (
        Rows(Selection(np.arange(n)), np.full(n, -0.3), np.full(n, 0.3)),
        Rows(above, np.zeros(4), np.zeros(4)),
        Rows(task, np.full(12, 9.0), np.full(12, 9.0)),
        Rows(Selection(np.arange(n)), np.zeros(n), np.zeros(n)),
    )
    problem = Hierarchy(levels, constraints=1, prices=np.array([0.0, 0.02, 0.02, 0.0]))
    workspace: Any = hqp.solvers.load("lexicographic").workspace(problem.shape)
    whole = workspace.solve(problem)
    assert whole.status is Status.OPTIMAL
    assert whole.stage_points is not None
    workspace.reset()
    workspace.limit(np.inf)
    workspace._left = lambda: 1e-9  # the exact levels took all of it
    stopped = workspace.solve(problem)
    assert stopped.status is Status.TIME_LIMIT
    assert np.all(problem.levels[0].slack(stopped.x) == 0.0)
    assert np.abs(above @ stopped.x).max() < 1e-9


def test_what_is_handed_down_is_kept() -> None:
    solver = hqp.solvers.load("lexicographic")
    for seed in range(30):
        problem = random_problem(np.random.default_rng(seed), "beyond")
        solution = solver.solve(problem)
        if solution.stage_points is None:
            continue
        for k, priced in enumerate(problem.priced):
            point = solution.stage_points[k]
            if priced and not np.isnan(point[0]):
                rows = problem.levels[k]
                w = rows.slack(point)
                moved = np.abs(rows.A @ (solution.x - point))[np.abs(w) > 1e-9]
                assert np.all(moved <= 1e-3 * np.linalg.norm(w) / np.sqrt(rows.m) + 1e-10)


def test_wrong_answers_are_refused() -> None:
    solver = hqp.solvers.load("lexicographic")
    for seed in range(20):
        rng = np.random.default_rng(seed)
        problem = random_problem(rng, "beyond")
        solution = solver.solve(problem)
        if solution.stage_points is None:
            continue
        assert certificate(problem, solution.x, 1e-8, solution.stage_points).ok
        off = rng.standard_normal(problem.n)
        assert not certificate(problem, solution.x + 1e-5 * off, 1e-8, solution.stage_points).ok
        assert not certificate(problem, solution.x, 1e-8, solution.stage_points + 1e-5 * off).ok
        assert not certificate(problem, solver.solve(problem.exact()).x, 1e-8, solution.stage_points).ok


@pytest.mark.parametrize("family", continuity.FAMILIES)
def test_neighbouring_problems_have_neighbouring_answers(family: str) -> None:
    found = continuity.measure(family, 150)
    assert found.kept, found
    if family == "contradictory":
        assert found.jumps[0] > 0.5  # the control: exact answers do jump


def test_what_a_solver_cannot_do_is_refused() -> None:
    problem = random_problem(np.random.default_rng(0), "plain")
    for name in ("weighted", "chiaverini"):
        with pytest.raises(UnsupportedProblem, match="price"):
            hqp.solvers.load(name).require(replace(problem.shape, inequalities=False))
    equalities = replace(random_problem(np.random.default_rng(0), "plain", inequalities=False), shares=None)
    with pytest.raises(ProblemError, match="shares"):
        hqp.solvers.load("nullspace").solve(equalities)
    for wrong in (np.array([-1.0, 0.0]), np.array([np.nan, 0.0]), np.array([1.0])):
        with pytest.raises(ProblemError, match="prices"):
            Hierarchy((Rows(np.eye(2), np.zeros(2), np.zeros(2)),) * 2, prices=wrong)


def test_a_warm_row_whose_bound_has_gone_to_infinity() -> None:
    """G1 at torque level, a foot released: a row held at its upper bound a tick ago has none now."""
    inf = np.inf
    lower, upper = np.array([-inf, -inf]), np.array([0.5, 0.25])
    wall = Rows(np.array([[1.0, 0.0], [0.0, 1.0]]), lower, upper)
    goal = Rows(np.array([[1.0, 0.1], [0.0, 1e-3]]), np.array([2.0, 3.0]), np.array([2.0, 3.0]))
    problem = Hierarchy((wall, goal), constraints=1, prices=np.array([0.0, 0.05]))
    warm = hqp.solvers.load("lexicographic").workspace(problem.shape)
    assert warm.solve(problem).status is Status.OPTIMAL
    lower[:], upper[:] = (-5.0, -7.0), inf
    found = warm.solve(problem)
    cold = hqp.solvers.load("lexicographic").solve(problem)
    assert found.status is Status.OPTIMAL
    assert np.allclose(found.x, cold.x, atol=1e-8)
    assert certificate(problem, found.x, stages=found.stage_points).ok


def test_an_answer_that_was_stopped_is_not_called_optimal() -> None:
    """The stages start from the exact answer; where that was cut off there is nothing to start from."""
    solver, cut = hqp.solvers.load("lexicographic", max_iterations=1), 0
    for i in range(20):
        problem, _ = stored(i)
        if solver.solve(problem.exact()).status is Status.ITERATION_LIMIT:
            assert solver.solve(problem).status is Status.ITERATION_LIMIT
            cut += 1
    assert cut > 5


def test_the_guard_leaves_a_floor_where_no_motion_is_made() -> None:
    """Without one the half-space of a nearly lost direction turns over where its column crosses zero."""
    box = Rows(Selection(np.arange(2)), np.full(2, -1.0), np.full(2, 1.0))
    posture = Rows(np.eye(2), np.array([1.0, 0.0]), np.array([1.0, 0.0]))
    answers = {}
    for floor in (0.0, 0.1):
        answers[floor] = [
            hqp.solvers.load(name)
            .solve(
                Hierarchy(
                    (
                        box,
                        Rows(np.array([[sigma, 0.0], [0.0, 1e-9]]), np.array([1.0, 0.0]), np.array([1.0, 0.0])),
                        posture,
                    ),
                    constraints=1,
                    prices=np.array([0.0, 0.1, 0.0]),
                    guard_floor=floor,
                )
            )
            .x[0]
            for name in ("lexicographic", "reference")
            for sigma in (-1e-5, 1e-5)
        ]
        np.testing.assert_allclose(answers[floor][:2], answers[floor][2:], atol=1e-6)
    assert abs(answers[0.0][1] - answers[0.0][0]) > 0.9  # turned over
    assert abs(answers[0.1][1] - answers[0.1][0]) < 1e-3


def test_a_tick_solves_its_stages_once() -> None:
    """The kernel of a loop tells that stages follow; the answer is made of what it found."""
    problem = next(
        p
        for p in (stored(i)[0] for i in range(20))
        if hqp.solvers.load("lexicographic").solve(p).stage_points is not None
    )
    workspace = hqp.solvers.load("lexicographic").workspace(problem.shape)

    class Counting:
        solves = 0

        def __init__(self, stages: Any) -> None:
            self._stages = stages

        def __getattr__(self, name: str) -> Any:
            return getattr(self._stages, name)

        def solve(self, *arguments: Any) -> int:
            Counting.solves += 1
            return int(self._stages.solve(*arguments))

    workspace._native = Counting(workspace._native)  # type: ignore[attr-defined]
    solve, *_ = workspace.kernel(problem)  # type: ignore[attr-defined]
    answer = workspace.answer(problem, solve())  # type: ignore[attr-defined]
    assert Counting.solves == 1
    expected = hqp.solvers.load("lexicographic").solve(problem)
    np.testing.assert_array_equal(answer.x, expected.x)
    np.testing.assert_array_equal(answer.stage_points, expected.stage_points)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_level_is_settled_alike_warm_or_cold(family: str) -> None:
    """Over problems that change slowly, then jump: multipliers of the last tick decide as those made anew."""
    solver, decided = hqp.solvers.load("lexicographic"), set[bool]()
    for seed in range(6):
        rng = np.random.default_rng([seed, 7])
        one = random_problem(rng, family)
        turns = [rng.standard_normal(rows.dense(one.n).shape) for rows in one.levels]
        workspace = solver.workspace(one.shape)
        for tick in range(120):
            turn = 0.002 * tick if tick < 80 else rng.uniform()
            asked = 0.3 + 0.3 * math.sin(0.1 * tick)  # met for its price, and not, in turns
            levels = [one.levels[0]]
            for rows, other in zip(one.levels[1:], turns[1:], strict=True):
                levels.append(Rows(rows.dense(one.n) + turn * other, asked * rows.lower, asked * rows.upper))
            problem = replace(one, levels=tuple(levels))
            warm, cold = workspace.solve(problem), solver.solve(problem)
            decided.add(cold.stage_points is None)
            assert (warm.stage_points is None) == (cold.stage_points is None), (seed, tick)
            if warm.status.solved and cold.status.solved:
                np.testing.assert_allclose(warm.norms, cold.norms, rtol=0.0, atol=1e-8)
    assert decided == {True, False} or family in ("contradictory", "beyond")


def test_a_multiplier_of_a_tick_ago_spares_most_trials() -> None:
    """min ||M y - e|| + c/2 |y|^2: the root from near by is that of the bracketed search, in few trials."""
    trials = list[int]()
    for seed in range(50):
        rng = np.random.default_rng(seed)
        M, e, price = rng.standard_normal((3, 8)), rng.standard_normal(3), float(10.0 ** rng.uniform(-1.0, 1.0))
        count = 0

        def unmet(m: float, M: Mat = M, e: Vec = e) -> float:
            nonlocal count
            count += 1
            return float(np.linalg.norm(M @ np.linalg.solve(M.T @ M + m * np.eye(8), M.T @ e) - e))

        size = float(np.linalg.norm(M, axis=1).max())
        if (root := multiplier(unmet, price, size)) is None:
            continue
        count = 0
        again = multiplier(unmet, price, size, root * rng.uniform(0.9, 1.1))
        assert again == pytest.approx(root, rel=1e-9)
        trials.append(count)
        assert multiplier(unmet, price * 1e-6, size, root) == multiplier(unmet, price * 1e-6, size)
    assert len(trials) > 20
    assert max(trials) <= 8, trials
