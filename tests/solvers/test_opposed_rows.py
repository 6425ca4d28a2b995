"""Two feet at the edges of their friction cones: what no level determines is one answer, whatever was solved before."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp import Status, certificate
from tests.scenes.priced import is_unsure
from tests.scenes.stacks import scene


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_torques_that_no_level_determines_are_one_answer(name: str) -> None:
    """The soles are turned against each other by 1e-10 to 1e-6 rad, so that rows of their cones are nearly opposed.

    What is sure is one answer, and more than a quarter is sure.
    """
    session, given = scene(name, "torque")
    robot, solver = session.robot, hqp.solvers.load("lexicographic")
    q, v, sure, refused = robot.home.copy(), np.zeros(robot.nv), 0, 0
    for i in range(34):
        tick = session.step(robot.state(q, v), *given(i))
        assert tick.status.solved, (i, tick.detail)
        if i % 3 != 0:  # two of three, so that it takes half the time
            cold = solver.solve(session.problem)
            refused += not cold.status.solved
            if cold.status.solved:
                tolerance = 1e-6 if is_unsure(cold) else 1e-8
                assert certificate(session.problem, cold.x, tolerance, cold.stage_points).ok, i
            if tick.status is cold.status is Status.OPTIMAL:
                sure += 1
                assert np.abs(tick.x - cold.x).max() < 1e-4 * np.abs(cold.x).max(), i
        q, v = tick.advance()
    assert refused <= 1
    assert sure >= 6  # of 22
