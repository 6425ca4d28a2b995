"""Solvers by name, their capabilities, and their common behaviour."""

from __future__ import annotations

import importlib.metadata
import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import hqp.solvers
from hqp import Hierarchy, Rows, Selection, Status
from hqp.errors import DeclarationError, HqpError, ProblemError, SolverNotInstalled, UnsupportedProblem
from hqp.problem import EQUALITY, Shape, Stats
from hqp.problem.completion import completion, metric_factor
from hqp.solvers import Solver
from hqp.solvers.base import activity, check_shape, finish
from hqp.solvers.flat import Flat

BOX = Rows(np.eye(2), np.zeros(2), np.ones(2))


def test_every_available_solver_loads_and_states_its_capabilities() -> None:
    names = hqp.solvers.available()
    assert {"nullspace", "chiaverini", "weighted", "cascade:proxqp", "cascade:osqp"} <= set(names)
    for name in set(names) - {"lexicographic"}:
        solver = hqp.solvers.load(name)
        assert isinstance(solver, hqp.solvers.Solver)
        assert 0.0 < solver.accuracy <= 1e-6
        assert solver == hqp.solvers.load(name)  # a value
        assert hash(solver) == hash(hqp.solvers.load(name))


@pytest.mark.parametrize(
    ("name", "options", "word"),
    [
        ("nulspace", {}, "closest: nullspace"),
        ("nullspace", {"colour": 1}, "unknown option"),
        ("nullspace", {"rank_tolerance": 0.0}, "bad rank_tolerance"),
        ("nullspace", {"rank_tolerance": "small"}, "bad rank_tolerance"),
        ("cascade", {"solver": "osqp"}, "allowed: .*backend"),
        ("chiaverini", {"damping": np.nan}, "bad damping"),
        ("chiaverini", {"rank_tolerance": 2.0}, "bad rank_tolerance"),
        ("cascade", {"tolerance": -1e-9}, "bad tolerance"),
        ("cascade", {"max_iterations": 0}, "bad max_iterations"),
        ("weighted", {"ratio": 0.0}, "bad ratio"),
        ("weighted", {"weights": (1.0, -1.0)}, "bad weights"),
    ],
)
def test_bad_names_and_options_are_refused(name: str, options: dict[str, Any], word: str) -> None:
    with pytest.raises(DeclarationError, match=word):
        hqp.solvers.load(name, **options)


def test_an_unknown_back_end_is_refused_with_what_there_is() -> None:
    with pytest.raises(HqpError, match=r"not installed|closest: .*proxqp"):
        hqp.solvers.load("cascade:nosuchsolver").workspace(Shape(2, (2,), (False,)))


def test_a_missing_package_is_named_with_its_pip_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SolverNotInstalled, match=re.escape("pip install 'hqp[solvers]'")):
        hqp.solvers.load("cascade:proxqp")
    assert "cascade:proxqp" not in hqp.solvers.available()


@pytest.mark.parametrize("name", ["nullspace", "chiaverini"])
def test_capabilities_are_refused_before_solving(name: str) -> None:
    solver = hqp.solvers.load(name)
    with pytest.raises(UnsupportedProblem, match=r"cannot solve inequalities.*ignore_inequalities"):
        solver.workspace(Hierarchy((BOX,)).shape)
    ignoring = hqp.solvers.load(name, ignore_inequalities=True)
    assert ignoring.solve(Hierarchy((BOX,))).status is Status.OPTIMAL


def test_chiaverini_refuses_metric_and_origin() -> None:
    level = Rows(np.eye(2), np.zeros(2), np.zeros(2))
    for extra in ({"metric": np.eye(2)}, {"origin": np.ones(2)}):
        with pytest.raises(UnsupportedProblem, match="metric"):
            hqp.solvers.load("chiaverini").solve(Hierarchy((level,), **extra))


def test_one_number_a_level_where_a_tuple_is_given() -> None:
    level = Rows(np.eye(2), np.zeros(2), np.zeros(2))
    with pytest.raises(DeclarationError, match="1 numbers"):
        hqp.solvers.load("weighted", weights=(1.0, 2.0)).solve(Hierarchy((level,)))


def test_a_workspace_refuses_another_shape() -> None:
    problem = Hierarchy((BOX,))
    check_shape(problem, problem.shape)
    for other in (Hierarchy((BOX, BOX)), Hierarchy((BOX,), metric=np.eye(2))):
        with pytest.raises(ProblemError, match="this workspace solves"):
            check_shape(other, problem.shape)


class Elsewhere(Solver):
    """Solver of another package, not a dataclass."""

    name = "elsewhere"

    def __init__(self, level: int = 0) -> None:
        self.level = level

    def workspace(self, shape: Shape) -> Any:
        raise NotImplementedError


def test_other_packages_bring_solvers_by_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    point = importlib.metadata.EntryPoint("elsewhere", f"{__name__}:Elsewhere", hqp.solvers.GROUP)
    monkeypatch.setattr(point.__class__, "load", lambda self: Elsewhere)

    def points(group: str, name: str | None = None) -> list[importlib.metadata.EntryPoint]:
        return [point] if group == hqp.solvers.GROUP and name in (None, "elsewhere") else []

    monkeypatch.setattr("importlib.metadata.entry_points", points)
    assert "elsewhere" in hqp.solvers.available()
    loaded = hqp.solvers.load("elsewhere", level=3)
    assert isinstance(loaded, Elsewhere)
    assert loaded.level == 3


@pytest.mark.long
def test_importing_the_solvers_imports_no_back_end() -> None:
    code = (
        "import sys, hqp.solvers; hqp.solvers.available(); hqp.solvers.load('nullspace');"
        "print([m for m in ('proxsuite', 'osqp', 'qpsolvers', 'daqp') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_activity_marks_sides() -> None:
    level = Rows(np.eye(5), np.array([0.0, 0, 0, 0, 1]), np.array([1.0, 1, 1, np.inf, 1]))
    np.testing.assert_array_equal(activity(level, np.array([0.0, 1.5, 0.5, 7.0, 0.0])), [-1, 1, 0, 0, EQUALITY])


def test_finish_computes_everything_from_the_problem() -> None:
    problem = Hierarchy((BOX, Rows(np.eye(2), np.ones(2), np.ones(2))), constraints=1)
    good = finish(problem, np.array([1.0, 0.5]), Status.OPTIMAL, Stats())
    assert good.status is Status.OPTIMAL
    np.testing.assert_array_equal(good.residuals[1], [0.0, -0.5])
    assert finish(problem, np.array([1.1, 0.5]), Status.OPTIMAL, Stats()).status is Status.CONSTRAINTS_VIOLATED
    lost = finish(problem, np.array([np.nan, 0.5]), Status.OPTIMAL, Stats())
    assert lost.status is Status.NOT_CERTIFIED
    assert np.isfinite(lost.x).all()


def test_flat_finishes_as_finish_does() -> None:
    rng = np.random.default_rng(0)
    levels = (
        BOX,
        Rows(Selection(np.array([1])), np.array([0.2]), np.array([0.2])),
        Rows(rng.normal(size=(3, 2)), *BOXES),
    )
    problem = Hierarchy(levels, constraints=2)
    flat = Flat(problem.shape, complete=True)
    assert flat.load(problem) == ""
    for x in rng.normal(size=(50, 2)):
        one, two = (
            flat.finish(problem, x, Status.OPTIMAL, Stats()),
            finish(problem, x, Status.OPTIMAL, Stats()),
        )
        assert one.status is two.status
        for a, b in zip((*one.residuals, *one.active), (*two.residuals, *two.active), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-15)


BOXES = (np.array([-0.5, -np.inf, 0.1]), np.array([0.5, 0.3, 0.1]))


def test_the_metric_factor_squares_to_the_metric() -> None:
    rng = np.random.default_rng(1)
    for rank in (0, 3, 6):
        root = rng.normal(size=(6, rank))
        F = metric_factor(root @ root.T)
        np.testing.assert_allclose(F.T @ F, root @ root.T, atol=1e-12)
        assert np.count_nonzero(np.abs(F).sum(axis=1)) == rank


def test_the_completion_as_levels() -> None:
    level = Rows(np.eye(2), np.zeros(2), np.zeros(2))
    (least,) = completion(Hierarchy((level,)))
    np.testing.assert_array_equal(least.dense(2), np.eye(2))
    (near,) = completion(Hierarchy((level,), origin=np.ones(2)))
    np.testing.assert_array_equal(near.lower, np.ones(2))
    weighed, least = completion(Hierarchy((level,), metric=np.diag([4.0, 0.0]), origin=np.ones(2)))
    np.testing.assert_allclose(weighed.slack(np.array([0.0, 5.0])), [-2.0, 0.0])
    np.testing.assert_array_equal(least.lower, np.zeros(2))
