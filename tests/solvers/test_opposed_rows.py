"""Two feet at the edges of their friction cones: the completion is unique, independent of earlier solves."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp import Hierarchy, Rows, Status, certificate
from hqp.problem.definition import Levels, Limits
from tests.scenes.priced import is_unsure
from tests.scenes.stacks import scene


@pytest.mark.long
@pytest.mark.parametrize(("name", "ticks"), [("talos", 34), ("g1", 34), ("romeo", 3), ("cbi", 6)])
def test_torques_that_no_level_determines_are_one_answer(
    name: str, ticks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The soles are rotated against each other by 1e-10 to 1e-6 rad, so that rows of their cones are nearly opposed.

    Certain answers agree to 1e-6. Answers of uncertain rank differ by up to 1e-4, in the motion. The certificate judges
    every stage at the point that the solver returned.
    """

    def unknown(*_: object) -> None:
        raise AssertionError("the certificate solved a stage")

    monkeypatch.setattr("hqp.problem.stage_conditions.solve_level", unknown)
    session, given = scene(name, "torque")
    robot, solver = session.robot, hqp.solvers.load("lexicographic")
    q, v = robot.home.copy(), np.zeros(robot.nv)
    for i in range(ticks):
        tick = session.step(robot.state(q, v), *given(i))
        assert tick.status.solved, (i, tick.notes)
        if i % 3 != 0:  # two of three: halves the time
            cold = solver.solve(session.problem)
            near = 1e-6 if tick.status is cold.status is Status.OPTIMAL else 1e-3
            assert np.abs(tick.x - cold.x).max() < near * np.abs(cold.x).max(), i
            assert certificate(session.problem, cold.x, 1e-8, cold.stage_points).ok or is_unsure(cold), i
        q, v = tick.advance()


@pytest.mark.long
def test_a_stage_point_that_is_moved_is_refused() -> None:
    """It is moved by 1e-7 of its motion along its rows: the rounding bound of products is smaller than that."""
    session, given = scene("talos", "torque")
    solver, rng = hqp.solvers.load("lexicographic"), np.random.default_rng(0)
    session.step(session.robot.state(session.robot.home), *given(0))
    problem = session.problem
    answer = solver.solve(problem)
    assert answer.stage_points is not None
    assert problem.motion is not None
    assert certificate(problem, answer.x, 1e-8, answer.stage_points).ok
    assert problem.prices is not None
    stages = [k for k, point in enumerate(answer.stage_points) if np.isfinite(point[0]) and problem.prices[k] > 0.0]
    assert stages
    for k in stages:
        p = answer.stage_points[k]
        above = [np.zeros((0, problem.n))]
        for level in problem.levels[:k]:
            A, value = level.dense(problem.n), level.dense(problem.n) @ p
            above.append(A[(np.abs(value - level.lower) < 1e-6) | (np.abs(value - level.upper) < 1e-6)])
        held = np.concatenate(above)
        Z = np.linalg.svd(held)[2][np.linalg.matrix_rank(held) :].T
        step = Z @ rng.standard_normal(Z.shape[1])
        step *= np.linalg.norm(problem.motion.F @ p) / np.linalg.norm(problem.motion.F @ step)
        moved = np.array(answer.stage_points)
        moved[k] = p + 1e-7 * step
        assert not certificate(problem, answer.x, 1e-8, moved).ok, k


@pytest.mark.parametrize("seed", range(60))
def test_the_reference_stays_within_nearly_opposed_rows(seed: int) -> None:
    """Wedges with a tilt of 1e-11 to 1e-8, and tasks far outside of them."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(3, 4))
    u /= np.linalg.norm(u, axis=1)[:, None]
    C = np.concatenate([u, -u + 10.0 ** rng.uniform(-11, -8) * rng.normal(size=u.shape)])
    upper = np.concatenate([np.zeros(3), np.abs(rng.normal(size=3)) * rng.choice([0.0, 1e-3, 1.0])])
    A, b = rng.normal(size=(3, 4)) * 10.0 ** rng.uniform(-2, 0, (3, 1)), 1e5 * rng.normal(size=3)
    wedge, rest = Rows(C, np.full(6, -np.inf), upper), Rows(np.eye(4), np.zeros(4), np.zeros(4))
    for x in Levels(Hierarchy((wedge, Rows(A, b, b), rest), constraints=1), Limits()).points():
        assert np.max(C @ x - upper) <= 1e-9 * (1.0 + np.abs(x).max())
