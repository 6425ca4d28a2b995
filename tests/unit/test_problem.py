"""Interface to solvers: accepted problems, refused problems, error texts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hqp import Hierarchy, Rows, Selection, Solution, Status
from hqp.errors import NotSolved, ProblemError
from hqp.problem import EQUALITY, Shape, Stacked, has_inequalities

EYE = np.eye(2)
INF = np.inf


def rows(lower: float = 0.0, upper: float = 1.0, n: int = 2) -> Rows:
    return Rows(np.eye(n), np.full(n, lower), np.full(n, upper))


@pytest.mark.parametrize(
    ("A", "lower", "upper", "word"),
    [
        (np.ones(3), np.zeros(3), np.zeros(3), "two dimensions"),
        (EYE, np.zeros(3), np.zeros(2), "lower has shape"),
        (EYE, np.zeros(2), np.zeros((2, 1)), "upper has shape"),
        (np.array([[1.0, np.nan], [0.0, 1.0]]), np.zeros(2), np.zeros(2), "not finite in row 0"),
        (np.array([[1.0, 0.0], [0.0, np.inf]]), np.zeros(2), np.zeros(2), "not finite in row 1"),
        (EYE, np.array([0.0, np.nan]), np.zeros(2), "row 1"),
        (EYE, np.array([0.0, 2.0]), np.ones(2), "lower <= upper, row 1"),
        (EYE, np.array([INF, 0.0]), np.array([INF, 0.0]), "row 0"),
        (EYE, np.array([-INF, 0.0]), np.array([-INF, 0.0]), "row 0"),
    ],
)
def test_rows_refuse(A: Any, lower: Any, upper: Any, word: str) -> None:
    with pytest.raises(ProblemError, match=word):
        Rows(A, lower, upper)


@pytest.mark.parametrize(
    ("index", "scale", "word"),
    [
        ([[0, 1]], None, "one vector each"),
        ([0, 1], [1.0], "one vector each"),
        ([0, -1], None, "negative position -1"),
        ([0, 1], [1.0, 0.0], "not zero"),
        ([0, 1], [1.0, np.nan], "finite"),
        ([0.0, 1.5], None, "integers"),
    ],
)
def test_selections_refuse(index: Any, scale: Any, word: str) -> None:
    with pytest.raises(ProblemError, match=word):
        Selection(np.array(index), None if scale is None else np.array(scale))


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Hierarchy(()), "n = 0"),
        (lambda: Hierarchy((), n=-1), "n = 0"),
        (lambda: Hierarchy((rows(), rows(n=3))), r"disagree on n: \[2, 3\]"),
        (lambda: Hierarchy((rows(),), n=3), "disagree on n"),
        (lambda: Hierarchy((rows(),), origin=np.zeros(3)), "disagree on n"),
        (lambda: Hierarchy((rows(),), origin=np.array(1.0)), "must be a vector"),
        (lambda: Hierarchy((rows(),), origin=np.array([0.0, np.inf])), "origin must be finite"),
        (lambda: Hierarchy((rows(),), metric=np.ones((2, 3))), "metric must be finite with shape"),
        (lambda: Hierarchy((rows(),), metric=np.array([[1.0, 0.0], [1.0, 1.0]])), "symmetric"),
        (lambda: Hierarchy((rows(),), metric=np.diag([1.0, -1.0])), "semidefinite.*-1"),
        (lambda: Hierarchy((rows(),), metric=np.diag([1.0, np.nan])), "metric must be finite"),
        (lambda: Hierarchy((rows(),), constraints=2), "constraints = 2, there are 1 levels"),
        (lambda: Hierarchy((Rows(Selection(np.array([5])), np.zeros(1), np.zeros(1)),), n=3), "variable 5 of 3"),
        (lambda: Hierarchy((Rows(Selection(np.array([0])), np.zeros(1), np.zeros(1)),)), "n = 0, allowed 1"),
        (lambda: Hierarchy((EYE,)), "level 0 must be Rows, given ndarray"),  # type: ignore[arg-type]
    ],
)
def test_hierarchies_refuse(make: Any, word: str) -> None:
    with pytest.raises(ProblemError, match=word):
        make()


def test_rows_keep_float_arrays_and_convert_others() -> None:
    A, b = np.eye(2), np.zeros(2)
    kept = Rows(A, b, b)
    assert kept.A is A
    assert kept.lower is b
    assert Rows([[1, 2]], [0], [1]).lower.dtype == np.float64  # type: ignore[arg-type]


def test_live_rows_can_be_checked_again() -> None:
    A = np.eye(2)
    live = Rows(A, np.zeros(2), np.ones(2))
    A[0, 0] = np.nan
    with pytest.raises(ProblemError, match="row 0"):
        live.check()


def test_slack_is_signed_by_the_side_it_leaves() -> None:
    level = Rows(np.eye(4), np.array([0.0, 0.0, 0.0, -INF]), np.array([1.0, 1.0, 0.0, INF]))
    np.testing.assert_array_equal(level.slack(np.array([2.0, -3.0, 0.5, 9.0])), [1.0, -3.0, 0.5, 0.0])
    np.testing.assert_array_equal(level.equality, [False, False, True, False])


def test_a_selection_is_its_matrix() -> None:
    pick = Selection(np.array([2, 0, 2]), np.array([2.0, -1.0, 0.5]))
    x = np.array([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(pick @ x, pick.dense(3) @ x)
    level = Rows(pick, np.zeros(3), np.zeros(3))
    assert level.m == 3
    np.testing.assert_array_equal(level.dense(3), pick.dense(3))


def test_shape_and_inequalities() -> None:
    left_out = Rows(EYE, np.full(2, -INF), np.full(2, INF))
    assert not has_inequalities(left_out)
    assert has_inequalities(rows())
    problem = Hierarchy((left_out, rows(1.0, 1.0)), origin=np.zeros(2))
    assert problem.shape == Shape(2, (2, 2), (False, False), inequalities=False, metric=False, origin=True)
    assert Hierarchy((rows(),), metric=EYE).shape.inequalities


def test_stacked_levels_share_one_product() -> None:
    A, b = np.arange(8.0).reshape(4, 2), np.ones(4)
    block = Stacked(A, b, b, (slice(0, 1), None, slice(1, 4)))
    levels = (Rows(A[:1], b[:1], b[:1]), Rows(Selection(np.array([1])), b[:1], b[:1]), Rows(A[1:], b[1:], b[1:]))
    problem, plain = Hierarchy(levels, stacked=block), Hierarchy(levels)
    x = np.array([0.3, -2.0])
    for one, two in zip(problem.slacks(x), plain.slacks(x), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-15)


def test_a_copy_is_free_of_the_original() -> None:
    A, origin = np.eye(2), np.zeros(2)
    problem = Hierarchy((Rows(A, np.zeros(2), np.ones(2)),), metric=np.eye(2), origin=origin)
    twin = problem.copy()
    A[0, 0], origin[0] = 7.0, 7.0
    assert twin.levels[0].dense(2)[0, 0] == 1.0
    assert twin.origin is not None
    assert twin.origin[0] == 0.0
    assert twin.stacked is None


def test_statuses_are_ordered_and_explain_themselves() -> None:
    assert Status.worst() is Status.OPTIMAL
    assert Status.worst(Status.OPTIMAL, Status.NOT_CERTIFIED, Status.RANK_UNCERTAIN) is Status.NOT_CERTIFIED
    assert [s for s in Status if s.solved] == [Status.OPTIMAL, Status.RANK_UNCERTAIN, Status.CONSTRAINTS_VIOLATED]
    assert Status.NOT_CERTIFIED.severity > Status.TIME_LIMIT.severity  # refused is worse than cut short
    unusable = ["NOT_CERTIFIED", "DYNAMICS_FAILED", "NOT_FOLLOWING", "INVALID_STATE", "STOPPED"]
    assert [s.name for s in Status if not s.usable] == unusable
    assert all(":" in status.value for status in Status)  # meaning: advice


def test_unwrap_throws_with_a_copy_of_the_problem() -> None:
    problem = Hierarchy((rows(1.0, 1.0),))
    x = np.ones(2)
    marks = (np.full(2, EQUALITY, dtype=np.int8),)
    assert Solution(x, Status.OPTIMAL, (np.zeros(2),), marks).unwrap() is x
    bad = Solution(x, Status.NOT_CERTIFIED, (np.full(2, 3.0),), marks, detail="level 0 has a gap")
    with pytest.raises(NotSolved, match=r"NOT_CERTIFIED.*level 0 has a gap") as caught:
        bad.unwrap(problem)
    assert caught.value.problem is not problem
    np.testing.assert_allclose(bad.norms, [np.sqrt(18.0)])


def test_a_hierarchy_and_its_answer_say_in_words_what_they_are() -> None:
    box = Rows(Selection(np.arange(2)), -np.ones(2), np.ones(2))
    task = Rows(np.array([[1.0, 1.0], [0.0, 1.0], [1.0, 0.0]]), np.array([3.0, -INF, 0.0]), np.array([3.0, INF, INF]))
    problem = Hierarchy((box, task), constraints=1, prices=np.array([0.0, 0.1]))
    assert str(problem).splitlines() == [
        "hierarchy of 2 variables",
        "  level 0, to hold: 2 inequalities on single variables",
        "  level 1: 1 equality, 1 inequality, 1 left out, price 0.1",
    ]
    answer = Solution(np.ones(2), Status.OPTIMAL, (np.zeros(2), np.array([-1.0, 0.0])), ())
    assert str(answer) == "OPTIMAL; ||w|| 0, 1"
    assert str(Solution(np.ones(2), Status.NOT_CERTIFIED, (), (), detail="why")).endswith("; why")
