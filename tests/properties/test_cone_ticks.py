"""Ticks of closed loops against cone programs: no answer has a higher stage cost than the optimum."""

from __future__ import annotations

from itertools import cycle, product

import numpy as np
import pytest

from hqp.arrays import Mat
from tests.scenes.calm.ticks import FORMULATIONS, PLACES, ROBOTS, Answered, drawn
from tests.solvers.cones import Oracle

pytest.importorskip("clarabel")

COUNT, TICKS = 18, 2000
"""Number of ticks of each robot and formulation in one scene, drawn from the first TICKS."""


def points(tick: Answered) -> Mat:
    """Points that the levels hand down: stage points, or x for levels without one above the stages and for the last."""
    problem, solution = tick.problem, tick.solution
    found = np.full((len(problem.levels), problem.n), np.nan)
    if solution.stage_points is not None:
        found[:] = solution.stage_points
    staged = np.flatnonzero(np.isfinite(found[:, 0]))
    first = staged[0] if staged.size else len(found)
    for k, priced in enumerate(problem.priced):
        if not priced and (k < first or k == len(found) - 1):
            found[k] = solution.x
    return found


@pytest.mark.slow
def test_no_answer_of_a_loop_is_worse_than_the_cone_programs() -> None:
    rng, places = np.random.default_rng(0), cycle(PLACES)
    judged = staged = 0
    for robot, formulation in product(ROBOTS, FORMULATIONS):
        for tick in drawn(rng, robot, formulation, next(places), COUNT, TICKS):
            oracle = Oracle(tick.problem).solve(points(tick))
            if oracle.doubtful:
                continue
            assert oracle.worse <= 1e-6, tick.name
            judged += 1
            staged += tick.solution.stage_points is not None
    assert judged > 120
    assert staged > 60
