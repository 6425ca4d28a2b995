"""Priced levels: stored optima, one family for all solvers, the certificate, continuity next to exact levels."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp.solvers
from hqp import Hierarchy, Motion, Rows, Selection, Status, certificate
from hqp.arrays import Vec
from hqp.errors import ProblemError, UnsupportedProblem
from hqp.problem.null_directions import without_rounding
from hqp.problem.pricing import is_met
from hqp.solvers.stages import UNSETTLED
from tests.scenes.calm import continuity

STORED = np.load(Path(__file__).parents[1] / "data" / "calm20.npz")
SOLVERS = [name for name in (*hqp.solvers.available(), "reference") if hqp.solvers.load(name).priced]
FAMILIES = tuple(continuity.FAMILIES)


def stored(i: int) -> tuple[Hierarchy, Vec]:
    """One of twenty problems, and the optimum of its first priced stage, confirmed by two other implementations."""
    p = f"p{i:02d}_"
    box, count = STORED[p + "box"], int(STORED[p + "levels"])
    levels = [Rows(Selection(np.arange(box.size)), -box, box)]
    levels += [Rows(STORED[f"{p}A{k}"], STORED[f"{p}lower{k}"], STORED[f"{p}upper{k}"]) for k in range(count)]
    prices = [0.0, *(float(STORED[f"{p}c{k}"]) * bool(STORED[f"{p}priced{k}"]) for k in range(count))]
    return Hierarchy(tuple(levels), constraints=1, prices=np.array(prices)), STORED[p + "x0"]


def random_problem(rng: np.random.Generator, family: str, inequalities: bool = True) -> Hierarchy:
    """Levels of a family with random prices and turning."""
    levels = continuity.levels(rng, family, inequalities)
    prices = np.array([*[0.0] * inequalities, *rng.uniform(0.02, 0.2, len(levels) - 1 - inequalities), 0.0])
    turning = np.where(prices > 0.0, 10.0 ** rng.uniform(0.0, 3.0, prices.size), 0.0)
    return Hierarchy(tuple(levels), constraints=int(inequalities), prices=prices, turning=turning)


@pytest.mark.parametrize("name", SOLVERS)
def test_stored_optima(name: str) -> None:
    staged = 0
    for i in range(20):
        problem, x = stored(i)
        solution = hqp.solvers.load(name).solve(problem)
        assert solution.status is Status.OPTIMAL, (i, solution.status)
        if solution.stage_points is not None and not np.isnan(solution.stage_points[1, 0]):
            np.testing.assert_allclose(solution.stage_points[1], x, rtol=0.0, atol=1e-8, err_msg=str(i))
            staged += 1
    assert staged > 3


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("name", SOLVERS)
def test_every_solver_meets_the_conditions_of_every_stage(name: str, family: str) -> None:
    solver, solved = hqp.solvers.load(name), 0
    seeds = 12 if name == "lexicographic" else 3
    for seed in range(seeds):
        problem = random_problem(np.random.default_rng([seed, len(family)]), family, solver.inequalities)
        solution = solver.solve(problem)
        verdict = certificate(problem, solution.x, 1e-8, solution.stage_points)
        if solution.status.solved:
            solved += 1
            assert verdict.ok, f"{family} {seed}: {solution.status.name}, but {verdict}"
        else:
            assert solution.detail
    assert solved >= 0.6 * seeds


def as_stored(seed: int, dense: bool, mixed: bool, unit: float) -> Hierarchy:
    """Box, unreachable hand, base and posture in several forms, orders and units of the priced level."""
    rng, n = np.random.default_rng(seed), 6
    drawn = rng.permutation(n)
    order = drawn if mixed else np.arange(n)
    turn = order[order < 3]
    hand, goal, base = rng.standard_normal((3, n)), 4.0 * rng.standard_normal(3), rng.standard_normal(2)
    upper, posture = np.where(np.arange(3) == 2, np.inf, goal), rng.uniform(-1.0, 1.0, n)
    parts = [(np.array([0, 3]), base, unit), (order, posture[order], 1.0)]
    picked = [Rows(Selection(index, np.full(index.size, size)), size * b, size * b) for index, b, size in parts]
    if dense:
        picked = [replace(rows, A=rows.dense(n)) for rows in picked]
    return Hierarchy(
        (
            Rows(Selection(order), np.full(n, -2.0), np.full(n, 2.0)),
            Rows(unit * hand[turn], unit * goal[turn], unit * upper[turn]),
            *picked,
        ),
        constraints=1,
        prices=unit * np.array([0.0, 0.05, 0.05, 0.0]),
        turning=np.array([0.0, 200.0, 200.0, 0.0]) / unit**4,
    )


@pytest.mark.long
@pytest.mark.parametrize("name", ["lexicographic", pytest.param("reference", marks=pytest.mark.slow)])
def test_one_answer_however_the_rows_are_stored(name: str) -> None:
    solver, unmet = hqp.solvers.load(name), 0
    for seed in range(8):
        first = as_stored(seed, False, False, 1.0)
        x = solver.solve(first).x
        others = [
            as_stored(seed, True, False, 1.0),
            as_stored(seed, False, True, 1.0),
            as_stored(seed, True, True, 1e3),
        ]
        for other in (first, *others, without_rounding(others[0])):
            solution = solver.solve(other)
            np.testing.assert_allclose(solution.x, x, rtol=0.0, atol=1e-8, err_msg=str(seed))
            assert certificate(other, solution.x, 1e-8, solution.stage_points).ok
            assert certificate(first, solution.x, 1e-8, solution.stage_points).ok
            unmet += solution.stage_points is not None
    assert unmet > 20


@pytest.mark.long
def test_solvers_agree_where_motion_is_flat_and_a_metric_chooses() -> None:
    solvers = [hqp.solvers.load(name) for name in SOLVERS]
    for seed in range(12):
        rng = np.random.default_rng(seed)
        problem = random_problem(rng, ("plain", "beyond", "contradictory")[seed % 3], inequalities=False)
        n = problem.n
        motion = Motion(rng.standard_normal((n - 1, n)), rng.standard_normal(n - 1))
        # rows of motion, as J X at torque level: they have no component along directions without motion
        moved = [Rows(r.dense(n) @ np.linalg.pinv(motion.F) @ motion.F, r.lower, r.upper) for r in problem.levels]
        factor = rng.standard_normal((n - 1, n))
        problem = replace(
            problem,
            levels=tuple(moved),
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
    assert is_met(rest, np.array([7e-18, 0.0]))  # every entry is rounding
    assert not is_met(rest, np.array([1e-13, 0.0]))


def test_each_row_of_a_met_level_is_met_by_its_own_length() -> None:
    rows = Rows(np.diag([1e5, 1e-6]), np.array([1e5, 1e-6]), np.array([1e5, 1e-6]))
    assert is_met(rows, np.array([1.0, 1.0 + 1e-12]))
    assert not is_met(rows, np.array([1.0, 1.05]))  # 5e-8 beside terms of 1e5


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
        turned += workspace.native.effort()[0]
        binding.add(solution.active[0].tobytes())
    assert len(binding) > 20
    assert turned == 0, f"{turned} steps of stages that found every level met"


def test_out_of_reach_only_the_levels_above_are_solved_exactly() -> None:
    """A goal leaves the reach and returns: each step equals a cold solve, and the level is exact once met."""
    rng, n = np.random.default_rng(3), 8
    above, task = rng.standard_normal((2, n)), rng.standard_normal((3, n))
    solver = hqp.solvers.load("lexicographic")
    workspace: Any = None
    step, exact, beyond, factors = [0], [], [], []
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
            bound, found = problem, workspace._exact.found
            workspace._exact.found = lambda p, found=found: (exact.append(step[0]), found(p))[1]
        for own, new in zip(bound.levels, problem.levels, strict=True):  # a session refills its problem in place
            own.lower[:], own.upper[:] = new.lower, new.upper
        warm, cold = workspace.solve(bound), solver.solve(problem)
        assert warm.status is Status.OPTIMAL
        np.testing.assert_allclose(warm.x, cold.x, atol=1e-9, err_msg=str(k))
        if warm.stage_points is None:
            np.testing.assert_allclose(warm.x, solver.solve(problem.exact()).x, atol=1e-12)
        else:
            beyond.append(k)
            factors.append(warm.stats.factorisations)
    assert len(beyond) > 30
    assert sum(map(bool, factors)) < 0.3 * len(factors)  # these neither, if the face of the last tick still holds
    assert len(set(beyond) & set(exact)) == 1  # the step in which the goal left the reach


def test_numbers_that_are_none_are_a_status_where_the_face_of_the_last_tick_is_tried() -> None:
    rng, n = np.random.default_rng(5), 6
    rows = [0.1 * rng.standard_normal((2, n)), rng.standard_normal((3, n)), np.eye(n)]
    targets = [np.full(2, 1e-4), np.full(3, 40.0), np.zeros(n)]
    levels = [Rows(A, b.copy(), b.copy()) for A, b in zip(rows, targets, strict=True)]
    box = Rows(Selection(np.arange(n)), np.full(n, -1.0), np.ones(n))
    problem = Hierarchy((box, *levels), constraints=1, prices=np.array([0.0, 0.05, 0.05, 0.0]))
    workspace = hqp.solvers.load("lexicographic").workspace(problem.shape)
    x = [workspace.solve(problem).x for _ in range(3)][-1]
    for level in problem.levels:
        arrays = [level.A.scale if isinstance(level.A, Selection) else level.A, level.lower, level.upper]
        for array in arrays:
            for spoil in (np.nan,) if array is level.upper else (np.nan, np.inf):
                where = (0,) * array.ndim
                array[where], saved = spoil, array[where]
                bad = workspace.solve(problem)
                assert not bad.status.solved, spoil
                assert np.isfinite(bad.x).all()
                array[where] = saved
                good = workspace.solve(problem)
                assert good.status is Status.OPTIMAL
                np.testing.assert_allclose(good.x, x, rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_levels_of_many_rows_against_the_reference() -> None:
    """From seven rows on, the secular equation is solved by Cholesky factors instead of rotations."""
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
    """A stage stopped at its first step keeps its point: in the box, with the levels above unchanged."""
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
    workspace.native.limit_stages(1e-9)  # the exact levels took all of the time
    stopped = workspace.solve(problem)
    assert stopped.status is Status.TIME_LIMIT
    assert np.all(problem.levels[0].slack(stopped.x) == 0.0)
    assert np.abs(above @ stopped.x).max() < 1e-9


def test_a_posture_takes_little_from_an_unmet_level() -> None:
    """||A (x - x_a)||^2 <= eta c omega ||w(x_a)||^2, else x_a would be better: one unmet level above a posture."""
    solver, unmet = hqp.solvers.load("lexicographic"), 0
    for seed in range(30):
        box, hand, *_, posture = continuity.levels(np.random.default_rng(seed), "beyond")
        problem = Hierarchy((box, hand, posture), constraints=1, prices=np.array([0.0, 0.1, 0.0]))
        solution = solver.solve(problem)
        if solution.stage_points is not None:
            point = solution.stage_points[1]
            moved = np.where(hand.equality, hand.A @ (solution.x - point), 0.0)
            most = 0.1 * problem.eta * np.linalg.norm(hand.slack(point)) * np.sum(posture.slack(point) ** 2)
            assert moved @ moved <= most + 1e-12
            unmet += 1
    assert unmet > 10


@pytest.mark.long
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


@pytest.mark.parametrize("count", [60, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize("family", [family for family in continuity.FAMILIES if family != "hard, small"])
def test_neighbouring_problems_have_neighbouring_answers(family: str, count: int) -> None:
    found = continuity.measure(family, count)
    assert found.jumps[1] == 0.0, found
    assert found.slope[1] < 5e3, found
    if family == "contradictory":
        assert found.jumps[0] > 0.5  # control: exact answers do jump


def test_what_a_solver_cannot_do_is_refused() -> None:
    problem = random_problem(np.random.default_rng(0), "plain")
    for name in ("weighted", "chiaverini"):
        with pytest.raises(UnsupportedProblem, match="price"):
            hqp.solvers.load(name).require(replace(problem.shape, inequalities=False))
    for name in ("nullspace", "cascade", "daqp"):
        if name in hqp.solvers.available():
            with pytest.raises(UnsupportedProblem, match="price"):
                hqp.solvers.load(name).solve(random_problem(np.random.default_rng(0), "plain", inequalities=False))
    for wrong in (np.array([-1.0, 0.0]), np.array([np.nan, 0.0]), np.array([1.0])):
        with pytest.raises(ProblemError, match="prices"):
            Hierarchy((Rows(np.eye(2), np.zeros(2), np.zeros(2)),) * 2, prices=wrong)
    with pytest.raises(ProblemError, match="eta"):
        Hierarchy((Rows(np.eye(2), np.zeros(2), np.zeros(2)),), eta=0.0)


def test_a_warm_row_whose_bound_has_gone_to_infinity() -> None:
    """G1 at torque level releases a foot: a row active at its upper bound in the last tick has no bound now."""
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
    """The stages start from the exact answer: without a complete one they do not run."""
    solver, cut = hqp.solvers.load("lexicographic", max_iterations=1), 0
    for i in range(20):
        problem, _ = stored(i)
        if solver.solve(problem.exact()).status is Status.ITERATION_LIMIT:
            assert solver.solve(problem).status is Status.ITERATION_LIMIT
            cut += 1
    assert cut > 5


def test_a_tick_solves_its_stages_once() -> None:
    """The kernel of a loop reports that stages follow; the answer reuses its result."""
    problem = next(
        p
        for p in (stored(i)[0] for i in range(20))
        if hqp.solvers.load("lexicographic").solve(p).stage_points is not None
    )
    workspace = hqp.solvers.load("lexicographic").workspace(problem.shape)

    class Counting:
        more = 0

        def __init__(self, stages: Any) -> None:
            self._stages = stages

        def __getattr__(self, name: str) -> Any:
            return getattr(self._stages, name)

        def follow(self, x: Any) -> bool:
            Counting.more += 1
            return bool(self._stages.follow(x))

    workspace.native = Counting(workspace.native)  # type: ignore[attr-defined]
    solve, *_ = workspace.kernel(problem)  # type: ignore[attr-defined]
    counts = solve()
    answer = workspace.answer(problem, counts)  # type: ignore[attr-defined]
    assert counts[0] == UNSETTLED
    assert Counting.more == 0
    expected = hqp.solvers.load("lexicographic").solve(problem)
    np.testing.assert_array_equal(answer.x, expected.x)
    np.testing.assert_array_equal(answer.stage_points, expected.stage_points)


@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(6), marks=pytest.mark.slow)], ids=["few", "many"])
@pytest.mark.parametrize(("family", "dense"), [*((family, False) for family in FAMILIES), ("kinds", True)])
def test_a_level_is_settled_alike_warm_or_cold(family: str, dense: bool, seeds: range) -> None:
    """Over problems that change slowly, then jump: multipliers of the last tick decide like fresh ones.

    dense: E by a matrix, as at torque level.
    """
    solver, decided = hqp.solvers.load("lexicographic"), set[bool]()
    for seed in seeds:
        rng = np.random.default_rng([seed, 7])
        one = random_problem(rng, family)
        if dense:
            one = replace(one, motion=Motion(np.eye(one.n)))
        turns = [rng.standard_normal(rows.dense(one.n).shape) for rows in one.levels]
        workspace = solver.workspace(one.shape)
        for tick in range(120):
            turn = 0.002 * tick if tick < 80 else rng.uniform()
            asked = 0.3 + 0.3 * math.sin(0.1 * tick)  # met for its price and unmet in turns
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
