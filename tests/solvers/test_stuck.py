"""Degenerate vertices on which the active set once gave up: legs stretched, all joints at limits, a hand far away.

Ticks of Talos in closed loops, five levels under joint limits.  tests/data/stuck.npz: the working sets repeat.
tests/data/uncertain.npz: a multiplier's sign lies near its rounding (1), or its direction is below the rank tolerance
(0, 2).  tests/data/stalled.npz: two ticks of Romeo's torques, pushed, a hand far beyond its reach, price 0; from the
first's active set the search of the second ends with 0.8 of the gap that an optimum may have.  tests/data/cone.npz: the
constraints and the first task of a tick of CBi's torques, a foot at the apex of its friction cone.
"""

from __future__ import annotations

from math import inf
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp import Hierarchy, Motion, Rows, Selection, Status, certificate
from hqp.solvers.stages import StagedWorkspace
from tests.scenes.noise import noisy
from tests.scenes.priced import is_unsure

DATA = Path(__file__).parents[1] / "data"


def problem(i: int, file: str = "stuck") -> Hierarchy:
    with np.load(DATA / f"{file}.npz") as data:
        count = sum(1 for name in data.files if name.startswith(f"{i}_A"))
        levels = tuple(Rows(*(data[f"{i}_{part}{k}"] for part in "Alu")) for k in range(count))
        metric = data.get(f"{i}_metric")
        return Hierarchy(levels, constraints=int(data[f"{i}_constraints"]), metric=metric)


@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize("options", [{}, {"multipliers": True}], ids=str)
def test_the_answer_is_judged_before_it_is_given_up(i: int, options: dict[str, bool]) -> None:
    workspace = hqp.solvers.load("lexicographic", **options).workspace(problem(i).shape)
    for _ in range(2):
        solution = workspace.solve(problem(i))
        assert solution.status in (Status.OPTIMAL, Status.RANK_UNCERTAIN), solution.detail
        assert certificate(problem(i), solution.x).ok
        assert np.all(problem(i).levels[0].slack(solution.x) == 0.0)


@pytest.mark.long
def test_a_search_that_stalls_beside_the_optimum_is_not_certain() -> None:
    """The level falls by 5e-5 per N m along internal forces: its gap is 8e-9, its residual 2e-5 off.

    Goals are drawn, from the first tick's active set and from none.
    """
    solver, cold = hqp.solvers.load("lexicographic"), 0
    first, second = (problem(i, "stalled") for i in range(2))
    goals = second.levels[second.constraints]
    for seed in range(20):
        rng = np.random.default_rng(seed)
        off = 10.0 ** rng.uniform(-9.0, -3.0) * np.abs(goals.lower).max() * rng.normal(size=goals.m)
        levels = list(second.levels)
        levels[second.constraints] = Rows(goals.A, goals.lower + off, goals.upper + off)
        case = Hierarchy(tuple(levels), second.constraints, second.metric)
        for before in (first, None):
            workspace = solver.workspace(case.shape)
            workspace.limit(inf)  # type: ignore[attr-defined]
            if before is not None:
                workspace.solve(before)
            found = workspace.solve(case)
            certain = found.status.solved and not is_unsure(found)
            assert not certain or certificate(case, found.x, 1e-8).ok, (seed, before is None)
            cold += certain and before is None
    assert cold > 5


def test_a_sign_near_its_rounding_is_read_right() -> None:
    tick = problem(1, "uncertain")
    solution = hqp.solvers.load("lexicographic").solve(tick)
    assert solution.status.solved, solution.detail
    assert certificate(tick, solution.x).gap <= 1e-10


@pytest.mark.parametrize("i", [0, 2])
def test_what_the_certificate_doubts_is_told(i: int) -> None:
    tick = problem(i, "uncertain")
    solution = hqp.solvers.load("lexicographic").solve(tick)
    verdict = certificate(tick, solution.x)
    assert solution.status is Status.RANK_UNCERTAIN or verdict.gap <= 1e-10, solution.detail
    assert np.all(verdict.gaps[:3] <= 1e-9)


def test_the_last_opinion_ends() -> None:
    """Talos torque tick with every search of the kernel refused."""
    import pickle
    from pathlib import Path

    problem = pickle.loads((Path(__file__).parents[1] / "data" / "slow_tick.pkl").read_bytes())
    workspace = hqp.solvers.load("lexicographic").workspace(problem.shape)
    solution = workspace.solve(problem)
    assert solution.status.solved or solution.status is hqp.Status.NOT_CERTIFIED


def test_a_search_level_by_level_does_not_crawl() -> None:
    """Two ticks of CBi at torque level, a hand out of reach, the second warm-started: 51 531 points, 3.2 s.

    A step without active rows was repeated at the length of rounding, and a level with an accepted gap decreased by
    1e-12 of its norm, turn after turn, along a nearly lost direction.
    """
    with np.load(DATA / "crawl.npz") as data:
        box = Selection(data["index"], data["scale"])
        ticks = [
            Hierarchy(
                tuple(
                    Rows(data[f"{t}_A{k}"] if k else box, data[f"{t}_lower{k}"], data[f"{t}_upper{k}"])
                    for k in range(4)
                ),
                constraints=1,
                n=51,
                metric=data["metric"],
                prices=data["prices"],
                motion=Motion(data["F"], data["f"]),
            )
            for t in range(2)
        ]
    workspace = hqp.solvers.load("lexicographic").workspace(ticks[0].shape)
    assert isinstance(workspace, StagedWorkspace)
    workspace.limit(inf)
    for tick in ticks:
        solution = workspace.solve(tick)
        assert solution.status.solved, solution.detail
        assert solution.stats.iterations < 1000
        assert solution.stage_points is not None
        assert certificate(tick, solution.x, stages=solution.stage_points).ok


def test_rows_at_the_apex_of_a_cone_do_not_keep_each_other() -> None:
    """Eight rows of a foot's cone meet where the level is not yet least, and differ by noise of 1e-12.

    A row that was released stopped the next step by its rounding, and was held again.
    """
    with np.load(DATA / "cone.npz") as data:
        box = Selection(data["A0"], data["scale0"])
        levels = tuple(Rows(data[f"A{k}"] if k else box, data[f"l{k}"], data[f"u{k}"]) for k in range(4))
        motion = Motion(data["F"], data["f"])
        tick = Hierarchy(levels, constraints=3, prices=data["prices"], turning=data["turning"], motion=motion, eta=1e-4)
    unsure = 0
    for seed in range(40):
        case = noisy(tick, np.random.default_rng(seed))
        workspace = hqp.solvers.load("lexicographic").workspace(case.shape)
        workspace.limit(inf)  # type: ignore[attr-defined]
        found = workspace.solve(case)
        unsure += is_unsure(found)
        assert is_unsure(found) or certificate(case, found.x, 1e-8, found.stage_points).gaps[3] <= 1e-8, seed
    assert unsure <= 2
