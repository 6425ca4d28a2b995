"""Stages whose rows are long, short or tilted: rounding decides nothing, and is doubted only if it could."""

from __future__ import annotations

import numpy as np
import pytest

import hqp.solvers
from hqp import Hierarchy, Motion, Rows, Status, certificate
from hqp.solvers.base import Solver
from tests.scenes.kinds import problem
from tests.scenes.priced import is_unsure, solved_in_a_loop
from tests.scenes.stacks import scene


def solver() -> Solver:
    return hqp.solvers.load("lexicographic")


def below_an_anchor(seed: int, unit: float) -> Hierarchy:
    """Inequalities that miss for their price, then equality rows of length `unit` that can be met."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 9))
    m = int(rng.integers(1, 4))
    A, b = rng.normal(size=(m, n)), rng.normal(size=m)
    k = int(rng.integers(1, n - m + 1))
    B, y = rng.normal(size=(k, n)), rng.normal(size=k)
    levels = Rows(A, np.full(m, -np.inf), -np.abs(b)), Rows(unit * B, unit * y, unit * y)
    return Hierarchy(levels, prices=np.array([10.0 ** rng.uniform(0, 1), 0.0]), turning=np.zeros(2))


@pytest.mark.parametrize("unit", [1e3, 1e5, 1e7])
def test_a_level_that_can_be_met_moves_anchored_rows_alike_in_every_unit(unit: float) -> None:
    sure = 0
    for seed in range(40):
        one, other = (solved_in_a_loop(solver(), below_an_anchor(seed, length)) for length in (1.0, unit))
        if is_unsure(one) or is_unsure(other):
            continue
        sure += 1
        assert np.abs(one.x - other.x).max() < 1e-7 * (1.0 + np.abs(one.x).max()), seed
    assert sure >= 30


def tilted(seed: int) -> Hierarchy:
    """Three hard rows turned by 1e-7 to 1e-4 against each other, and one row below that they nearly determine."""
    rng = np.random.default_rng(seed)
    n, u = 5, rng.normal(size=5)
    S = u + 10.0 ** rng.uniform(-7, -4) * rng.normal(size=(3, n))
    a = rng.normal(size=2) @ S[:2] + 10.0 ** rng.uniform(-6, -3) * rng.normal(size=(1, n))
    s, b = S @ rng.normal(size=n), a @ rng.normal(size=n) + 1e3 * rng.normal(size=1)
    return Hierarchy(
        (Rows(S, s, s.copy()), Rows(a, b, b.copy())),
        constraints=1,
        prices=np.array([0.0, 10.0 ** rng.uniform(-4, 0)]),
    )


@pytest.mark.long
def test_tilted_rows_are_certain_and_right() -> None:
    """Rounding of the rows moves these answers by 1e-7 at most, which the certificate allows as well."""
    for seed in range(100):
        case = tilted(seed)
        answer = solved_in_a_loop(solver(), case)
        assert answer.status is Status.OPTIMAL, seed
        assert certificate(case, answer.x, 1e-8, answer.stage_points).ok, seed


@pytest.mark.parametrize("name", ["g1", "talos"])
def test_a_loop_ends_its_stages_with_the_first_round_that_is_rounding(name: str) -> None:
    """Directions without motion are moved until their cost pulls by rounding alone; more rounds lower nothing."""
    session, given = scene(name, "torque")
    robot, q = session.robot, session.robot.home.copy()
    v, workspace, iterations, unsure = np.zeros(robot.nv), None, 0, 0
    for i in range(60):
        tick = session.step(robot.state(q, v), *given(i))
        workspace = workspace or solver().workspace(session.problem.shape)
        workspace.limit(np.inf)  # type: ignore[attr-defined]
        answer = workspace.solve(session.problem)
        iterations += answer.stats.iterations
        unsure += is_unsure(answer)
        q, v = tick.advance()
    assert iterations < 60 * 30
    assert unsure <= 6


def test_a_row_that_holds_a_level_by_a_short_remainder_makes_it_uncertain() -> None:
    """The active row keeps a share of 3e-11: the level below misses by 4e6 with it, by nothing without."""
    case = problem("near_parallel", 600000006)[0]
    answer = solved_in_a_loop(solver(), case)
    assert is_unsure(answer) or certificate(case, answer.x, 1e-6).ok


@pytest.mark.long
@pytest.mark.parametrize("bounds", [0, 1])
def test_the_completion_follows_a_last_level_without_bounds(bounds: int) -> None:
    """Below an exact level only anchored rows keep their motion: the least norm decides on the rest.

    bounds: rows of the last level, none of which has a bound.
    """
    for seed in range(60):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(4, 9))
        m = int(rng.integers(1, 3))
        k = int(rng.integers(1, n - m))
        A, B, y = rng.normal(size=(m, n)) * (np.arange(n) < 2), rng.normal(size=(k, n)), 3.0 * rng.normal(size=k)
        above = Rows(A, np.full(m, -np.inf), -np.abs(rng.normal(size=m)))
        last = Rows(rng.normal(size=(bounds, n)), np.full(bounds, -np.inf), np.full(bounds, np.inf))
        case = Hierarchy(
            (above, Rows(B, y, y.copy()), last),
            prices=np.array([10.0 ** rng.uniform(0, 1), 10.0 ** rng.uniform(-2, 0), 0.0]),
            turning=np.array([10.0 ** rng.uniform(-1, 2), 1.0, 0.0]),
            motion=Motion(rng.uniform(0.3, 3.0, size=n), rng.normal(size=n)),
        )
        answer = solved_in_a_loop(solver(), case)
        assert is_unsure(answer) or certificate(case, answer.x, 1e-8, answer.stage_points).ok, seed


@pytest.mark.long
def test_an_anchored_row_nearly_parallel_to_a_hard_one_holds_nothing_in_part() -> None:
    """Its remainder is 1e-13 to 1e-8: it counts as a direction or not, and x is the shortest along all others."""
    certain = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(4, 8))
        A, b = rng.normal(size=(2, n)), rng.normal(size=2)
        a = A[:1] * rng.choice([-1.0, 0.5, 1.0]) + 10.0 ** rng.uniform(-13.0, -8.0) * rng.normal(size=(1, n))
        goal, F = rng.normal(size=1), rng.normal(size=(int(rng.integers(1, n - 2)), n))
        levels = [Rows(A, np.array([b[0], -np.inf]), b), Rows(a, goal, goal.copy())]
        prices = [0.0, 10.0 ** rng.uniform(-3.0, 0.0)]
        if rng.random() < 0.5:
            levels.append(Rows(rng.normal(size=(1, n)), np.ones(1), np.ones(1)))
            prices.append(10.0 ** rng.uniform(-3.0, 0.0))
        case = Hierarchy(tuple(levels), 1, prices=np.array(prices), motion=Motion(F, rng.normal(size=len(F))))
        answer = solved_in_a_loop(solver(), case)
        if not is_unsure(answer):
            certain += 1
            verdict = certificate(case, answer.x, 1e-8, answer.stage_points)
            assert verdict.ok, (seed, str(verdict))
    assert certain > 60


def test_a_force_is_released_if_its_multiplier_is_more_than_rounding() -> None:
    """Two feet act nearly alike: a multiplier of 3e-12 of the gradient holds 87 N, which moves the motion by 1e-8."""
    session, given = scene("romeo", "torque")
    robot, q = session.robot, session.robot.home.copy()
    v = np.zeros(robot.nv)
    for i in range(46):
        tick = session.step(robot.state(q, v), *given(i))
        if i >= 36:
            cold, motion = solver().solve(session.problem), session.problem.motion
            assert motion is not None
            apart = np.linalg.norm(motion.F @ (tick.x - cold.x))
            assert is_unsure(cold) or apart < 1e-9 * np.linalg.norm(motion.F @ cold.x), i
        q, v = tick.advance()
