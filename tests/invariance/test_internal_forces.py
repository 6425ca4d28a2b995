"""Feet at the edges of their friction cones: torques that no level determines are one command for one problem, for any
earlier solve, storage of the constraints, and noise of 1e-12 in every row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.random import Generator

import hqp
from hqp import Hierarchy, Rows, Status
from tests.scenes.noise import noisy
from tests.scenes.stacks import scene

LIPSCHITZ = 1e-6
"""Largest change of a command, of the largest torque."""

ROBOTS = [(name, price) for name in ("talos", "g1", "cbi") for price in (None, 0.0)]


@cache
def problems(name: str, price: float | None) -> list[Hierarchy]:
    """Every second problem of a loop whose hand is out of reach."""
    session, given = scene(name, "torque", price)
    q, v, found = session.robot.home.copy(), np.zeros(session.robot.nv), []
    for i in range(48):
        tick = session.step(session.robot.state(q, v), *given(i))
        if i % 2:
            found.append(session.problem.copy())
        q, v = tick.advance()
    return found


def stored_otherwise(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Rows of the constraints dense, in another order, scaled and some of them negated."""
    levels = list(problem.levels)
    for k, rows in enumerate(levels[: problem.constraints]):
        order = rng.permutation(rows.m)
        factor = 10.0 ** rng.uniform(-1.0, 1.0, size=rows.m) * rng.choice([-1.0, 1.0], size=rows.m)
        ends = np.sort([factor * rows.lower[order], factor * rows.upper[order]], axis=0)
        levels[k] = Rows(factor[:, None] * rows.dense(problem.n)[order], *ends)
    return replace(problem, levels=tuple(levels), stacked=None)


@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(5))])
@pytest.mark.parametrize("change", [None, noisy, stored_otherwise], ids=["start", "noise", "storage"])
@pytest.mark.parametrize(("name", "price"), ROBOTS)
def test_the_command_stays(
    name: str, price: float | None, change: Callable[[Hierarchy, Generator], Hierarchy] | None, seed: int
) -> None:
    """Some point meets the constraints of all these problems."""
    rng, solver, compared = np.random.default_rng(seed), hqp.solvers.load("lexicographic"), 0
    cases = problems(name, price)
    warm = solver.workspace(cases[0].shape)
    other = warm if change is None else solver.workspace(change(cases[0], rng).shape)
    for workspace in (warm, other):
        workspace.limit(np.inf)  # type: ignore[attr-defined]  # as a session does
    for i, problem in enumerate(cases):
        x = warm.solve(problem)
        y = solver.solve(problem) if change is None else other.solve(change(problem, rng))
        assert Status.CONSTRAINTS_VIOLATED not in (x.status, y.status), i
        if x.status is y.status is Status.OPTIMAL:
            compared += 1
            assert np.abs(x.x - y.x).max() < LIPSCHITZ * np.abs(x.x).max(), (i, x.status, y.status)
    assert compared >= 3
