"""Reversals of a walk's torques."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.walking.course import Turns


@pytest.mark.parametrize("seed", range(4))
def test_reversals_are_those_of_the_largest_swings(seed: int) -> None:
    """Zigzags with swings above the least, and noise below half of it: each corner counts once."""
    rng = np.random.default_rng(seed)
    least = rng.uniform(0.5, 2.0, 3)
    corners = rng.integers(2, 20, 3)
    counted = Turns(least)
    ways = [np.cumsum(np.tile([1.0, -1.0], 10)[: n + 1] * rng.uniform(2.0, 5.0, n + 1)) for n in corners]
    paths = [
        np.interp(np.linspace(0.0, n + 1, 500), np.arange(n + 2), [0.0, *way])
        for n, way in zip(corners, ways, strict=True)
    ]
    for k in range(500):
        counted.take(np.array([path[k] for path in paths]) * least + rng.uniform(-0.2, 0.2, 3) * least)
    np.testing.assert_array_equal(counted.count, corners)


def test_a_constant_signal_with_small_noise_never_reverses() -> None:
    rng, counted = np.random.default_rng(0), Turns(np.array([1.0, 1.0]))
    for _ in range(1000):
        counted.take(rng.uniform(-0.49, 0.49, 2) + [0.0, 5.0])
    assert not counted.count.any()
