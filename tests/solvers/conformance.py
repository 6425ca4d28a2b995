"""Contract of every solver by its capabilities and accuracy, judged by the certificate.

A new solver enters through ``hqp.solvers.available()``; one that has variants adds them to VARIANTS.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import hqp.solvers
from hqp import Hierarchy, Solution, Status, certificate
from hqp.errors import UnsupportedProblem
from hqp.problem import EQUALITY
from hqp.solvers import Solver

SOLVED_SHARE = 0.98
"""Least share of supported problems that a strict solver must solve; it must mark the others."""

VARIANTS: dict[str, tuple[dict[str, Any], ...]] = {}
"""Options by solver name that the suite tests in addition."""


@dataclass(frozen=True)
class Subject:
    """Solver under test."""

    name: str
    options: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.name + "".join(f"-{key}={value}" for key, value in self.options.items())

    def load(self) -> Solver:
        """Load the solver."""
        return hqp.solvers.load(self.name, **self.options)


def subjects() -> list[Subject]:
    """Available solvers, the reference, and their variants."""
    found = []
    for name in (*hqp.solvers.available(), "reference"):
        found.append(Subject(name))
        found += [Subject(name, options) for options in VARIANTS.get(name, ())]
    return found


def supports(solver: Solver, problem: Hierarchy) -> bool:
    """Return true if the solver's capabilities cover the problem."""
    shape = problem.shape
    return (solver.inequalities or not shape.inequalities) and (solver.metric or not (shape.metric or shape.origin))


def check(solver: Solver, problem: Hierarchy) -> Solution | None:
    """Hold the solver to its contract on one problem; return None if it must refuse the problem."""
    if not supports(solver, problem):
        with pytest.raises(UnsupportedProblem):
            solver.workspace(problem.shape)
        return None
    before = problem.copy()
    solution = solver.solve(problem)
    check_form(problem, solution)
    check_untouched(problem, before)
    verdict = certificate(problem, solution.x, solver.accuracy)
    if solution.status.solved:
        assert verdict.ok, f"{solution.status.name}, but {verdict}"
    else:
        assert solution.detail, f"a solution with {solution.status.name} needs a detail"
    check_violation(problem, solution)
    return solution


def check_form(problem: Hierarchy, solution: Solution) -> None:
    """Check shapes, finiteness, and residuals and activity that follow from x."""
    assert solution.x.shape == (problem.n,)
    assert np.isfinite(solution.x).all()
    assert len(solution.residuals) == len(solution.active) == len(problem.levels)
    for rows, w, marks in zip(problem.levels, solution.residuals, solution.active, strict=True):
        size = 1.0 + np.abs(rows.dense(problem.n)) @ np.abs(solution.x)
        assert np.all(np.abs(w - rows.slack(solution.x)) <= 1e-12 * size)
        assert marks.dtype == np.int8
        assert np.all((marks == EQUALITY) == rows.equality)
        assert np.all(marks[(w > 1e-6) & ~rows.equality] == 1)
        assert np.all(marks[(w < -1e-6) & ~rows.equality] == -1)
    stats = solution.stats
    assert min(stats.iterations, stats.factorisations, stats.build_s, stats.solve_s) >= 0


def check_untouched(problem: Hierarchy, before: Hierarchy) -> None:
    """Check that the solver did not write into the problem."""
    for rows, old in zip(problem.levels, before.levels, strict=True):
        np.testing.assert_array_equal(rows.dense(problem.n), old.dense(problem.n))
        np.testing.assert_array_equal(rows.lower, old.lower)
        np.testing.assert_array_equal(rows.upper, old.upper)


def check_violation(problem: Hierarchy, solution: Solution) -> None:
    """CONSTRAINTS_VIOLATED is reported if and only if a leading constraint level violates its bounds."""
    worst = max((float(np.abs(w).max(initial=0.0)) for w in solution.residuals[: problem.constraints]), default=0.0)
    if solution.status is Status.CONSTRAINTS_VIOLATED:
        assert worst > 0.0
    elif solution.status.solved:
        assert worst < 1e-6


def check_share(solver: Solver, problems: tuple[Hierarchy, ...]) -> None:
    """Hold the solver to its contract on all problems; a strict solver must solve nearly all."""
    outcomes = [solution for problem in problems if (solution := check(solver, problem)) is not None]
    solved = sum(solution.status.solved for solution in outcomes)
    if solver.strict and outcomes:
        assert solved >= SOLVED_SHARE * len(outcomes), {s.detail for s in outcomes if not s.status.solved}
