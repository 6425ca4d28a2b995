"""Problem sets: read after write, and qpbenchmark reads the levels as quadratic programmes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp.errors import DeclarationError

pytest.importorskip("pyarrow")

from hqp.lab import problem_sets
from tests.scenes import problems, random_hierarchies

RANDOM = [p for s in range(30) if (p := random_hierarchies.hierarchy(s, 12)).metric is None and p.origin is None][:5]


def test_a_set_comes_back(tmp_path: Path) -> None:
    given = [*problems.load(problems.names()[0], 3), *RANDOM]
    file = problem_sets.write(
        tmp_path / "set.parquet", given, name="mixed", description="for a test", difficulty="easy"
    )
    found = problem_sets.read(file)
    assert problem_sets.about(file)["difficulty"] == "easy"
    assert len(found) == len(given)
    for a, b in zip(given, found, strict=True):
        assert (a.n, a.constraints, a.shape.rows, a.shape.selections) == (
            b.n,
            b.constraints,
            b.shape.rows,
            b.shape.selections,
        )
        for ours, theirs in zip(a.levels, b.levels, strict=True):
            assert np.array_equal(ours.dense(a.n), theirs.dense(b.n))
            assert np.array_equal(ours.lower, theirs.lower)
            assert np.array_equal(ours.upper, theirs.upper)
    (tmp_path / "no.parquet").write_text("no")
    with pytest.raises(DeclarationError, match="not a problem set"):
        problem_sets.read(tmp_path / "no.parquet")


def test_levels_as_quadratic_programmes_have_our_residuals() -> None:
    import qpsolvers

    problem = problems.load(problems.names()[0], 1)[0]
    solution = hqp.solvers.load("lexicographic").workspace(problem.shape).solve(problem)
    for k, programme in enumerate(problem_sets.quadratic_programmes(problem, "p")):
        programme.pop("name")
        found = qpsolvers.solve_problem(qpsolvers.Problem(**programme), solver="proxqp", eps_abs=1e-9)
        assert found.found
        norm = np.linalg.norm(solution.residuals[k])
        assert np.linalg.norm(found.x[problem.n :]) == pytest.approx(norm, abs=1e-5 * (1.0 + norm))


def test_qpbenchmark_loads_an_export(tmp_path: Path) -> None:
    qpbenchmark = pytest.importorskip("qpbenchmark")
    given = problems.load(problems.names()[0], 2)
    file = problem_sets.write(tmp_path / "set.parquet", given, name="s", description="d", difficulty="easy")
    export = problem_sets.to_qpbenchmark(file, tmp_path / "qp.parquet")

    class Set(qpbenchmark.ParquetTestSet):
        title, description, sparse_only = "t", "d", False

    loaded = list(Set(export))
    assert len(loaded) == sum(len(problem.levels) for problem in given)
    assert loaded[0].P.shape[0] == given[0].n + given[0].levels[0].m


def test_the_hard_half_is_published_as_hard(tmp_path: Path) -> None:
    given = problems.load("hard/d57", 2)
    file = problem_sets.write(tmp_path / "d57.parquet", given, name="hard/d57", description="d", difficulty="hard")
    found = problem_sets.read(file)
    solver = hqp.solvers.load("lexicographic")
    assert all(hqp.certificate(p, solver.workspace(p.shape).solve(p).x).ok for p in found)
