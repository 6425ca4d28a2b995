"""Deadlines stop every part of a solve; parts without a deadline end after a number of steps, not after a time."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hqp import Controller, Hierarchy, Status, Torque, robots
from hqp.solvers import lexicographic, reference, second_opinion, stages
from hqp.solvers.lexicographic import Lexicographic
from hqp.solvers.reference import Reference
from tests.scenes.kinds import problem as drawn_problem
from tests.scenes.overloaded import overloaded

if lexicographic.kernel() == "":
    pytest.skip("built without the native kernel", allow_module_level=True)


def priced(kind: str, seed: int) -> Hierarchy:
    problem = drawn_problem(kind, seed)[0]
    prices = np.full(len(problem.levels), 0.1)
    prices[0] = 0.0
    return replace(problem, prices=prices, stacked=None)


def forbid(*_: Any, **__: Any) -> Any:
    raise AssertionError("a second opinion within a deadline")


@pytest.mark.parametrize("name", ["conflicts 2", "mixture 12", "near_parallel 0"])
def test_a_solver_with_a_deadline_gives_no_second_opinion_of_priced_levels(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind, seed = name.split()
    problem = priced(kind, int(seed))
    for module in (lexicographic, stages):
        monkeypatch.setattr(module, "second_opinion", forbid)
    with pytest.raises(AssertionError, match="second opinion"):
        Lexicographic().solve(problem)  # calls the second opinion
    solution = Lexicographic(deadline=1e-6).solve(problem)
    assert solution.status is Status.TIME_LIMIT
    assert np.isfinite(solution.x).all()
    Lexicographic(deadline=10.0).solve(problem)


@pytest.mark.parametrize("name", ["cbi", "g1", "talos"])
def test_the_first_ticks_have_a_deadline_too(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """They took up to 3 s at a deadline of 1.6 ms: second opinions on infeasible torque stacks."""
    robot = robots.load(name)
    session = Controller(overloaded(robot), Torque()).session(robot, 0.002)
    for module in (lexicographic, stages):
        monkeypatch.setattr(module, "second_opinion", forbid)
    for _ in range(3):
        session.step(robot.state())


@pytest.mark.parametrize("problem", [drawn_problem("vertex", 2)[0], priced("plain", 1)], ids=["exact", "priced"])
def test_second_opinions_do_not_look_at_the_clock(problem: Hierarchy, monkeypatch: pytest.MonkeyPatch) -> None:
    """The reference is limited by a count, so that a slow machine gives the same status and x."""
    found = Lexicographic().solve(problem)
    wrong = replace(found, x=found.x + 1.0, residuals=found.residuals, active=found.active, stage_points=None)
    right = second_opinion.second_opinion(problem, wrong)
    assert right.status.solved
    ticks = itertools.count(0.0, 100.0)
    monkeypatch.setattr(reference, "perf_counter", lambda: next(ticks))
    again = second_opinion.second_opinion(problem, wrong)
    assert again.status is right.status
    np.testing.assert_array_equal(again.x, right.x)


def test_the_reference_ends_after_so_many_factorisations() -> None:
    problem = priced("vertex", 10)
    assert Reference(factorisations=2).solve(problem).status is Status.ITERATION_LIMIT
    small, large = drawn_problem("plain", 0)[0], drawn_problem("large", 0)[0]
    assert 1 <= second_opinion.effort(large) < second_opinion.effort(small) < 10_000
