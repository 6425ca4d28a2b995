"""Rounding decides nothing: a bound missed by rounding is met, and an entry of rounding is no direction."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hqp.solvers
from hqp import Hierarchy, Motion, Rows, Selection, Status, certificate
from hqp.problem.graded import Errors, pull
from hqp.tolerances import FEASIBILITY_TOLERANCE, LARGEST_ROUNDING, NULL_SPACE_ROUNDING, ROUNDED
from tests.scenes.priced import is_certain, is_unsure, priced_problem, solved_in_a_loop
from tests.solvers.digits import optimum


@pytest.mark.parametrize("seed", range(60))
def test_stages_do_not_depend_on_what_the_exact_answer_leaves_of_a_bound(seed: int) -> None:
    """A solve leaves 1e-11 of a row's length times ||x||: far more than 1e-10 of its terms if its long entries rest.

    A row held at a value that it misses by so little would be an equality in every stage.
    """
    rng, n = np.random.default_rng(seed), 6
    lengths = np.concatenate([[10.0 ** rng.uniform(-4.0, -2.0)], np.full(n - 1, 10.0 ** rng.uniform(0.0, 3.0))])
    C, A = rng.normal(size=(4, n)) * lengths, rng.normal(size=(4, n))
    x = np.concatenate([1e3 * rng.normal(size=1), rng.normal(size=n - 1)])
    upper = C[:, 0] * x[0] + 1e-2 * rng.uniform(-0.5, 0.5, 4) * np.abs(C @ x)
    levels = Rows(C, np.full(4, -np.inf), upper), Rows(A, A @ x, A @ x)
    prices = np.array([0.0, 10.0 ** rng.uniform(-3.0, 0.0)])
    problem = Hierarchy(levels, constraints=1, prices=prices, motion=Motion(np.ones(n)))
    solver = hqp.solvers.load("lexicographic")
    workspace: Any = solver.workspace(problem.shape)
    workspace.solve(problem)
    exact = solver.solve(problem.exact()).x
    left = FEASIBILITY_TOLERANCE * np.linalg.norm(C, axis=1) * np.linalg.norm(exact)
    held = np.abs(C @ exact - upper) < 100.0 * left
    ends = []
    for share in (0.0, 0.5, 0.9):
        missed = exact + np.linalg.lstsq(C[held], share * left[held], rcond=None)[0] if held.any() else exact
        workspace.native.follow(missed)
        ends.append(workspace.native.end().copy())
    assert np.abs(np.ptp(ends, axis=0)).max() < 1e-8 * np.linalg.norm(exact)


@pytest.mark.parametrize("seed", range(60))
def test_entries_within_their_error_add_no_direction(seed: int) -> None:
    """The slack is the best along all columns that the rows see; the last column is error."""
    rng = np.random.default_rng(seed)
    m, seen = 12, 5
    lengths = 10.0 ** rng.uniform(-1.0, 4.0, m)
    A = rng.normal(size=(m, seen)) * lengths[:, None]
    slack = rng.normal(size=m)
    slack -= A @ np.linalg.lstsq(A / lengths.max(), slack, rcond=None)[0] / lengths.max()
    errors = 1e-7 * lengths
    face = np.column_stack([A, errors * rng.uniform(-1.0, 1.0, m)])
    nothing = np.zeros((m, 0))
    none = Errors.none(m)
    clean = pull(A, nothing, slack, lengths, lengths, 0.0, none)
    known = pull(face, nothing, slack, lengths, lengths, 0.0, Errors(errors, np.zeros(m), np.zeros(m)))
    assert known.taken < 10.0 * clean.taken + 1e-9
    assert pull(face, nothing, slack, lengths, lengths, 0.0, none).taken > 1e3 * known.taken


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("kind", ["row_scales", "zero_rows"])
def test_a_verdict_does_not_depend_on_the_last_digits_of_an_answer(kind: str, flat: bool) -> None:
    """A short slack of a long row, of which rounding is a large share, turns the motion of the levels below."""
    solver, judged = hqp.solvers.load("lexicographic"), 0
    for seed in (9, 140, *range(100, 108)):
        problem, rng = priced_problem(kind, seed, flat), np.random.default_rng(seed)
        solution = solver.solve(problem)
        if solution.status is not Status.OPTIMAL or solution.stage_points is None:
            continue
        for digits in range(4):
            moved = 1.0 + 1e-16 * digits * np.sign(rng.normal(size=problem.n))
            verdict = certificate(problem, solution.x * moved, 1e-8, solution.stage_points * moved)
            assert verdict.ok, f"{seed}, {digits}: {verdict}"
        judged += 1
    assert judged


@pytest.mark.parametrize("seed", range(40))
def test_a_row_is_met_however_short_it_is_beside_others(seed: int) -> None:
    """A short row sees as much as a long one, in the unit of its length; only unseen directions are a free choice."""
    rng, n = np.random.default_rng(seed), 6
    C, x, B = rng.normal(size=(2, n)), rng.normal(size=n), rng.normal(size=(2, n))
    A = rng.normal(size=(3, n)) * 10.0 ** rng.permutation([-5.0, rng.uniform(-5.0, 4.0), 4.0])[:, None]
    levels = Rows(C, np.full(2, -np.inf), C @ x + 0.1), Rows(A, A @ x, A @ x)
    solution = hqp.solvers.load("lexicographic").solve(Hierarchy(levels, constraints=1, metric=B.T @ B))
    assert solution.status in (Status.OPTIMAL, Status.RANK_UNCERTAIN)
    missed = np.abs(A @ (solution.x - x)) / np.linalg.norm(A, axis=1)
    assert missed.max() < 1e-6 * (1.0 + np.linalg.norm(solution.x))


@pytest.mark.parametrize("seed", [1, 2, 9, 10, 11, 13, 20, 29, 30, 35, 36, 38, 49, 53, 57])
def test_stages_near_zero_do_not_have_the_rounding_of_an_answer_far_away(seed: int) -> None:
    """A level of a short row takes the answer 1e5 to 1e9 away after the stage of a priced level ended near zero.

    The verdict is the same for every answer within rounding, with the stage points or without.
    """
    rng, n = np.random.default_rng(seed), 8
    A, wide = rng.normal(size=(2, n)), 10.0 ** rng.uniform(-2.0, 0.0, 4)
    near, far = 3.0 * rng.normal(size=2), rng.normal(size=n)
    short = 10.0 ** rng.uniform(-9.0, -6.0) * rng.normal(size=(1, n))
    levels = (
        Rows(Selection(np.arange(4)), -wide, wide),
        Rows(A, near, near),
        Rows(short, np.ones(1), np.ones(1)),
        Rows(np.eye(n), far, far),
    )
    prices = np.array([0.0, 10.0 ** rng.uniform(-3.0, -1.0), 0.0, 10.0 ** rng.uniform(-3.0, -1.0)])
    problem = Hierarchy(levels, constraints=1, prices=prices, motion=Motion(rng.normal(size=(5, n))))
    solution = hqp.solvers.load("lexicographic").solve(problem)
    assert solution.status is Status.OPTIMAL
    assert solution.stage_points is not None
    for share in (0.0, 0.2):
        rounding = share * NULL_SPACE_ROUNDING * np.linalg.norm(solution.x) / np.sqrt(n)
        x = solution.x + rounding * np.sign(rng.normal(size=n))
        for stages in (solution.stage_points, None):
            verdict = certificate(problem, x, 1e-8, stages)
            assert verdict.ok, f"{share}: {verdict}"


@pytest.mark.parametrize("seed", range(60))
def test_rounding_of_entries_pulls_by_the_slack_of_the_rows_as_given(seed: int) -> None:
    """Each entry of the last column is an error of ROUNDED of its row.  The slack is the best of the other columns, and
    long rows have little of it: reflections give it to short rows."""
    rng, m, tolerance = np.random.default_rng(seed), 40, 1e-8
    lengths = 10.0 ** rng.uniform(-2.0, 2.0, m)
    face = rng.normal(size=(m, 30)) * lengths[:, None]
    slack = rng.normal(size=m)
    Q = np.linalg.qr(face)[0]
    slack -= Q @ (Q.T @ slack)
    none = Errors.none(m)
    along = ROUNDED * lengths * np.sign(slack)
    found = pull(face, along[:, None], slack, lengths, lengths, ROUNDED / tolerance, none)
    assert 0.1 * tolerance < abs(found.along[0]) / found.size <= 1.001 * tolerance


@pytest.mark.parametrize("seed", range(60))
def test_an_optimum_that_balances_rounding_of_long_rows_is_one(seed: int) -> None:
    """Long rows see the face by rounding alone and keep their slack: they pull as hard as rows 1e8 times shorter."""
    rng, free = np.random.default_rng(seed), 6
    long, short = 10.0 ** rng.uniform(1.0, 3.0, 2), 10.0 ** rng.uniform(-6.5, -5.5, 12)
    lengths, slack = np.concatenate([long, short]), np.concatenate([rng.normal(size=2), rng.normal(size=12) * short])
    B = rng.normal(size=(12, free)) / np.sqrt(free) * short[:, None]
    rounding = 0.3 * NULL_SPACE_ROUNDING * long[:, None] * rng.uniform(-1.0, 1.0, (2, free)) / np.sqrt(free)
    nothing, none = np.zeros((14, 0)), Errors.none(14)

    def taken(times: float) -> float:
        """The share that the best step takes of a row that balances so much of the rounding."""
        left = np.linalg.qr(B)[0]
        own = slack[2:] - left @ (left.T @ slack[2:])
        own -= np.linalg.lstsq(B.T, times * rounding.T @ slack[:2], rcond=None)[0]
        face, every = np.concatenate([rounding, B]), np.concatenate([slack[:2], own])
        return pull(face, nothing, every, lengths, lengths, 0.0, none).taken

    assert taken(1.0) == 0.0
    assert taken(1e6) > 1e-8


@pytest.mark.parametrize("seed", range(60))
def test_what_balances_a_known_error_of_rows_stays(seed: int) -> None:
    """The slack is best with an error of long rows that is taken out before they are judged: the step back is zero, and
    the gradient along active rows is that without it."""
    rng = np.random.default_rng(seed)
    long, short = 10.0 ** rng.uniform(1.0, 3.0, 2), 10.0 ** rng.uniform(-6.5, -5.5, 12)
    lengths, both = np.concatenate([long, short]), rng.normal(size=(12, 8)) / np.sqrt(8.0) * short[:, None]
    error, none = 1e-12 * long[:, None] * rng.uniform(-0.1, 0.1, (2, 6)), np.zeros((2, 8))
    slack = np.concatenate([rng.normal(size=2), rng.normal(size=12) * short])
    left = np.linalg.qr(both)[0]
    slack[2:] -= left @ (left.T @ slack[2:])
    slack[2:] -= np.linalg.lstsq(both.T, np.append(error.T @ slack[:2], np.zeros(2)), rcond=None)[0]
    parts = (*np.split(np.concatenate([none, both]), [6], axis=1), slack, lengths, lengths, ROUNDED / 1e-8)
    row = np.append(1e-12 * long, np.zeros(12))
    known = pull(*parts, replace(Errors.none(14), row=row))
    assert known.taken == 0.0
    exact = pull(*parts, Errors.none(14))
    assert exact.taken > 1e-8
    assert np.linalg.norm(known.along) < 0.1 * np.linalg.norm(exact.along)


@pytest.mark.parametrize("seed", range(40))
def test_rows_of_one_level_that_differ_in_length_keep_their_own_rounding(seed: int) -> None:
    """Most of the drawn rows are 1e3 to 1e8 times shorter than the longest, and motion sees a part of x."""
    rng, n = np.random.default_rng(seed), int(np.random.default_rng(seed).integers(4, 8))
    A = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-6.0, 2.0, (n, 1))
    goal, F = np.linalg.norm(A, axis=1) * rng.normal(size=n), rng.normal(size=(int(rng.integers(1, n)), n))
    price = 10.0 ** rng.uniform(-3.0, 0.0, 1)
    problem = Hierarchy((Rows(A, goal, goal.copy()),), prices=price, motion=Motion(F, rng.normal(size=len(F))))
    solution = solved_in_a_loop(hqp.solvers.load("lexicographic"), problem)
    assert solution.status is Status.OPTIMAL
    verdict = certificate(problem, solution.x, 1e-8, solution.stage_points)
    assert verdict.ok, str(verdict)


@pytest.mark.parametrize("seed", range(40))
def test_nearly_parallel_rows_hold_motion_beside_directions_without_motion(seed: int) -> None:
    """Two directions without motion meet two of the three rows, so the third, 1e-6 to 1e-4 from parallel, holds motion.

    An anchored level counts its turning beside that row.
    """
    rng, n = np.random.default_rng(seed), 6
    C = rng.normal(size=n) + 10.0 ** rng.uniform(-6.0, -4.0) * rng.normal(size=(3, n))
    A, B, x = rng.normal(size=(1, n)), rng.normal(size=(2, n)), rng.normal(size=n)
    levels = [Rows(M, goal, goal.copy()) for M, goal in ((C, C @ x), (A, np.full(1, 30.0)), (B, np.full(2, 20.0)))]
    prices, turning = np.array([0.0, 1.0, 0.0]), np.array([0.0, 3.0, 0.0])
    motion = Motion(rng.normal(size=(n - 2, n)))
    problem = Hierarchy(tuple(levels), constraints=1, prices=prices, motion=motion, turning=turning)
    solution = solved_in_a_loop(hqp.solvers.load("lexicographic"), problem)
    verdict = certificate(problem, solution.x, 1e-8, solution.stage_points)
    assert verdict.ok or solution.status is Status.RANK_UNCERTAIN, str(verdict)


def test_last_digits_of_nearly_parallel_rows_do_not_move_a_certain_answer() -> None:
    """Multipliers of rows 1e-7 to 1e-4 from parallel are so large that their rounding turns the motion."""
    solver, certain, farthest = hqp.solvers.load("lexicographic"), 0, 0.0
    for seed in range(200):
        rng, n = np.random.default_rng(seed), 5
        C = rng.normal(size=n) + 10.0 ** rng.uniform(-7.0, -4.0) * rng.normal(size=(3, n))
        c = C @ rng.normal(size=n)
        A = rng.normal(size=2) @ C[:2] + 10.0 ** rng.uniform(-7.0, -3.0) * rng.normal(size=(1, n))
        a = A @ rng.normal(size=n) + 1e3 * rng.normal(size=1)
        prices = np.array([0.0, 10.0 ** rng.uniform(-4.0, 0.0)])
        answers = []
        for noise in (0.0, *[NULL_SPACE_ROUNDING] * 3):
            levels = [
                Rows(M * (1.0 + noise * rng.uniform(-1.0, 1.0, M.shape)), m, m.copy()) for M, m in ((C, c), (A, a))
            ]
            answers.append(solved_in_a_loop(solver, Hierarchy(tuple(levels), constraints=1, prices=prices)))
        if all(answer.status is Status.OPTIMAL for answer in answers):
            x = np.array([answer.x for answer in answers])
            farthest = max(farthest, float(np.linalg.norm(x[1:] - x[0], axis=1).max() / np.linalg.norm(x[0])))
            certain += 1
    assert certain > 180
    assert farthest < LARGEST_ROUNDING


@pytest.mark.long
def test_active_rows_make_no_verdict_stricter() -> None:
    """The optimum of a level among more points is its optimum among fewer: a row that pulls by rounding alone is free.

    At the apex of a cone the gradient along rows without multipliers is rounding of the long rows of the level.
    """
    n, right = 8, 0
    for seed in range(250):
        rng = np.random.default_rng(seed)
        m = int(rng.integers(n + 1, 30))
        lengths = 10.0 ** rng.uniform(-3.0, 4.0, m)
        A, x = rng.normal(size=(m, n)) * lengths[:, None], rng.normal(size=n)
        across = np.linalg.svd((A / lengths[:, None]).T)[2][n:]
        slack = across.T @ rng.normal(size=m - n) / lengths
        slack *= lengths.min() * 10.0 ** rng.uniform(-2.0, 3.0) / np.abs(slack).max()
        level = Rows(A, target := A @ x + slack, target)
        x += 10.0 ** rng.uniform(-12.0, -7.0) * rng.normal(size=n)
        C = rng.normal(size=(int(rng.integers(1, n)), n))
        if not certificate(Hierarchy((level,)), x, 1e-8).ok:
            continue
        held = Hierarchy((Rows(C, np.full(len(C), -np.inf), C @ x), level), constraints=1)
        verdict = certificate(held, x, 1e-8)
        assert verdict.ok, f"{seed}: {verdict}"
        right += 1
    assert right > 100


@pytest.mark.long
def test_a_row_that_the_best_step_leaves_stops_it() -> None:
    """A row that misses by 1 sees 1e-7 to 1e-4 of a direction, far away, and rows of its level are at their bounds.

    The bounds pull back at once: points within 1e-9 of the optimum in 160 digits pass, 1e-5 beyond they do not.
    """
    right = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        n, m = int(rng.integers(4, 6)), int(rng.integers(1, 3))
        a, b = rng.normal(size=(2, n)), rng.normal(size=3)
        far = np.stack([a[0], a[0] + 10.0 ** rng.uniform(-6.0, -3.0) * rng.normal(size=n), a[1]])
        x = np.linalg.pinv(far) @ b
        own = np.concatenate([a[1:] + 10.0 ** rng.uniform(-7.0, -4.0) * rng.normal(size=n), rng.normal(size=(m, n))])
        goal, bounds = np.array([b[2] + 1.0]), own[1:] @ x
        level = Rows(own, np.concatenate([goal, np.full(m, -np.inf)]), np.concatenate([goal, bounds]))
        problem = Hierarchy((Rows(far, b, b), level), constraints=1)
        best = optimum(*problem.levels)
        if best is None or np.linalg.norm(x - best) > 1e-9 * np.linalg.norm(best):
            continue
        right += 1
        assert certificate(problem, best, 1e-8).ok, seed
        assert certificate(problem, x, 1e-8).ok, seed
        beyond = (Z := np.linalg.svd(far)[2][3:]).T @ (Z @ own[1])
        beyond *= 1e-5 * np.linalg.norm(x) / np.linalg.norm(beyond)
        assert not certificate(problem, x + beyond, 1e-8).ok, seed
    assert right > 40


@pytest.mark.long
def test_rounding_of_a_point_far_away_frees_no_row_that_holds_the_completion() -> None:
    """Rows take x 1e3 to 1e6 away, other variables are bounded by 1, and a metric chooses.

    A point passes at 1e-11 of x from the optimum in 160 digits, off its bounds by as much, not at 1e-6.
    """
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(3, 7))
        a, b, F = rng.normal(size=n), rng.normal(size=2), rng.normal(size=(n, n))
        far = np.stack([a, a + 10.0 ** rng.uniform(-6.0, -3.0) * rng.normal(size=n)])
        single = np.eye(n)[: int(rng.integers(1, n - 1))]
        limit = rng.uniform(0.1, 2.0, len(single))
        hard = Rows(np.concatenate([far, single]), np.concatenate([b, -limit]), np.concatenate([b, limit]))
        problem = Hierarchy((hard,), constraints=1, metric=F.T @ F)
        best = optimum(hard, Rows(F, np.zeros(n), np.zeros(n)))
        assert best is not None
        step = (Z := np.linalg.svd(far)[2][2:]).T @ rng.normal(size=len(Z))
        step *= np.linalg.norm(best) / np.linalg.norm(step)
        near = best + 1e-11 * step
        near[: limit.size] = np.clip(near[: limit.size], -limit, limit)
        assert certificate(problem, near, 1e-8).ok, seed
        assert not certificate(problem, best + 1e-6 * step, 1e-8).ok, seed


@pytest.mark.long
def test_a_direction_that_a_level_hardly_sees_may_end_anywhere() -> None:
    """A level sees 1e-11 to 1e-5 of a direction that bounds hold, and its rows conflict along all others.

    A point off the bound passes where the way to it changes no row by 1e-9, and fails where it changes one by 3e-8.
    """
    seen = {True: 0, False: 0}
    for seed in range(300):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(3, 7))
        a, last, slight = np.append(rng.normal(size=n - 1), 0.0), np.eye(n)[-1], 10.0 ** rng.uniform(-11.0, -5.0)
        A, b = np.stack([a / np.linalg.norm(a) + slight * last, a / np.linalg.norm(a)]), np.array([1.0, -1.0])
        if seed % 2:  # a row so short that the level is judged row by row
            A, b = (
                np.vstack([A, np.append(rng.normal(size=n - 1), 0.0) * 10.0 ** rng.uniform(-4.0, -2.5)]),
                [1.0, -1.0, 0.0],
            )
        x = np.append(np.zeros(n - 1), rng.uniform(-0.9, 0.9))
        x += np.append(np.linalg.lstsq(A[:, :-1], b - A @ x, rcond=None)[0], 0.0)
        bounds = Rows(Selection(np.arange(n)), -np.ones(n), np.ones(n))
        rest = Rows(last[None], x[-1:], x[-1:])
        problem = Hierarchy((bounds, Rows(A, b, b), rest), constraints=1)
        change = slight * (1.0 - x[-1])
        if change < 1e-9 or change > 3e-8:
            assert certificate(problem, x, 1e-8).ok == (change < 1e-9), seed
            seen[change < 1e-9] += 1
    assert min(seen.values()) > 100


@pytest.mark.parametrize("seed", range(100))
def test_a_row_that_a_face_nearly_hides_pulls_there_all_the_same(seed: int) -> None:
    """Rows repeat constraints but for 1e-10 to 1e-7 and miss by 1e2 to 1e4; bounds hold others by rounding.

    Without that pull 17 of these answers are uncertain.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(6, 20))
    m, b, few = int(rng.integers(2, n)), rng.uniform(0.5, 2.0, n), int(rng.integers(1, 4))
    A, x = rng.normal(size=(m, n)), np.where(rng.random(n) < 0.3, b, rng.uniform(-0.5, 0.5, n))
    slight = 10.0 ** rng.uniform(-10.0, -7.0) * rng.normal(size=(few, n))
    hidden, others = A[rng.integers(m, size=few)] + slight, rng.normal(size=(n - m, n))
    goal = np.concatenate([10.0 ** rng.uniform(2.0, 4.0) * rng.normal(size=few), others @ x])
    level = Rows(np.concatenate([hidden, others]), goal, goal)
    problem = Hierarchy((Rows(Selection(np.arange(n)), -b, b), Rows(A, A @ x, A @ x), level), constraints=2)
    assert is_certain(hqp.solvers.load("lexicographic"), problem, seed)


@pytest.mark.long
def test_an_answer_that_rests_on_a_rank_near_either_reading_is_not_certain() -> None:
    """Rows repeat others but for 3e-11 to 3e-9, some of them 1e3 shorter: a rank of 1e-11 of their length may count."""
    solver, certain = hqp.solvers.load("lexicographic"), 0
    for seed in range(400):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(4, 8))
        levels, pool = [], rng.normal(size=(1, n))
        for k in range(3):
            m = int(rng.integers(2, 5))
            A = rng.normal(size=(m, n))
            for i in range(m):
                if rng.random() < 0.5:
                    A[i] = pool[rng.integers(len(pool))] + 10.0 ** rng.uniform(-10.5, -8.5) * rng.normal(size=n)
            pool = np.vstack([pool, A])
            length = 10.0 ** rng.uniform(-3.0, 0.0, size=(m, 1)) if k else np.ones((m, 1))
            b = rng.normal(size=m)
            low = np.where(rng.random(m) < (0.7 if k else 0.3), b, -np.inf)
            levels.append(Rows(length * A, length[:, 0] * low, length[:, 0] * b))
        case = Hierarchy(tuple(levels), 1)
        certain += is_certain(solver, case, seed)
    assert certain > 80


@pytest.mark.long
@pytest.mark.parametrize("most", [-4.0, -3.0])
def test_a_level_met_for_its_price_has_multipliers_that_meet_its_rows(most: float) -> None:
    """Rows repeat others but for 1e-6 to 1e-2, beside directions without motion: squares lose their remainders."""
    solver, certain = hqp.solvers.load("lexicographic"), 0
    for seed in range(320):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(6, 12))
        moving, seen, levels = int(rng.integers(2, n - 2)), rng.normal(size=(1, n)), []
        for _ in range(2):
            error, A = 10.0 ** rng.uniform(most - 1.0, most), rng.normal(size=(3, n))
            for i in range(3):
                if rng.random() < 0.6:
                    A[i] = seen[rng.integers(len(seen))] + error * 10.0 ** rng.uniform(-1.0, 1.0) * rng.normal(size=n)
                seen = np.vstack([seen, A[i]])
            b = rng.normal(size=3)
            levels.append(Rows(A, b, b))
        motion = Motion(rng.normal(size=(moving, n)), np.zeros(moving))
        prices, turning = (
            np.array([0.0, 10.0 ** rng.uniform(-4.0, 0.0)]),
            np.array([0.0, 10.0 ** rng.uniform(-1.0, 2.0)]),
        )
        certain += is_certain(solver, Hierarchy(tuple(levels), 1, prices=prices, turning=turning, motion=motion), seed)
    assert certain > 240


@pytest.mark.long
def test_noise_moves_no_certain_answer_out_of_a_narrow_wedge() -> None:
    """Rows are opposed but for a tilt of 1e-9 to 1e-6, and a level pulls beyond them.

    Noise of 1e-12 moves the apex by up to 1e-3 of x.
    """
    solver, certain = hqp.solvers.load("lexicographic"), 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(4, 9))
        A, x = rng.normal(size=(2, n)), 100.0 * rng.normal(size=n)
        wedge = np.concatenate([A, -A + 10.0 ** rng.uniform(-9.0, -6.0) * rng.normal(size=(2, n))])
        B, C = rng.normal(size=(int(rng.integers(1, n - 1)), n)), rng.normal(size=(2, n))
        goals = B @ x + 10.0 * rng.normal(size=len(B)), 10.0 * rng.normal(size=2)
        answers = []
        for noise in (0.0, 1e-12):
            W, top, *rows = (1.0 + noise * rng.normal(size=a.shape) for a in (wedge, wedge[:, 0], B, C))
            limits = Rows(Selection(np.arange(n)), np.full(n, -300.0), np.full(n, 300.0))
            levels = [limits, Rows(wedge * W, np.full(4, -np.inf), wedge @ x * top)]
            levels += [Rows(a * r, goal, goal) for a, r, goal in zip((B, C), rows, goals, strict=True)]
            answers.append(solved_in_a_loop(solver, Hierarchy(tuple(levels), 2)))
        if any(is_unsure(answer) or not answer.status.solved for answer in answers):
            continue
        certain += 1
        one, other = (answer.x for answer in answers)
        assert np.abs(one - other).max() < 1e-4 * np.abs(one).max(), seed
    assert certain > 60


@pytest.mark.long
def test_a_level_that_is_not_met_hands_down_the_values_of_its_own_stage() -> None:
    """Rows of all levels repeat two but for 1e-11 to 1e-5; the second level, without a price, conflicts in itself."""
    solver, certain = hqp.solvers.load("lexicographic"), 0
    for seed in range(340):
        rng = np.random.default_rng(seed)
        n, levels = int(rng.integers(5, 10)), []
        seen = rng.normal(size=(2, n))
        for k in range(4):
            m = int(rng.integers(1, 5))
            A = seen[rng.integers(len(seen), size=m)] * rng.choice([-1.0, 1.0, 2.0], size=(m, 1))
            A = A + 10.0 ** rng.uniform(-11.0, -5.0, size=(m, 1)) * rng.normal(size=(m, n))
            seen, b = np.vstack([seen, A]), rng.normal(size=m)
            levels.append(Rows(A, b if k in (1, 3) else np.full(m, -np.inf), b))
        low = [-3.0, -2.0, -2.0]
        prices = np.insert(10.0 ** rng.uniform(low, 0.0), 1, 0.0)
        certain += is_certain(solver, Hierarchy(tuple(levels), 4, prices=prices, turning=np.ones(4)), seed)
    assert certain > 135
