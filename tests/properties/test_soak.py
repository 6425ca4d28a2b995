"""The soak fails if a level above has moved."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import hqp.solvers
from hqp import Hierarchy, Rows
from tests.scenes import soak


def rows(first: float, second: float, goal: float) -> Rows:
    return Rows(np.array([[first, second]]), np.array([goal]), np.array([goal]))


@pytest.mark.parametrize("prices", [None, np.array([0.0, 0.3, 0.0])], ids=["exact", "priced"])
def test_a_level_that_those_below_have_moved_is_told(prices: np.ndarray | None) -> None:
    problem = Hierarchy((rows(1.0, 0.0, 1.0), rows(0.0, 1.0, 9.0), rows(1.0, 1.0, 0.0)), prices=prices)
    solution = hqp.solvers.load("lexicographic").solve(problem)
    assert [soak.moved(problem, solution, levels) for levels in (1, 2)] == ["", ""]
    for level, off in ((0, 1e-4), (1, 0.1), (1, -0.1)):
        x = solution.x + off * np.eye(2)[level]
        spoilt = dataclasses.replace(solution, x=x, residuals=problem.slacks(x))
        assert f"of level {level} " in soak.moved(problem, spoilt, level + 1)


def test_an_unmet_level_gives_way_as_the_definition_says() -> None:
    """A squared level with the same row and a goal 1e4 away moves an unmet level by a third: no fault of the solver."""
    solve = hqp.solvers.load("lexicographic").solve
    rest = rows(1.0, 0.0, 1.0), rows(0.0, 1.0, 9.0), rows(0.3, 1.0, 12.0)
    problem = Hierarchy((*rest, rows(0.0, 1.0, 1e4)), prices=np.array([0.0, 0.3, 0.3, 0.0]))
    solution = solve(problem)
    before, after = (float(np.linalg.norm(solve(soak.head(problem, n)).residuals[1])) for n in (2, 4))
    assert abs(after - before) > 0.1 * before
    assert [soak.moved(problem, solution, levels) for levels in (1, 2, 3)] == ["", "", ""]
    softer = solve(dataclasses.replace(problem, eta=100.0 * problem.eta))
    assert "of level 1 " in soak.moved(problem, softer, 3)


def test_it_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, record = soak.load("g1"), soak.Record()
    soak.soak(robot, "velocity", 15, np.random.default_rng(0), record, None)
    assert record.looks > 0
    monkeypatch.setattr(soak, "moved", lambda *_: "level 0 has moved")
    with pytest.raises(AssertionError, match="level 0 has moved"):
        soak.soak(robot, "velocity", 15, np.random.default_rng(0), soak.Record(), None)
