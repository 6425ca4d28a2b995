"""Normals of the ground below soles that have rolled over an edge."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp.robots
from hqp.walking import Walker


@pytest.mark.parametrize("name", ["g1", "talos"])
@pytest.mark.parametrize("seed", range(4))
def test_the_weight_stays_inside_the_cone_of_any_foot(name: str, seed: int) -> None:
    """Soles tilted any way: the normal is theirs on ground that a walker can climb, no steeper beyond."""
    rng = np.random.default_rng(seed)
    mu = float(rng.uniform(0.2, 0.8))
    robot = hqp.robots.load(name)
    walker = Walker(robot, friction=mu, deadline=math.inf)
    for _ in range(20):
        q, v = walker.start.copy(), np.zeros(robot.nv)
        q[3:7] += rng.uniform(-0.25, 0.25, 4)
        q[3:7] /= np.linalg.norm(q[3:7])
        state = walker.step(robot.state(q, v)).state
        for foot, normal in zip(walker.feet, walker._native.normals, strict=True):
            up = state.rotation(foot.frame)[:, 2]
            tilt, found = (math.atan2(math.hypot(n[0], n[1]), n[2]) for n in (up, normal))
            assert found == pytest.approx(min(tilt, 0.5 * math.atan(mu)), abs=1e-9)
            np.testing.assert_allclose(np.cross([*normal[:2], 0.0], [*up[:2], 0.0]), 0.0, atol=1e-9)
            assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)
