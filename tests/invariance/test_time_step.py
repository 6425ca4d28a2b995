"""A loop at half the period executes nearly the same motion: first order in dt."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.invariance.scenes import KINDS, catalogue

SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 12))]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_halving_the_period_halves_the_error(kind: str, seed: int) -> None:
    """At velocity level within reach only: the acceleration window holds a step of one period, so that a level cut by
    it depends on the period."""
    scene = catalogue(np.random.default_rng([seed, KINDS.index(kind)]), kind, ticks=100, dt=0.008)
    if kind == "velocity":
        scene = scene.but(reach=0.05)
    robot = scene.robot
    ends = [scene.but(dt=scene.dt / n, ticks=scene.ticks * n).run().last for n in (1, 2, 4)]
    first, second = (float(np.abs(robot.difference(a, b)).max()) for a, b in itertools.pairwise(ends))
    assert second < 0.6 * first, (robot.name, scene.reach, first, second)
