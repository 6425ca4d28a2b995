"""Conflicts of constraints: irreducible, named, with the least relaxation of each row."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
import hqp.explanation.conflict as questions
from hqp import Hierarchy, Level, Rows, Selection, Stack, Status
from hqp.commands.arguments import formulation
from hqp.explanation.conflict import conflict
from hqp.tasks import FixedContact, JointLimits, PointContact, Posture
from tests.scenes.overloaded import overloaded

inf = np.inf


def rows(A: object, lower: object, upper: object) -> Rows:
    return Rows(np.array(A, dtype=float), np.array(lower, dtype=float), np.array(upper, dtype=float))


box = Rows(Selection(np.arange(2)), np.array([-1.0, -1.0]), np.array([1.0, 1.0]))

CASES = {
    "above a box": ((box, rows([[1, 0]], [2], [inf])), "level 0, row 0 upper and level 1, row 0 lower", 1.0),
    "below a box": ((box, rows([[0, 1]], [-inf], [-3])), "level 0, row 1 lower and level 1, row 0 upper", 2.0),
    "two equalities": ((rows([[1, 1], [1, 1]], [0, 1], [0, 1]),), "level 0, row 0 and level 0, row 1", 1.0),
    "a sum over the box": (
        (box, rows([[1, 1]], [3], [3])), "level 0, row 0 upper, level 0, row 1 upper and level 1, row 0", 1.0,
    ),
    "one row that is none": ((rows([[0, 0]], [1], [1]),), "level 0, row 0", 1.0),
    "three sides": (
        (rows([[1, 0], [0, 1], [-1, -1]], [1, 1, -1], [inf, inf, inf]),),
        "level 0, row 0 lower, level 0, row 1 lower and level 0, row 2 lower", 1.0,
    ),
    "one row too many": (
        (box, rows([[1, 0], [1, 0]], [2, 2.5], [inf, inf])),
        "level 0, row 0 upper and level 1, row 1 lower exclude", 1.5,
    ),
    "in rows of other lengths": ((box, rows([[100, 0]], [200], [inf])), "level 0, row 0 upper and level 1, row 0", 1.0),
    "beside rows that hold": (
        (box, rows([[1, 0], [0, 1], [1, -1]], [2, 0, -9], [inf, 0.5, 9])),
        "level 0, row 0 upper and level 1, row 0", 1.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("certified", [True, False])
@pytest.mark.parametrize("case", CASES)
def test_a_conflict_is_irreducible_and_measured(case: str, certified: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """certified: find a certificate of few rows; else drop rows one after the other."""
    if not certified:
        monkeypatch.setattr(questions, "_smallest_certificate", lambda *_: None)
    levels, said, least = CASES[case]
    found = conflict(Hierarchy(levels, constraints=len(levels), n=2))
    assert found
    assert str(found).startswith(said)
    assert min(row.relaxation for row in found.rows) == pytest.approx(least, rel=1e-6)
    bounds = {(row.level, row.row) for row in found.rows}
    for spared in bounds:  # without any one of its rows the rest is feasible
        left = [
            Rows(level.dense(2)[[i for i in range(level.m) if (k, i) in bounds - {spared}]],
                 level.lower[[i for i in range(level.m) if (k, i) in bounds - {spared}]],
                 level.upper[[i for i in range(level.m) if (k, i) in bounds - {spared}]])
            for k, level in enumerate(levels)
        ]  # fmt: skip
        assert not conflict(Hierarchy(tuple(left), constraints=len(left), n=2))


def test_what_can_hold_is_no_conflict() -> None:
    found = conflict(Hierarchy((box, rows([[1, 1]], [2], [2])), constraints=2))
    assert not found
    assert str(found) == "the constraints are feasible"


def test_a_foot_that_is_pulled_is_named_with_the_one_that_holds_it() -> None:
    robot = hqp.robots.load("talos")
    left, right = robot.landmarks["soles"]
    pulled = PointContact(frame=right, name="pulled")
    stack = Stack(
        Level(Posture()), subject_to=[FixedContact(frame=left), FixedContact(frame=right), pulled, JointLimits()]
    )
    session = hqp.Controller(stack, deadline=np.inf).session(robot, 0.002)
    session.step(robot.state())
    tick = session.step(robot.state(), pulled.at(velocity=[0.1, 0.0, 0.0]))
    assert tick.status is Status.CONSTRAINTS_VIOLATED
    found = tick.conflict()
    assert {row.name.split(" row")[0].split(":")[0] for row in found.rows} == {"pulled", right}
    assert {round(row.relaxation, 6) for row in found.rows} == {0.1}
    assert "exclude each other" in str(found)
    session.step(robot.state())
    with pytest.raises(hqp.HqpError, match="latest"):
        tick.conflict()


@pytest.mark.parametrize("seed", range(8))
def test_a_conflict_is_irreducible_and_says_by_how_much(seed: int) -> None:
    """Without any one row the others are feasible, and that row is violated by the reported relaxation."""
    rng = np.random.default_rng(seed)
    n, m = 6, 30
    A = rng.standard_normal((m, n)) * rng.uniform(0.1, 100.0, (m, 1))
    lower = A @ rng.standard_normal(n) + rng.uniform(0.0, 1.0, m)
    upper = np.where(rng.random(m) < 0.2, lower, np.inf)
    found = conflict(Hierarchy((Rows(A, lower, upper),), constraints=1))
    assert 2 <= len(found.rows) <= n + 1
    kept = [row.row for row in found.rows]
    for row in found.rows:
        rest = [i for i in kept if i != row.row]
        last = Rows(A[[row.row]], lower[[row.row]], upper[[row.row]])
        answer = hqp.solvers.load("reference").solve(Hierarchy((Rows(A[rest], lower[rest], upper[rest]), last)))
        assert np.abs(answer.residuals[0]).max() < 1e-7
        assert abs(float(answer.residuals[1][0])) == pytest.approx(row.relaxation, rel=1e-6)


def test_a_conflict_of_a_whole_robot_is_quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """51 rows of CBi conflict: one solve and its certificate suffice, without the filter that solves once per row."""
    robot = hqp.robots.load("cbi")
    run = hqp.Controller(overloaded(robot), formulation("torque"), deadline=np.inf).session(robot, 0.002)
    rng, q, v = np.random.default_rng(0), robot.home.copy(), np.zeros(robot.nv)
    found = 0
    monkeypatch.setattr(questions, "QUICK", np.inf)
    monkeypatch.setattr(questions, "_filtered", None)
    for k in range(20):
        tick = run.step(robot.state(q, v))
        if tick.status is Status.CONSTRAINTS_VIOLATED:
            assert len(tick.conflict().rows) > 10
            found += 1
        q, v = tick.advance()
        v = v + rng.normal(0.0, 0.1, v.size) if k == 9 else v
    assert found > 5
