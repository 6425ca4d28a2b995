"""Certificate of a priced level: refuse points off the set above, dearer points, and points short of the price.

The level's optimum, x = argmin ||w|| + c E(x), is known on paper.  A posture below has the judged point as its
reference, so that only the priced level can refuse it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import hqp.solvers
from hqp import Hierarchy, Motion, Rows, Selection, Status, certificate
from hqp.arrays import Mat, Vec

FIRST, SECOND, SLANTED = np.eye(3)[0], np.eye(3)[1], np.array([0.6, 0.0, 0.8])


def row(direction: Vec, goal: float) -> Rows:
    return Rows(direction[None], np.array([goal]), np.array([goal]))


def box(most: float) -> Rows:
    return Rows(Selection(np.arange(3)), np.full(3, -most), np.full(3, most))


@dataclass(frozen=True, kw_only=True)
class Case:
    """Rows above, one priced row, its optimum, and wrong points that the posture pulls to."""

    task: Rows
    x: Vec
    wrong: tuple[Vec, ...]
    above: Rows = box(10.0)  # noqa: RUF009
    price: float = 0.5
    motion: Motion | None = None

    def asked(self, posture: Vec, price: bool = True) -> Hierarchy:
        levels = (self.above, self.task, Rows(np.eye(3), posture, posture))
        prices = np.array([0.0, self.price, 0.0]) if price else None
        return Hierarchy(levels, constraints=1, prices=prices, motion=self.motion if price else None)


AHEAD_AND_BACK = (FIRST, -FIRST)
CASES = {
    "out of reach": Case(task=row(FIRST, 5.0), x=2.0 * FIRST, wrong=AHEAD_AND_BACK),  # |a| = c |x|
    "slanted": Case(task=row(SLANTED, 9.0), price=0.25, x=4.0 * SLANTED, wrong=(SLANTED, -SLANTED)),
    "dearer motion": Case(  # |a| = c 4 x
        task=row(FIRST, 5.0), motion=Motion(np.array([2.0, 1.0, 1.0])), x=0.5 * FIRST, wrong=AHEAD_AND_BACK
    ),
    "at the box": Case(above=box(1.5), task=row(FIRST, 5.0), x=1.5 * FIRST, wrong=AHEAD_AND_BACK),
    "below a row that is met": Case(
        above=row(SECOND, 0.7), task=row(FIRST, 5.0), x=2.0 * FIRST + 0.7 * SECOND,
        wrong=(*AHEAD_AND_BACK, SECOND, -SECOND),
    ),
    "met for its price": Case(task=row(FIRST, 1.0), x=FIRST, wrong=AHEAD_AND_BACK),
}  # fmt: skip


def claimed(x: Vec) -> Mat:
    """Stage points of a solver that claims x as the optimum of the priced level."""
    return np.array([np.full(3, np.nan), x, np.full(3, np.nan)])


EVERY = pytest.mark.parametrize("case", CASES.values(), ids=CASES)


@EVERY
def test_the_optimum_is_passed_and_found(case: Case) -> None:
    asked = case.asked(case.x)
    assert certificate(asked, case.x).ok, str(certificate(asked, case.x))
    np.testing.assert_allclose(hqp.solvers.load("lexicographic").solve(asked).x, case.x, atol=1e-6)


@EVERY
@pytest.mark.parametrize("far", [0.03, 0.3])
def test_a_point_that_the_posture_alone_wants_is_refused(case: Case, far: float) -> None:
    for step in case.wrong:
        x = case.x + far * step
        asked = case.asked(x)
        assert not certificate(asked, x).ok, step
        assert not certificate(asked, x, stages=claimed(x)).ok, step


TASK = np.array([1e6 * FIRST, 0.01 * SECOND])
SHORT = Case(  # the long row is met, the short one not: 0.01 = c |x|
    above=box(100.0), task=Rows(TASK, np.array([0.0, 5.0]), np.array([0.0, 5.0])), price=1e-3, x=10.0 * SECOND,
    wrong=(SECOND, -SECOND, SLANTED - 0.6 * FIRST, FIRST),
)  # fmt: skip


def test_a_short_row_beside_a_long_one_is_judged_as_well() -> None:
    asked = SHORT.asked(SHORT.x)
    assert certificate(asked, SHORT.x, 1e-8).ok
    assert certificate(asked, SHORT.x, 1e-8, claimed(SHORT.x)).ok
    for step in SHORT.wrong:
        x = SHORT.x + 1e-6 * step
        assert not certificate(SHORT.asked(x), x, 1e-8, claimed(x)).ok, step


def test_a_price_more_or_less_is_another_problem() -> None:
    case = CASES["out of reach"]
    exact = 5.0 * FIRST
    assert certificate(case.asked(exact, price=False), exact).ok
    assert not certificate(case.asked(exact), exact).ok
    assert not certificate(case.asked(exact), exact, stages=claimed(exact)).ok  # met, but above its price
    assert not certificate(case.asked(case.x, price=False), case.x).ok


def test_a_stage_outside_its_set_is_refused_though_the_answer_is_right() -> None:
    case = CASES["at the box"]
    asked = case.asked(case.x)
    assert certificate(asked, case.x, stages=claimed(case.x)).ok
    assert not certificate(asked, case.x, stages=claimed(2.0 * FIRST)).ok  # the optimum without the box


def test_a_stage_that_forgets_the_unmet_level_above_is_refused() -> None:
    """Two rows out of reach: alone, the optimum of the second row takes 0.6 of the first row's motion."""
    both = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)

    def asked(posture: Vec) -> Hierarchy:
        levels = (box(10.0), row(FIRST, 5.0), row(both, 20.0), Rows(np.eye(3), posture, posture))
        return Hierarchy(levels, constraints=1, prices=np.array([0.0, 0.5, 0.5, 0.0]))

    solution = hqp.solvers.load("lexicographic").solve(asked(np.zeros(3)))
    assert abs(solution.x[0] - 2.0) < 0.01
    assert solution.stage_points is not None
    stages = np.array(solution.stage_points)
    assert certificate(asked(np.zeros(3)), solution.x, stages=stages).ok
    stages[1], stages[2] = 2.0 * FIRST, 2.0 * both
    x = np.array([2.0, 2.0 * (np.sqrt(2.0) - 1.0), 0.0])  # both rows agree with these stages
    assert not certificate(asked(x), x, stages=stages).ok
    assert not certificate(asked(x), x).ok


@pytest.mark.parametrize("seed", range(40))
def test_a_level_without_a_price_hands_down_the_values_of_its_rows_alone(seed: int) -> None:
    """Below a priced level that is not met, turning that is 1e-8 to 1e-2 long fixes what long rows leave of a stage: it
    counts in no later one.  An error of the level's rows is refused."""
    rng, n = np.random.default_rng(seed), 6
    priced, exact, last = (rng.normal(size=(2, n)) for _ in range(3))
    levels, target = [], rng.normal(size=n)
    for A, apart in ((priced, 1.0), (exact * 10.0 ** rng.uniform(1.0, 4.0), 1.0), (last, 0.0)):
        b = A @ target
        levels.append(Rows(np.concatenate([A, A]), np.concatenate([b, b + apart]), np.concatenate([b, b + apart])))
        target = rng.normal(size=n)
    case = Hierarchy(
        tuple(levels),
        prices=np.array([10.0 ** rng.uniform(-3.0, 0.0), 0.0, 1.0]),
        turning=np.array([10.0 ** rng.uniform(-8.0, -2.0), 0.0, 0.0]),
        motion=Motion(np.ones(n)),
    )
    workspace = hqp.solvers.load("lexicographic").workspace(case.shape)
    workspace.limit(np.inf)  # type: ignore[attr-defined]
    found = workspace.solve(case)
    assert found.status is Status.OPTIMAL
    assert certificate(case, found.x, 1e-8, found.stage_points).ok
    moved = found.x + 1e-6 * float(np.linalg.norm(found.x)) * exact[0] / np.linalg.norm(exact[0])
    assert not certificate(case, moved, 1e-8, found.stage_points).ok
