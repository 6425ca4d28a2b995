"""Many problems in one call, and one workspace in many threads."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Hierarchy, Motion, Rows, Selection, Solution, Status
from hqp.errors import DeclarationError, ProblemError
from hqp.solvers import lexicographic
from hqp.solvers.lexicographic import Lexicographic
from hqp.solvers.many import HierarchyBatch

if lexicographic.kernel() == "":
    pytest.skip("built without the native kernel", allow_module_level=True)


def problems(count: int, n: int = 12) -> list[Hierarchy]:
    made = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        box = Rows(Selection(np.arange(n)), np.full(n, -0.4), np.full(n, 0.4))
        levels = [Rows(rng.normal(size=(m, n)), *(rng.normal(size=m),) * 2) for m in (4, 3)]
        made.append(Hierarchy((box, *levels, Rows(Selection(np.arange(n)), np.zeros(n), np.zeros(n))), constraints=1))
    return made


def stacked(chosen: list[Hierarchy]) -> HierarchyBatch:
    levels = []
    for k, rows in enumerate(chosen[0].levels):
        A = rows.A if isinstance(rows.A, Selection) else np.stack([np.asarray(p.levels[k].A) for p in chosen])
        levels.append((A, np.stack([p.levels[k].lower for p in chosen]), np.stack([p.levels[k].upper for p in chosen])))
    return HierarchyBatch(tuple(levels), constraints=1)


def solved_alone(problem: Hierarchy, found: Any, i: int) -> Solution:
    """Solve problem i of a batch alone and compare the bits."""
    alone = Lexicographic().solve(problem)
    assert alone.x.tobytes() == found.x[i].tobytes()
    assert alone.status is found.statuses[i]
    np.testing.assert_array_equal(np.concatenate(alone.residuals), found.slack[i])
    np.testing.assert_array_equal(np.concatenate(alone.active), found.active[i])
    return alone


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_the_same_bits_as_one_by_one(threads: int) -> None:
    chosen = problems(40)
    for batch in (chosen, stacked(chosen)):
        found = hqp.solve_many(batch, threads=threads)
        for i, problem in enumerate(chosen):
            alone = solved_alone(problem, found, i)
            np.testing.assert_allclose(found.norms[i], alone.norms, rtol=1e-14, atol=1e-300)
    assert found.solved.all()


def priced(count: int) -> list[Hierarchy]:
    """Problems with high prices: some levels are settled and others are not."""
    law = {"prices": np.array([0.0, 0.05, 0.02, 0.0]), "turning": np.array([0.0, 20.0, 1.0, 0.0]), "eta": 1e-3}
    motion = Motion(np.linspace(0.5, 2.0, 12), np.linspace(-0.1, 0.1, 12))
    return [replace(problem, stacked=None, motion=motion, **law) for problem in problems(count)]


@pytest.mark.parametrize("threads", [1, 2])
def test_priced_problems_have_the_bits_of_one_by_one(threads: int) -> None:
    chosen = priced(40)
    law = {name: getattr(chosen[0], name) for name in ("prices", "motion", "eta", "turning")}
    staged = 0
    for batch in (chosen, replace(stacked(chosen), **law)):
        found = hqp.solve_many(batch, threads=threads)
        for i, problem in enumerate(chosen):
            alone = solved_alone(problem, found, i)
            if alone.stage_points is not None:
                np.testing.assert_array_equal(alone.stage_points, found.stage_points[i])
                staged += 1
    assert 0 < staged < 80


def test_a_price_that_is_none_is_refused_in_a_batch() -> None:
    chosen = priced(3)
    assert chosen[1].prices is not None
    chosen[1].prices[1] = np.nan
    with pytest.raises(ProblemError, match="price of level 1"):
        hqp.solve_many(chosen)
    with pytest.raises(ProblemError, match="without a price"):
        hqp.solve_many([problems(1)[0], priced(1)[0]])
    assert hqp.solve_many([priced(1)[0], problems(1)[0]]).solved.all()


def test_shared_arrays_are_read_for_every_problem() -> None:
    A, goals = np.array([[1.0, 1.0]]), np.array([[1.0], [2.0], [3.0]])
    found = hqp.solve_many(HierarchyBatch(((A, goals, goals),)))
    np.testing.assert_allclose(found.x, goals / 2.0 * np.ones((1, 2)))


def test_arrays_that_need_a_conversion_are_converted() -> None:
    chosen = problems(3)
    turned = [replace(chosen[0].levels[1], A=np.asfortranarray(chosen[0].levels[1].A))]
    odd = replace(chosen[0], levels=(chosen[0].levels[0], *turned, *chosen[0].levels[2:]))
    found = hqp.solve_many([odd, *chosen[1:]], threads=2)
    np.testing.assert_allclose(found.x[0], Lexicographic().solve(chosen[0]).x, rtol=0.0, atol=1e-12)


def test_numbers_that_are_not_usable_are_marked() -> None:
    chosen = problems(4)
    chosen[2].levels[1].lower[0] = np.nan
    found = hqp.solve_many(chosen, threads=2)
    assert [status.solved for status in found.statuses] == [True, True, False, True]
    assert found.statuses[2] is Status.NOT_CERTIFIED
    assert np.isfinite(found.x).all()


def test_what_solve_many_refuses() -> None:
    with pytest.raises(ProblemError, match="this workspace solves n = 12"):
        hqp.solve_many([*problems(2), *problems(1, n=11)])
    with pytest.raises(ProblemError, match="no problem"):
        hqp.solve_many([])
    with pytest.raises(DeclarationError, match="threads"):
        hqp.solve_many(problems(1), threads=0)
    with pytest.raises(ProblemError, match="disagree"):
        len(HierarchyBatch(((np.zeros((2, 1, 3)), np.zeros((3, 1)), np.zeros(1)),)))


@pytest.mark.parametrize(("prices", "stored", "turns"), [
    (None, np.asfortranarray, 3000),  # arrays that need conversion: binding takes long
    ((0.0, 0.3, 0.3, 0.0), np.asfortranarray, 200),
    ((0.0, 0.3, 0.3, 0.0), np.asarray, 500),
])  # fmt: skip
def test_a_workspace_in_four_threads_refuses_and_never_mixes_answers(
    prices: tuple[float, ...] | None, stored: Callable[[np.ndarray], np.ndarray], turns: int
) -> None:
    chosen = [
        replace(
            p,
            levels=(p.levels[0], replace(p.levels[1], A=stored(p.levels[1].A)), *p.levels[2:]),  # type: ignore[arg-type]
            prices=None if prices is None else np.array(prices),
        )
        for p in problems(4, n=30 if prices is None else 12)
    ]
    right = [Lexicographic().solve(problem).x for problem in chosen]
    workspace = Lexicographic().workspace(chosen[0].shape)
    wrong, refused, solved = [0] * 4, [0] * 4, [0] * 4
    start = threading.Barrier(4)

    def work(i: int) -> None:
        start.wait()
        for _ in range(turns):
            try:
                x = workspace.solve(chosen[i]).x
            except RuntimeError:
                refused[i] += 1
                continue
            solved[i] += 1
            wrong[i] += not np.allclose(x, right[i], rtol=0.0, atol=1e-9 if prices is None else 1e-6)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
    assert sum(wrong) == 0
    assert sum(solved) > 0
    assert sum(refused) > 0


def test_another_hierarchy_of_the_same_shape_is_read_afresh() -> None:
    chosen = problems(6)
    workspace = Lexicographic().workspace(chosen[0].shape)
    for _ in range(3):
        for problem in chosen:
            np.testing.assert_allclose(
                workspace.solve(problem).x, Lexicographic().solve(problem).x, rtol=0.0, atol=1e-10
            )
