"""The certificate: accepts planted optima, rejects every kind of wrong answer."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import Generator

from hqp import Hierarchy, Rows, Selection, certificate
from hqp.errors import ProblemError
from hqp.problem.nnls import nonnegative_least_squares
from tests.scenes import problems

SEEDS = range(60)


def projector(problem: Hierarchy, levels: int | None = None) -> np.ndarray:
    """Recursive projector by SVD over the first levels; skips inequality rows."""
    x, Z = np.zeros(problem.n), np.eye(problem.n)
    for rows in problem.levels[:levels]:
        A, b = rows.dense(problem.n)[rows.equality], rows.lower[rows.equality]
        if not A.size or not Z.size:
            continue
        U, sigma, Vt = np.linalg.svd(A @ Z)
        rank = int(np.sum(sigma > 1e-9 * np.linalg.norm(A, axis=1).max()))
        x = x + Z @ Vt[:rank].T @ (U[:, :rank].T @ (b - A @ x) / sigma[:rank])
        Z = Z @ Vt[rank:].T
    return x


def planted(rng: Generator, scales: bool = False, lean: float = 1.0) -> tuple[Hierarchy, np.ndarray]:
    """A hierarchy whose unique optimum is known: rows are drawn, then bent so that multipliers of the right
    sign, those of inequalities about as large as ``lean``, close the optimality conditions of every level at a
    chosen x."""
    n, x = 7, rng.normal(size=7)
    above: list[tuple[np.ndarray, np.ndarray]] = []  # per level: rows that can carry a multiplier, its sign (0 free)
    levels = []
    for k in range(4):
        last = k == 3
        m = n if last else int(rng.integers(2, 6))
        kind = np.zeros(m, dtype=int) if last else rng.integers(0, 4, size=m)  # equality, violated, active, inactive
        force = np.zeros(n)
        for A, sign in above:
            weight = np.where(
                sign == 0, rng.normal(size=sign.size), lean * sign * rng.uniform(0.1, 1.0, size=sign.size)
            )
            force += A.T @ (weight * (rng.random(sign.size) < 0.6))
        w = np.where(kind == 0, rng.normal(size=m), 0.0)
        w[kind == 1] = rng.uniform(0.2, 1.0, size=int(np.sum(kind == 1)))
        if last:
            A, w = np.eye(n), -force
        elif not np.any(w):
            A = rng.normal(size=(m, n))  # no multipliers: x meets this level
        else:
            A = rng.normal(size=(m, n))
            A -= np.outer(w, A.T @ w + force) / (w @ w)
        value = A @ x
        upper = np.where(kind == 3, value + 0.5, value - w)
        lower = np.where(kind == 0, upper, upper - 3.0)
        scale = 10.0 ** rng.uniform(-3, 3) if scales else 1.0
        levels.append(Rows(scale * A, scale * lower, scale * upper))
        carries = kind != 3
        above.append((A[carries], np.where(kind == 2, 1, 0)[carries]))
    return Hierarchy(tuple(levels)), x


@pytest.mark.parametrize("scales", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_planted_optima_are_accepted_and_their_neighbours_are_not(seed: int, scales: bool) -> None:
    rng = np.random.default_rng(seed)
    problem, x = planted(rng, scales)
    verdict = certificate(problem, x)
    assert verdict.ok, str(verdict)
    assert verdict.gap < 1e-10
    for _ in range(5):
        step = rng.normal(size=problem.n)
        assert not certificate(problem, x + 1e-3 * step / np.linalg.norm(step)).ok


@pytest.mark.parametrize("seed", SEEDS)
def test_multipliers_close_the_conditions_with_the_right_signs(seed: int) -> None:
    problem, x = planted(np.random.default_rng(seed))
    verdict = certificate(problem, x)
    stacked = np.vstack([rows.dense(problem.n) for rows in problem.levels])
    met = np.concatenate([~rows.equality & (np.abs(rows.slack(x)) < 1e-9) for rows in problem.levels])
    locked = np.zeros(met.size, dtype=bool)
    for k, lam in enumerate(verdict.multipliers):
        own = lam[lam.size - problem.levels[k].m :]
        np.testing.assert_array_equal(own, problem.levels[k].slack(x))
        assert np.abs(stacked[: lam.size].T @ lam).max() < 1e-9
        free = locked[: lam.size]
        assert np.all(lam[met[: lam.size] & ~free] >= -1e-12)  # all active sides are upper ones
        locked[: lam.size] |= met[: lam.size] & (lam > 1e-6)


@pytest.mark.parametrize("name", ["a38", "a57", "f62eq"])
def test_the_projector_is_the_optimum_of_equalities(name: str) -> None:
    for problem in problems.load(name, 5):
        x = projector(problem)
        verdict = certificate(problem, x)
        assert verdict.gap < 1e-9, str(verdict)
        assert sum(verdict.ranks) == problem.n


@pytest.mark.parametrize("name", ["a38", "f62eq"])
def test_a_dropped_level_is_seen_at_that_level(name: str) -> None:
    for problem in problems.load(name, 5):
        for k in range(1, len(problem.levels)):
            fewer = Hierarchy(problem.levels[:k] + problem.levels[k + 1 :], n=problem.n)
            gaps = certificate(problem, projector(fewer)).gaps
            if np.linalg.norm(problem.levels[k].slack(projector(problem))) < 1e-9:  # else the level changes nothing
                assert gaps[k] > 1e-6
            assert np.all(gaps[:k] < 1e-9)


@pytest.mark.parametrize("name", ["b5_38", "b15_38"])
def test_a_clipped_projector_is_rejected(name: str) -> None:
    for problem in problems.load(name, 10):
        limits = problem.levels[0]
        x = projector(problem)
        clipped = np.clip(x[limits.A.index], limits.lower, limits.upper)
        assert np.any(clipped != x[limits.A.index])
        x[limits.A.index] = clipped
        verdict = certificate(problem, x)
        assert verdict.gaps[0] < 1e-12
        assert not verdict.ok


def test_a_weighted_answer_is_rejected() -> None:
    rng = np.random.default_rng(3)
    levels = tuple(Rows(rng.normal(size=(3, 5)), *(rng.normal(size=3),) * 2) for _ in range(3))
    problem = Hierarchy(levels)
    A = np.vstack([10.0 ** (1 - k) * rows.A for k, rows in enumerate(levels)])
    b = np.concatenate([10.0 ** (1 - k) * rows.lower for k, rows in enumerate(levels)])
    assert not certificate(problem, np.linalg.lstsq(A, b)[0]).ok
    assert certificate(problem, projector(problem)).ok


def test_a_wrong_active_set_is_rejected() -> None:
    # x = 0 satisfies x <= 1 with slack: staying at the bound is wrong, moving to the wish is right
    problem = Hierarchy((Rows(np.eye(1), np.array([-np.inf]), np.ones(1)), Rows(np.eye(1), np.zeros(1), np.zeros(1))))
    assert certificate(problem, np.zeros(1)).ok
    assert not certificate(problem, np.ones(1)).ok


def test_a_lower_level_may_not_lean_on_a_bound_from_the_wrong_side() -> None:
    rows = Rows(np.array([[1.0, 1.0]]), np.array([-np.inf]), np.array([1.0]))
    wish = Rows(np.eye(2), np.zeros(2), np.zeros(2))
    assert not certificate(Hierarchy((rows, wish)), np.array([0.5, 0.5])).ok
    wish = Rows(np.eye(2), np.ones(2), np.ones(2))
    assert certificate(Hierarchy((rows, wish)), np.array([0.5, 0.5])).ok


@pytest.mark.parametrize("seed", [974, 1805, 2221])
def test_a_row_that_holds_a_level_back_a_little_is_fixed_for_those_below(seed: int) -> None:
    """Reject neighbours of the optimum: with LOCK_TOLERANCE a thousand times as large each of these is accepted.

    A row left free, although the level above fixes it, contains rounding alone, and rounding can balance any gradient.
    """
    rng = np.random.default_rng(seed)
    problem, x = planted(rng, lean=10 ** rng.uniform(-4.0, 0.0))
    assert certificate(problem, x).ok
    for step in rng.normal(size=(5, 7)):
        assert not certificate(problem, x + 10 ** rng.uniform(-5.0, -2.0) * (step / np.linalg.norm(step))).ok


def test_rows_violated_from_below_are_fixed_for_those_below() -> None:
    apart = Rows(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.ones(2), np.full(2, np.inf))  # x_0 >= 1 and x_0 <= -1
    wish = Rows(np.eye(2), np.array([2.0, 3.0]), np.array([2.0, 3.0]))
    for sign in (1.0, -1.0):  # from above as well
        low, high = (apart.lower, apart.upper) if sign > 0.0 else (-apart.upper, -apart.lower)
        verdict = certificate(Hierarchy((Rows(sign * apart.A, low, high), wish)), np.array([0.0, 3.0]))
        assert verdict.ok
        assert verdict.ranks == (1, 1, 0)
        assert np.count_nonzero(verdict.multipliers[1][:2]) == 2  # equalities share them, not one side
        assert not certificate(Hierarchy((Rows(sign * apart.A, low, high), wish)), np.array([0.1, 3.0])).ok


def test_the_completion_is_judged() -> None:
    rows = Rows(np.array([[1.0, 1.0, 0.0]]), np.ones(1), np.ones(1))
    assert certificate(Hierarchy((rows,)), np.array([0.5, 0.5, 0.0])).ok
    longer = certificate(Hierarchy((rows,)), np.array([1.0, 0.0, 0.0]))
    assert longer.gaps[0] < 1e-12
    assert longer.gaps[-1] > 0.1
    metric = np.diag([1.0, 3.0, 0.0])
    assert certificate(Hierarchy((rows,), metric=metric), np.array([0.75, 0.25, 0.0])).ok
    assert not certificate(Hierarchy((rows,), metric=metric), np.array([0.5, 0.5, 0.0])).ok
    assert not certificate(Hierarchy((rows,), metric=metric), np.array([0.75, 0.25, 0.1])).ok  # a tie: least norm
    origin = np.array([1.0, 1.0, 5.0])
    assert certificate(Hierarchy((rows,), origin=origin), np.array([0.5, 0.5, 5.0])).ok
    assert certificate(Hierarchy((rows,), metric=np.zeros((3, 3))), np.array([0.5, 0.5, 0.0])).ok


def test_empty_and_left_out_rows_say_nothing() -> None:
    empty = Rows(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    out = Rows(np.eye(2), np.full(2, -np.inf), np.full(2, np.inf))
    problem = Hierarchy((empty, out, Rows(np.eye(2), np.ones(2), np.ones(2)), empty))
    verdict = certificate(problem, np.ones(2))
    assert verdict.ok
    assert verdict.ranks == (0, 0, 2, 0, 0)
    assert not certificate(problem, np.zeros(2)).ok
    assert certificate(Hierarchy((), n=3), np.zeros(3)).ok


def test_a_selection_is_judged_as_its_matrix() -> None:
    rng = np.random.default_rng(0)
    pick = Selection(np.array([2, 0]), np.array([2.0, -1.0]))
    x = rng.normal(size=4)
    one = certificate(Hierarchy((Rows(pick, np.ones(2), np.ones(2)),), n=4), x)
    two = certificate(Hierarchy((Rows(pick.dense(4), np.ones(2), np.ones(2)),)), x)
    np.testing.assert_array_equal(one.gaps, two.gaps)


def test_gaps_are_blind_to_the_scale_of_a_level() -> None:
    problem, x = planted(np.random.default_rng(1))
    x = x + 1e-4
    base = certificate(problem, x).gaps
    for scale in (1e-3, 1e3):
        levels = list(problem.levels)
        levels[1] = Rows(scale * np.asarray(levels[1].A), scale * levels[1].lower, scale * levels[1].upper)
        np.testing.assert_allclose(certificate(Hierarchy(tuple(levels)), x).gaps, base, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("length", [1e3, 1e6])
def test_an_error_that_only_short_rows_see_is_refused(length: float) -> None:
    """Two conflicting rows of length 1 and one of ``length``: accept the optimum, reject points off it along the long
    row.

    A gap relative to the longest row was 1e-14 at 1e6.
    """
    A = np.array([[length, 0.0], [0.3, 1.0], [0.0, 1.0]])
    goal = np.array([0.2 * length, 0.5, -0.25])
    problem = Hierarchy((Rows(np.array([[1.0, 1.0]]), np.array([-9.0]), np.array([9.0])), Rows(A, goal, goal)))
    x = np.linalg.lstsq(A, goal, rcond=None)[0]
    assert certificate(problem, x, 1e-8).ok
    for off in (1e-4, 1e-2, 1.0):
        assert certificate(problem, x + [0.0, off]).gaps[1] > 0.1 * off

    def best(second: float) -> np.ndarray:
        return np.array([(A[:, 0] @ (goal - A[:, 1] * second)) / (A[:, 0] @ A[:, 0]), second])

    held = Hierarchy((Rows(np.array([[0.0, 1.0]]), np.array([-9.0]), np.array([-0.5])), Rows(A, goal, goal)))
    x = best(-0.5)  # the short rows pull against the bound
    assert certificate(held, x, 1e-8).ok
    assert not certificate(held, x - [0.0, 1e-2]).ok
    freed = Hierarchy((Rows(np.array([[0.0, 1.0]]), np.array([0.5]), np.array([9.0])), Rows(A, goal, goal)))
    assert certificate(freed, best(0.5), 1e-8).ok
    wrong = Hierarchy((Rows(np.array([[0.0, 1.0]]), np.array([-9.0]), np.array([0.5])), Rows(A, goal, goal)))
    assert not certificate(wrong, best(0.5)).ok  # a bound that holds nothing back


@pytest.mark.parametrize(("counts", "far"), [(0.1, -7.0), (0.1, -5.1), (30.0, -5.1), (0.1, -4.5)])
@pytest.mark.parametrize("graded", [True, False])
@pytest.mark.parametrize("seed", range(20))
def test_a_bound_holds_a_level_that_reaches_it_before_the_step_counts(
    seed: int, graded: bool, counts: float, far: float
) -> None:
    """Rows have a small share of one direction and would move far along it.  A bound stops the step after ``room``,
    near or far, and the largest change of a row is ``counts`` tolerances until there."""
    rng, n, tolerance = np.random.default_rng(seed), 6, 1e-8
    basis = np.linalg.qr(rng.normal(size=(n, n)))[0]
    x, lengths = rng.normal(size=n), np.array([1.0, *10.0 ** rng.uniform(-3.0, 0.0, n - 2), 1e-3]) ** graded
    across = rng.normal(size=(n, n - 1))
    across *= (lengths / np.linalg.norm(across, axis=1))[:, None]
    w = np.linalg.svd(across)[0][:, -1]  # slack that no step across removes
    change = (lengths @ np.abs(w)) * float((np.abs(w) / lengths).max())  # of a row, for a unit of share and room
    share = counts * tolerance / (10.0**far * change)
    A = np.column_stack([across, share * lengths * -np.sign(w)]) @ basis
    room = 10.0**far * max(1.0, float(np.abs(x).max()))
    bound = Rows(basis[-1:], np.array([-np.inf]), basis[-1:] @ x + room)
    case = Hierarchy((bound, Rows(A, A @ x - w, A @ x - w)), constraints=1)
    assert certificate(case, x, tolerance).ok == (counts < 1.0)


@pytest.mark.parametrize("seed", range(20))
def test_a_bound_near_a_point_holds_a_level_whose_gradient_is_small(seed: int) -> None:
    """Rows miss by little and have a small share of one direction, along which they could meet their goals far away."""
    rng, n = np.random.default_rng(seed), 6
    basis, x = np.linalg.qr(rng.normal(size=(n, n)))[0], rng.normal(size=n)
    across = rng.normal(size=(n, n - 1))
    w = np.linalg.svd(across)[0][:, -1]  # slack that no step across removes
    w *= 10.0 ** rng.uniform(-4.0, -2.0)
    A = np.column_stack([across, -1e-6 * w / np.linalg.norm(w)]) @ basis
    level = Rows(A, A @ x - w, A @ x - w)
    bound = Rows(basis[-1:], np.array([-np.inf]), basis[-1:] @ x + 10.0 ** rng.uniform(-7.0, -5.1))
    assert certificate(Hierarchy((bound, level), constraints=1), x, 1e-8).ok
    assert not certificate(Hierarchy((level,)), x, 1e-8).ok


@pytest.mark.parametrize("seed", range(40))
def test_bounds_exceeded_by_a_little_make_a_gap_of_a_little(seed: int) -> None:
    """The gap is no more than the excess relative to x, also of bounds at zero: their terms are no larger than it."""
    rng, n = np.random.default_rng(seed), 6
    lower, size = np.where(rng.random(n) < 0.5, 0.0, -1.0), 10.0 ** rng.uniform(-3.0, 1.0)
    x = size * rng.uniform(0.2, 1.0, n)
    x[: (count := int(rng.integers(1, n)))], lower[:count] = 0.0, 0.0
    levels = [Rows(Selection(np.arange(n)), size * lower, np.full(n, 2.0 * size))]
    levels.append(Rows(np.eye(n), pulled := np.where(np.arange(n) < count, -size, x), pulled))
    problem = Hierarchy(tuple(levels), constraints=1)
    for excess in size * 10.0 ** np.arange(-12.0, -4.0):
        off = np.where(np.arange(n) < count, -excess, 0.0)
        assert certificate(problem, x + off, 1e-8).gaps[0] <= 10.0 * excess / x.max()
    assert not certificate(problem, x + np.where(np.arange(n) < count, -1e-6 * size, 0.0), 1e-8).ok


@pytest.mark.parametrize(("far", "unseen"), [(-2.0, True), (-1.0, True), (1.0, True), (-2.0, False)])
@pytest.mark.parametrize("seed", range(20))
def test_a_bound_in_a_direction_of_the_choice_holds_a_level_from_afar(seed: int, far: float, unseen: bool) -> None:
    """A short row has 5e-9 of its length of a direction without motion, and would move far along it to be met.

    A bound a hundredth or a tenth of x away stops the step before any row changes by the tolerance, whether the choice
    among optima sees the direction or not; ten times x is too far.
    """
    rng, n = np.random.default_rng(seed), 6
    basis = np.linalg.qr(rng.normal(size=(n, n)))[0]
    lengths = np.array([1.0, *10.0 ** rng.uniform(-2.0, 0.0, n - 2), 1e-3])
    across = rng.normal(size=(n, n - 1))
    across *= (lengths / np.linalg.norm(across, axis=1))[:, None]
    w = np.linalg.svd(across)[0][:, -1]  # slack that no step across removes
    x, along = rng.normal(size=n - 1) @ basis[:-1], np.zeros(n)
    along[-1] = -5e-9 * lengths[-1] * np.sign(w[-1])
    A = np.column_stack([across, along]) @ basis
    room = 10.0**far * max(1.0, float(np.abs(x).max()))
    bound = Rows(basis[-1:], np.array([-np.inf]), basis[-1:] @ x + room)
    metric = basis[:-1].T @ basis[:-1] if unseen else None
    case = Hierarchy((bound, Rows(A, A @ x - w, A @ x - w)), constraints=1, metric=metric)
    assert certificate(case, x, 1e-8).ok == (far < 0.0)


def test_inequalities_of_a_graded_level_at_a_bound_may_hold_it_back() -> None:
    """A short row pushes against a long inequality: its force is a slack below rounding."""
    A, upper = np.array([[1e6, 0.0], [1.0, 0.0]]), np.array([1e6, 3.0])
    problem = Hierarchy((Rows(A, np.array([-np.inf, 3.0]), upper),))
    x = np.array([1.0 + 2e-12, 0.0])
    assert certificate(problem, x, 1e-8).ok
    assert not certificate(problem, np.array([0.99, 0.0])).ok


@pytest.mark.parametrize("seed", range(20))
def test_rounding_of_rows_that_are_products_is_no_pull(seed: int) -> None:
    """Rows of different lengths that depend on a bounded coordinate by rounding alone do not pull it off its bound."""
    rng = np.random.default_rng(seed)
    lengths = 10.0 ** np.array([0.0, -1.0, -2.0, -3.0])
    A, b = lengths[:, None] * rng.normal(size=(4, 2)), lengths * rng.normal(size=4)
    best = np.linalg.lstsq(A, b, rcond=None)[0]
    inwards = lengths * np.sign(A @ best - b)
    x, bound = np.array([*best, 0.0]), Rows(Selection(np.array([2])), np.array([-np.inf]), np.zeros(1))

    def passes(seen: float) -> bool:
        task = Rows(np.column_stack([A, seen * inwards]), b, b)
        return certificate(Hierarchy((bound, task), constraints=1), x, 1e-8).ok

    assert all(passes(seen) for seen in (1e-15, 1e-14, 1e-13, 3e-13))
    assert not any(passes(seen) for seen in (1e-9, 1e-6, 1e-3))


def test_what_is_no_answer_at_all() -> None:
    problem = Hierarchy((Rows(np.eye(2), np.ones(2), np.ones(2)),))
    verdict = certificate(problem, np.array([np.nan, 0.0]))
    assert not verdict.ok
    assert np.all(np.isinf(verdict.gaps))
    with pytest.raises(ProblemError, match="n = 2"):
        certificate(problem, np.zeros(3))


@pytest.mark.parametrize("seed", range(30))
def test_nonnegative_least_squares_meets_its_conditions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = int(rng.integers(1, 12)), int(rng.integers(1, 30))
    G, b = rng.normal(size=(rows, columns)), rng.normal(size=rows)
    if seed % 2:
        G = G[:, rng.integers(0, columns, size=columns)]  # repeated columns
    mu = nonnegative_least_squares(G, b)
    pull = G.T @ (b - G @ mu)
    assert np.all(mu >= 0.0)
    assert np.all(pull <= 1e-9)
    assert abs(pull @ mu) < 1e-9


def test_nonnegative_least_squares_of_two_nearly_opposite_columns() -> None:
    """Each column alone reduces the residual by less than rounding; both together reduce it to zero."""
    G = np.array([[1.0, -1.0], [0.0, 3e-9]])
    b = np.array([1e-10, 0.5])
    mu = nonnegative_least_squares(G, b)
    assert np.linalg.norm(b - G @ mu) < 1e-6
    assert mu == pytest.approx([0.5 / 3e-9, 0.5 / 3e-9], rel=1e-6)


def test_rounding_excuses_no_gap_beyond_its_bound() -> None:
    """A level fixes a direction of length 1e-9: the level below may miss by 5e-7 of x, but not by 1e-5."""
    far = np.array([1.0, 1.0, 0.0])
    upper = Rows(
        np.array([[1.0, 0.0, 0.0], [1.0, 1e-9, 0.0]]), np.array([1.0, 1.0 + 1e-9]), np.array([1.0, 1.0 + 1e-9])
    )
    problem = Hierarchy((upper,))
    verdict = certificate(problem, far, 1e-8)
    assert verdict.ok
    assert verdict.rounding[-1] == pytest.approx(5e-7)  # type: ignore[index]
    assert not certificate(problem, far + [0.0, 0.0, 1e-5], 1e-8).ok
