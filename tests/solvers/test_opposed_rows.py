"""Two feet at the edges of their friction cones: what no level determines is one answer, whatever was solved before."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp import Status, certificate
from tests.scenes.stacks import scene


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_torques_that_no_level_determines_are_one_answer(name: str) -> None:
    """The soles are turned against each other by 1e-10 to 1e-6 rad, so that rows of their cones are nearly opposed."""
    session, given = scene(name, "torque")
    robot, solver = session.robot, hqp.solvers.load("lexicographic")
    q, v = robot.home.copy(), np.zeros(robot.nv)
    for i in range(34):
        tick = session.step(robot.state(q, v), *given(i))
        assert tick.status.solved, (i, tick.detail)
        if i % 3 != 0:  # two of three, so that it takes half the time
            cold = solver.solve(session.problem)
            assert np.abs(tick.x - cold.x).max() < 1e-4 * np.abs(cold.x).max(), i
            assert certificate(session.problem, cold.x, 1e-8, cold.stage_points).ok, i
        q, v = tick.advance()


def test_an_answer_without_prices_that_is_sure_passes_the_certificate() -> None:
    """Forces of rounding, 1e-12 to 1e-9, held rows of the cones, and so torques twice as large as the least."""
    session, given = scene("talos", "torque", 0.0)
    robot, sure = session.robot, 0
    q, v = robot.home.copy(), np.zeros(robot.nv)
    for i in range(42):
        tick = session.step(robot.state(q, v), *given(i))
        if tick.status is Status.OPTIMAL and i >= 30:
            assert certificate(session.problem, tick.x, 1e-8).ok, i
            sure += 1
        q, v = tick.advance()
    assert sure >= 8
