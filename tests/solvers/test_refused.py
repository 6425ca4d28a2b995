"""Interface: ProblemError refuses invalid problems; accepted problems are solved right."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Hierarchy, Rows, Selection, Status
from hqp.errors import DeclarationError, ProblemError
from hqp.problem import Motion
from hqp.solvers import lexicographic
from hqp.solvers.lexicographic import Lexicographic
from hqp.solvers.many import HierarchyBatch

if lexicographic.kernel() == "":
    pytest.skip("built without the native kernel", allow_module_level=True)

N = 6
PRICES = np.array([0.0, 0.3, 0.3])
ZERO = np.zeros(1)


def problem(seed: int = 0, prices: Any = None) -> Hierarchy:
    rng = np.random.default_rng(seed)
    box = Rows(Selection(np.arange(N)), np.full(N, -0.4), np.full(N, 0.4))
    levels = [Rows(rng.normal(size=(m, N)), *(rng.normal(size=m),) * 2) for m in (3, 2)]
    return Hierarchy((box, *levels), constraints=1, prices=None if prices is None else prices.copy())


def unaligned(a: np.ndarray) -> np.ndarray:
    made = np.frombuffer(bytearray(a.nbytes + 1), a.dtype, a.size, 1).reshape(a.shape)
    made[...] = a
    assert not made.flags.aligned
    return made


def strided(a: np.ndarray) -> np.ndarray:
    return np.repeat(a, 2, axis=-1)[..., ::2]


def stored(base: Hierarchy, as_: Callable[[np.ndarray], np.ndarray]) -> Hierarchy:
    """The problem in arrays with another storage."""
    levels = [
        Rows(
            Selection(as_(rows.A.index), as_(rows.A.scale)) if isinstance(rows.A, Selection) else as_(rows.A),
            as_(rows.lower),
            as_(rows.upper),
        )
        for rows in base.levels
    ]
    extras = {name: getattr(base, name) for name in ("metric", "origin", "prices")}
    motion = None if base.motion is None else Motion(as_(base.motion.F))
    return replace(
        base,
        levels=tuple(levels),
        motion=motion,
        **{name: None if a is None else as_(a) for name, a in extras.items()},
    )


@pytest.mark.parametrize("as_", [unaligned, strided, np.asfortranarray])
@pytest.mark.parametrize("prices", [None, PRICES], ids=["exact", "priced"])
def test_arrays_stored_otherwise_are_read_right_and_live(as_: Callable[..., Any], prices: Any) -> None:
    rng = np.random.default_rng(1)
    motion = None if prices is None else Motion(np.eye(N) + 0.1 * rng.normal(size=(N, N)))
    extras: list[dict[str, Any]] = [{}, {"origin": np.arange(float(N))}, {"metric": np.diag(np.arange(1.0, N + 1))}]
    for extra in extras:
        plain = replace(problem(2, prices), motion=motion, **extra)
        odd = stored(plain, as_)
        workspace, native = Lexicographic().workspace(odd.shape), Lexicographic().workspace(plain.shape)
        for _ in range(3):
            found, right = workspace.solve(odd), native.solve(plain)
            assert found.status is right.status is Status.OPTIMAL
            np.testing.assert_allclose(found.x, right.x, rtol=0.0, atol=1e-7)
            for one, other in zip(odd.levels[1:], plain.levels[1:], strict=True):
                one.A[...] = other.A[...] = rng.normal(size=other.A.shape)  # type: ignore[index,union-attr]
                one.lower[...] = other.lower[...] = rng.normal(size=other.m)
                one.upper[...] = other.upper[...] = other.lower


def test_solve_many_reads_arrays_stored_otherwise() -> None:
    right = Lexicographic().solve(problem()).x
    np.testing.assert_array_equal(hqp.solve_many([problem(), stored(problem(), unaligned)]).x, [right, right])
    levels = tuple((rows.A, rows.lower, rows.upper) for rows in stored(problem(), unaligned).levels)
    np.testing.assert_array_equal(hqp.solve_many(HierarchyBatch(levels, constraints=1)).x, [right])


@pytest.mark.parametrize("name", ["lexicographic", "reference", "cascade", "weighted"])
def test_a_workspace_made_for_exact_levels_takes_no_prices(name: str) -> None:
    workspace = hqp.solvers.load(name).workspace(problem().shape)
    with pytest.raises(ProblemError, match="without a price of level 1"):
        workspace.solve(problem(prices=PRICES))


@pytest.mark.parametrize("of_stages", ["effort", "unpriced_met", "describe"])
def test_stages_are_refused_before_a_problem_is_priced(of_stages: str) -> None:
    workspace = Lexicographic().workspace(problem().shape)
    found = workspace.solve(problem())
    given = {"unpriced_met": (found.x,), "describe": (found.x, np.zeros(N + 5), np.zeros(N + 5, dtype=np.int8))}
    with pytest.raises(ValueError, match="price a problem first"):
        getattr(workspace.native, of_stages)(*given.get(of_stages, ()))  # type: ignore[attr-defined]


def test_an_exact_problem_that_is_refilled_with_prices_is_refused() -> None:
    live = problem(prices=np.zeros(3))
    workspace = Lexicographic().workspace(live.shape)
    assert workspace.solve(live).status is Status.OPTIMAL
    live.prices[1] = 0.3  # type: ignore[index]
    with pytest.raises(ProblemError, match="price of level 1"):
        workspace.solve(live)
    live.prices[1] = 0.0  # type: ignore[index]
    assert workspace.solve(live).status is Status.OPTIMAL


@pytest.mark.parametrize(("level", "price"), [(1, np.nan), (1, -3.0), (1, np.inf), (0, 0.2)])
def test_a_price_that_is_refilled_with_what_is_none_is_refused(level: int, price: float) -> None:
    live = problem(prices=PRICES)
    workspace = Lexicographic().workspace(live.shape)
    right = workspace.solve(live)
    live.prices[level] = price  # type: ignore[index]
    for again in (live, replace(live, prices=PRICES.copy())):  # bound already, and not yet
        again.prices[level] = price  # type: ignore[index]
        with pytest.raises(ProblemError, match=f"price of level {level}"):
            workspace.solve(again)
        again.prices[level] = PRICES[level]  # type: ignore[index]
    np.testing.assert_allclose(workspace.solve(live).x, right.x, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("f", [None, np.zeros(0)])
def test_motion_of_no_rows_is_refused(f: Any) -> None:
    with pytest.raises(ProblemError, match="at least one row"):
        Motion(np.zeros((0, N)), f)


NO_NUMBERS: list[Any] = [
    "text",
    [["1", "2"]],
    [[b"1", b"2"]],
    np.ones((1, 2)) * 1j,
    [[1, 2], [3]],
    [[None, 1.0]],
    np.array([["2020", "2021"]], "datetime64[Y]"),
    {"a": 1},
]


@pytest.mark.parametrize("given", NO_NUMBERS, ids=lambda a: type(a).__name__)
def test_what_is_no_array_of_real_numbers_is_refused_everywhere(given: Any) -> None:
    makers: list[Callable[[], object]] = [
        lambda: Rows(given, ZERO, ZERO),
        lambda: Rows(np.ones((1, 2)), given, ZERO),
        lambda: Rows(np.ones((1, 2)), ZERO, given),
        lambda: Selection(np.arange(2), given),
        lambda: Selection(given),
        lambda: Motion(given),
        lambda: Motion(np.eye(2), given),
        *(lambda name=name: replace(problem(), **{name: given}) for name in ("metric", "origin", "prices", "turning")),
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for make in makers:
            with pytest.raises(ProblemError, match=r"real numbers|integers"):
                make()


@pytest.mark.parametrize(
    "wrong",
    [{"constraints": "1"}, {"constraints": 0.5}, {"n": "2"}, {"levels": None}, {"motion": "x"}, {"motion": np.eye(2)}],
    ids=str,
)
def test_fields_of_a_wrong_kind_are_refused(wrong: dict[str, Any]) -> None:
    name = next(iter(wrong))
    with pytest.raises(ProblemError, match=name):
        replace(problem(), **wrong)


@pytest.mark.parametrize("given", [None, "text", (1, 2)])
def test_what_is_no_hierarchy_is_refused(given: Any) -> None:
    for name in ("lexicographic", "reference", "cascade", "weighted"):
        solver = hqp.solvers.load(name)
        with pytest.raises(ProblemError, match="Hierarchy"):
            solver.solve(given)
        with pytest.raises(ProblemError, match="Hierarchy"):
            solver.workspace(problem().shape).solve(given)
        with pytest.raises(ProblemError, match="Shape"):
            solver.workspace(given)
    with pytest.raises(ProblemError, match="Hierarchy"):
        Lexicographic().workspace(problem(prices=PRICES).shape).solve(given)
    with pytest.raises(ProblemError, match="Hierarchy"):
        hqp.solve_many([problem(), given])
    with pytest.raises(ProblemError, match=r"solve_many|Hierarchy"):
        hqp.solve_many(given)


@pytest.mark.parametrize("option", ["rank_tolerance", "max_iterations", "deadline", "max_failed_exchanges"])
def test_options_of_a_wrong_kind_are_refused(option: str) -> None:
    for given in ("text", 1j):
        with pytest.raises(DeclarationError, match=option):
            Lexicographic(**{option: given})
    for seconds in ("text", np.nan, -1.0):
        with pytest.raises(DeclarationError, match="time limit"):
            Lexicographic().workspace(problem().shape).limit(seconds)  # type: ignore[attr-defined]
