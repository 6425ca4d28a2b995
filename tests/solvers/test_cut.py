"""A cut search returns the lexicographically better of its point and the last answer, clipped into the box."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Hierarchy, Rows, Selection, Status
from hqp.solvers import lexicographic
from hqp.solvers.lexicographic import Lexicographic
from hqp.tolerances import VIOLATION_TOLERANCE
from tests.scenes.kinds import problem as drawn_problem

if lexicographic.kernel() == "":
    pytest.skip("built without the native kernel", allow_module_level=True)

KINDS = ("plain", "conflicts", "vertex", "many_levels", "mixture")


def is_worse(problem: Hierarchy, x: np.ndarray, last: np.ndarray) -> bool:
    for new, old in zip(problem.slacks(x), problem.slacks(problem.boxed(last)), strict=True):
        a, b = float(np.linalg.norm(new)), float(np.linalg.norm(old))
        if abs(a - b) > VIOLATION_TOLERANCE * (1.0 + max(a, b)):
            return a > b
    return False


def boxed(problem: Hierarchy, rng: np.random.Generator) -> Hierarchy:
    """The problem below a box, as for robots."""
    n = problem.n
    room = rng.uniform(0.2, 2.0, n)
    return Hierarchy((Rows(Selection(np.arange(n)), -room, room), *problem.levels), constraints=1)


def next_tick(problem: Hierarchy, rng: np.random.Generator, by: float = 1.0) -> Hierarchy:
    """Problem near the given one, with a last answer outside the box."""
    levels = []
    for rows in problem.levels:
        moved = by * rng.normal(0.0, 0.1, rows.m)
        A: Any = rows.A
        if not isinstance(A, Selection):
            A = A + by * 0.02 * rng.normal(size=A.shape)
        levels.append(Rows(A, rows.lower + moved, rows.upper + moved))
    return replace(problem, levels=tuple(levels))


def cut_answers(solver: Lexicographic, seconds: float, prices: float, by: float = 1.0) -> tuple[int, int]:
    """Count cut answers of loops, and those that are worse than the last answer; by: size of the changes."""
    cut = worse = 0
    for kind in KINDS:
        for seed in range(4):
            rng = np.random.default_rng(seed)
            problem = boxed(drawn_problem(kind, seed)[0], rng)
            if prices:
                problem = replace(problem, prices=np.array([0.0] + [prices] * (len(problem.levels) - 1)))
            workspace = solver.workspace(problem.shape)
            last = np.zeros(problem.n)
            for k in range(8):
                workspace.limit(seconds if k else 1e3)  # type: ignore[attr-defined]
                solution = workspace.solve(problem)
                if solution.status in (Status.TIME_LIMIT, Status.ITERATION_LIMIT):
                    cut += 1
                    worse += is_worse(problem, solution.x, last)
                    told, own = (np.concatenate(w) for w in (solution.residuals, problem.slacks(solution.x)))
                    np.testing.assert_allclose(told, own, rtol=0.0, atol=1e-9)
                last = solution.x.copy()
                solution.x[:] = np.nan  # the caller owns it
                problem = next_tick(problem, rng, by)
    return cut, worse


@pytest.mark.parametrize("prices", [0.0, 0.1], ids=["exact", "priced"])
@pytest.mark.parametrize("most", [1, 3, 6])
def test_after_too_many_iterations_no_answer_is_worse_than_the_last(most: int, prices: float) -> None:
    for by in (1.0, 1e-3):
        cut, worse = cut_answers(Lexicographic(max_iterations=most), 1e3, prices, by)
        assert cut > 20 * by
        assert worse == 0


@pytest.mark.parametrize("prices", [0.0, 0.1], ids=["exact", "priced"])
def test_after_the_deadline_no_answer_is_worse_than_the_last(prices: float) -> None:
    for seconds in (1e-6, 2e-5, 5e-5):
        cut, worse = cut_answers(Lexicographic(), seconds, prices)
        assert worse == 0
        assert cut > 0 or seconds > 1e-6


def test_a_workspace_that_forgot_compares_with_rest() -> None:
    rng = np.random.default_rng(0)
    problem = boxed(drawn_problem("conflicts", 1)[0], rng)
    workspace = Lexicographic(max_iterations=1).workspace(problem.shape)
    for _ in range(3):
        solution = workspace.solve(problem)
        assert not is_worse(problem, solution.x, np.zeros(problem.n))
        workspace.reset()


def test_nothing_of_the_last_answer_is_left_after_a_reset() -> None:
    rng = np.random.default_rng(0)
    problem = boxed(drawn_problem("conflicts", 1)[0], rng)
    used, fresh = (Lexicographic().workspace(problem.shape) for _ in range(2))
    used.solve(problem)
    used.reset()
    for workspace in (used, fresh):
        workspace.limit(1e-9)  # type: ignore[attr-defined]
    after, first = used.solve(problem), fresh.solve(problem)
    assert after.status is first.status is Status.TIME_LIMIT
    np.testing.assert_array_equal(after.x, first.x)


def priced_loops() -> Iterator[tuple[Hierarchy, np.random.Generator, Any]]:
    """Priced problems with an unmet level, refilled in place, and a workspace with their last solution."""
    for kind in KINDS:
        for seed in range(6):
            rng = np.random.default_rng(seed)
            problem = boxed(drawn_problem(kind, seed)[0], rng)
            prices = np.array([0.0] + [0.1] * (len(problem.levels) - 1))
            problem = replace(problem, prices=prices).copy()
            workspace: Any = Lexicographic().workspace(problem.shape)
            workspace.solve(problem)
            if workspace.native.prefix:
                yield problem, rng, workspace


def move(problem: Hierarchy, rng: np.random.Generator, by: float) -> None:
    for rows in problem.levels[1:]:
        moved = by * rng.normal(size=rows.m)
        rows.lower[:] += moved
        rows.upper[:] += moved


def test_a_cut_solve_keeps_the_level_that_the_next_begins_at() -> None:
    """Otherwise the next solve begins with all levels, misses the deadline again: cut in every tick."""
    kept = met = 0
    for problem, rng, workspace in priced_loops():
        head = workspace.native.prefix
        move(problem, rng, 1.0)
        workspace.limit(1e-9)
        assert workspace.solve(problem).status is Status.TIME_LIMIT
        after = workspace.native.prefix
        kept += after > 0
        if after == 0:  # the levels above were solved, and that level was met
            fresh: Any = Lexicographic().workspace(problem.shape)
            fresh.solve(problem)
            assert fresh.native.prefix != head
            met += 1
    assert kept > 20
    assert met < 5


@pytest.mark.parametrize("native", [False, True], ids=["general", "kernel"])
def test_a_level_that_is_met_by_now_is_no_longer_the_first(native: bool) -> None:
    """Otherwise every solve spends its time on that level before it begins with all of them: cut in every tick."""
    seen = 0
    for problem, _, workspace in priced_loops():
        kernel: Any = workspace.kernel(problem) if native else None
        for rows in problem.levels[1:]:
            rows.lower[:], rows.upper[:] = -1e3, 1e3
        workspace._exact.limit(1e-9)
        cut = kernel[0]()[0] == 5 if native else workspace.solve(problem).status is Status.TIME_LIMIT
        if cut:
            assert workspace.native.prefix == 0
            seen += 1
    assert seen > 10


@pytest.mark.long
def test_stages_begin_with_the_latest_working_set() -> None:
    """Stages of a slightly changed problem take fewer steps from the latest working set than from none."""
    warm = cold = 0
    for problem, rng, workspace in priced_loops():
        for by in (0.03, 0.03, 0.03, 0.1, 0.1, 0.1):
            move(problem, rng, by)
            found = workspace.solve(problem)
            fresh: Any = Lexicographic().workspace(problem.shape)
            np.testing.assert_allclose(found.x, fresh.solve(problem).x, rtol=1e-6, atol=1e-6)
            warm += workspace.native.effort()[0]
            cold += fresh.native.effort()[0]
    assert warm < 0.25 * cold, (warm, cold)


def out_of_reach(deadline: float) -> tuple[Any, Any]:
    """G1 session with an unreachable hand target, after four ticks, and the hand's task."""
    robot, hand = hqp.robots.load("g1"), hqp.tasks.Position(frame="right_wrist_yaw_link", name="hand")
    feet = [hqp.tasks.FixedContact(frame=frame) for frame in robot.landmarks["soles"]]
    stack = hqp.Stack(hqp.Level(hand), hqp.Level(hqp.tasks.Posture()), subject_to=[*feet, hqp.tasks.JointLimits()])
    run = hqp.Controller(stack, deadline=deadline).session(robot, 0.002)
    for _ in range(4):
        run.step(robot.state(), hand.at(np.array([3.0, 0.0, 1.0])))
    return run, hand


def drawn_pose(robot: hqp.robots.Robot, rng: np.random.Generator) -> np.ndarray:
    return robot.integrate(robot.home, rng.normal(0.0, 0.3, robot.nv) * (np.arange(robot.nv) > 5), 1.0)


def test_a_cut_tick_keeps_it() -> None:
    run, hand = out_of_reach(np.inf)
    assert run.workspace.native.prefix == 2
    run.workspace.limit(1e-9)  # type: ignore[attr-defined]
    rng = np.random.default_rng(0)
    for _ in range(4):
        q = drawn_pose(run.line.robot, rng)
        run.step(run.line.robot.state(q), hand.at(rng.normal(size=3) + [3.0, 0.0, 1.0]))
        assert run.workspace.native.prefix == 2


def test_a_tick_forgets_a_level_that_is_met_by_now() -> None:
    run, hand = out_of_reach(np.inf)
    assert run.workspace.native.prefix == 2
    state = run.line.robot.state()
    before = run.step(state, hand.at(np.array([3.0, 0.0, 1.0])))
    rate = run.problem.levels[2].dense(run.problem.n) @ before.x
    run.workspace._exact.limit(1e-9)
    tick = run.step(state, hand.at(state.position("right_wrist_yaw_link"), velocity=rate))
    assert tick.status is Status.TIME_LIMIT
    assert run.workspace.native.prefix == 0
