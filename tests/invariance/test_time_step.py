"""A loop at half the period carries out nearly the same motion: first order in dt."""

from __future__ import annotations

import numpy as np
import pytest

from tests.invariance.scenes import KINDS, Scene, catalogue

SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 12))]


def end(scene: Scene) -> np.ndarray:
    return scene.run().last


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_halving_the_period_halves_the_error(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    scene = catalogue(rng, kind, ticks=25, dt=0.008)
    robot = scene.robot
    ends = [end(scene.but(dt=scene.dt / n, ticks=scene.ticks * n)) for n in (1, 2, 4, 8)]
    steps = [float(np.abs(robot.difference(a, b)).max()) for a, b in zip(ends, ends[1:], strict=False)]
    moved = float(np.abs(robot.difference(scene.first, ends[-1])).max())
    assert steps[-1] < 0.6 * steps[0] + 1e-9, (robot.name, scene.reach, steps)
    assert steps[-1] < 0.1 * moved, (robot.name, scene.reach, steps, moved)
