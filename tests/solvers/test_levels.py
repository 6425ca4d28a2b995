"""Strict levels of plain rows: the optimum of the hierarchy for any storage of the arrays."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Hierarchy, Rows, Selection, Status
from hqp.errors import ProblemError


def drawn(seed: int, worlds: int = 0) -> tuple[list[Any], Any]:
    """Random levels of 4 to 8 variables, some of them infeasible, and bounds."""
    rng = np.random.default_rng(seed)
    n, lead = int(rng.integers(4, 9)), (worlds,) if worlds else ()
    levels: list[Any] = [(rng.normal(size=(*lead, 3, n)), rng.normal(size=(*lead, 3)))]
    low = rng.normal(size=(*lead, 2))
    levels.append((rng.normal(size=(*lead, 2, n)), low, low + rng.uniform(0.0, 1.0, size=(*lead, 2))))
    levels.append((np.eye(n), rng.normal(size=n)))
    return levels, (-0.5, rng.uniform(0.2, 1.0, size=n))


def reference(levels: list[Any], bounds: Any, n: int) -> Any:
    """Solution of the hierarchy built by hand and solved cold."""
    hard = Rows(Selection(np.arange(n)), *(np.broadcast_to(side, n) for side in bounds))
    rows = [Rows(A, two[0], two[-1]) for A, *two in levels]
    return hqp.solvers.load("lexicographic").solve(Hierarchy((hard, *rows), 1))


@pytest.mark.parametrize("seed", range(8))
def test_it_is_the_optimum_of_the_hierarchy(seed: int) -> None:
    levels, bounds = drawn(seed)
    n = levels[0][0].shape[1]
    hqp.solve_levels(*drawn(seed + 100))  # an earlier problem does not change the answer
    found, same = hqp.solve_levels(levels, bounds), reference(levels, bounds, n)
    np.testing.assert_array_equal(found.x, same.x)
    np.testing.assert_allclose(found.residuals, same.norms[1:], atol=1e-12)
    assert found.status is same.status is Status.OPTIMAL
    assert found.solved
    again = hqp.solve_levels([tuple(np.asfortranarray(part) for part in level) for level in levels], bounds)
    np.testing.assert_array_equal(found.x, again.x)  # nor does the storage


@pytest.mark.parametrize("seed", range(4))
def test_stacked_problems_are_those_one_by_one(seed: int) -> None:
    levels, bounds = drawn(seed, worlds=5)
    many = hqp.solve_levels(levels, bounds, threads=2)
    assert many.x.shape == (5, levels[0][0].shape[2])
    assert many.residuals.shape == (5, 3)
    for i in range(5):
        one = hqp.solve_levels([tuple(p[i] if p.shape[:1] == (5,) else p for p in level) for level in levels], bounds)
        np.testing.assert_allclose(many.x[i], one.x, atol=1e-12)
        np.testing.assert_allclose(many.residuals[i], one.residuals, atol=1e-12)
        assert many.status[i] is one.status
    shared = hqp.solve_levels([(np.eye(3), np.arange(6.0).reshape(2, 3))])  # A shared by all
    np.testing.assert_allclose(shared.x, np.arange(6.0).reshape(2, 3), atol=1e-12)


def test_the_null_space_of_a_task_is_free_for_the_next() -> None:
    """A posture below a position task moves no direction of the position, as a projector N = I - J^+ J would."""
    rng = np.random.default_rng(3)
    J, rate, posture = rng.normal(size=(3, 7)), rng.normal(size=3), rng.normal(size=7)
    found = hqp.solve_levels([(J, rate), (np.eye(7), posture)])
    pinv = np.linalg.pinv(J)
    np.testing.assert_allclose(found.x, pinv @ rate + (np.eye(7) - pinv @ J) @ posture, atol=1e-10)


@pytest.mark.parametrize(
    ("levels", "bounds", "word"),
    [
        ([], None, "given none"),
        ([np.eye(2)], None, "a level is"),
        ([(np.eye(2), np.zeros(3))], None, "A has 2 rows"),
        ([(np.zeros(2), np.zeros(2))], None, "has shape"),
        ([(np.eye(2), np.zeros(2)), (np.eye(3), np.zeros(3))], None, "3 columns"),
        ([(np.eye(2), np.full(2, np.nan))], None, "lower <= upper"),
        ([(np.eye(2), np.ones(2), np.zeros(2))], None, "lower <= upper"),
        ([(np.full((1, 2), np.inf), np.zeros(1))], None, "not finite"),
        ([(np.eye(2), np.zeros(2))], (np.zeros(3), np.ones(3)), "bounds of shape"),
        ([(np.eye(2), np.zeros(2))], (1.0, 0.0), "lower <= upper"),
        ([(np.eye(2), ["a", "b"])], None, "real numbers"),
    ],
)
def test_bad_rows_are_refused(levels: Any, bounds: Any, word: str) -> None:
    with pytest.raises(ProblemError, match=word):
        hqp.solve_levels(levels, bounds)


class Lent:
    """Tensor of a library that exports its memory by DLPack, on the CPU or elsewhere."""

    def __init__(self, array: Any, device: int = 1) -> None:
        self.array, self.device, self.dtype = array, device, array.dtype

    def __dlpack__(self, **options: Any) -> Any:
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        return self.device, 0


def test_tensors_are_read_in_place_and_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "from_dlpack", Lent, raising=False)
    levels, bounds = drawn(1)
    lent = [tuple(Lent(part) for part in level) for level in levels]
    monkeypatch.setitem(sys.modules, Lent.__module__.partition(".")[0], sys.modules[__name__])
    found = hqp.solve_levels(lent, bounds)
    assert isinstance(found.x, Lent)
    np.testing.assert_array_equal(found.x.array, hqp.solve_levels(levels, bounds).x)
    with pytest.raises(ProblemError, match="move it to the CPU"):
        hqp.solve_levels([(Lent(np.eye(2), device=2), np.zeros(2))])


def test_tensors_of_torch() -> None:
    torch = pytest.importorskip("torch", reason="an environment of make test-environments has it")
    levels, bounds = drawn(2, worlds=3)
    found = hqp.solve_levels(
        [tuple(torch.tensor(part, dtype=torch.float32) for part in level) for level in levels], bounds
    )
    assert found.x.dtype == torch.float32
    np.testing.assert_allclose(found.x.numpy(), hqp.solve_levels(levels, bounds).x, atol=1e-4)
    moved = torch.tensor(levels[0][0][0], requires_grad=True)
    assert not hqp.solve_levels([(moved, levels[0][1][0])]).x.requires_grad


def test_bounds_that_bind_nothing_are_no_rows() -> None:
    """Rows without bounds, levels without rows and infinite bounds on x do not change the answer."""
    free = (np.ones((1, 3)), [-np.inf], [np.inf])
    found = hqp.solve_levels([free, (np.zeros((0, 3)), np.zeros(0)), (np.eye(3), np.ones(3))], (-np.inf, np.inf))
    np.testing.assert_array_equal(found.x, np.ones(3))
    for low, high in ((np.inf, np.inf), (-np.inf, -np.inf)):
        with pytest.raises(ProblemError, match="lower <= upper"):
            hqp.solve_levels([(np.eye(3), np.zeros(3))], (low, high))
