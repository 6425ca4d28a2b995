"""People who bend until trunk and thighs meet: a robot whose links stay apart follows their hands."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import Any

import numpy as np
import pytest

from hqp.motion import Retargeted, retarget
from tests.scenes.clips import bend

from .robots import robot as catalogued

OPEN = pytest.mark.xfail(reason="issue 51: hands of G1 are 59 mm off", strict=True)
CASES = [
    ("g1", 2),
    *(pytest.param("g1", seed, marks=pytest.mark.slow) for seed in (1, 3, 11)),
    pytest.param("g1", 7, marks=[pytest.mark.slow, OPEN]),
    *(pytest.param(name, seed, marks=pytest.mark.slow) for name, seed in (("talos", 1), ("talos", 2), ("cbi", 2))),
]  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(("name", "seed"), CASES)
def test_hands_in_a_deep_bend(name: str, seed: int) -> None:
    """Hands within 40 mm of where they are without self-collision, no links that touch, by coal on the shapes of the
    file, feet at rest and on the floor, joints no faster than their limits."""
    robot, motion = catalogued(name), bend(np.random.default_rng(seed))
    free, found = retarget(motion, robot, collision=False), retarget(motion, robot)
    assert found.summary["hand_p99"] < free.summary["hand_p99"] + 0.04
    assert found.summary["slide_share"] < 0.005
    assert found.summary["penetration"] < 2e-3
    assert found.summary["speed"] <= 1.0 + 1e-6
    assert _touching(robot, free), "no clip without contact needs avoidance"
    assert not _touching(robot, found)


def _touching(robot: Any, found: Retargeted) -> set[str]:
    """Links whose shapes touch in a frame, of those that are apart at home, no neighbours, and apart in a third of all
    configurations."""
    contacts, own = robot.contacts(), robot.copy()
    bodies = sorted({capsule.body for capsule in robot.capsules})
    parents = [body[0] for body in robot.bodies]

    def touching(q: Any, pairs: Any) -> set[tuple[int, int]]:
        own.state(q).kinematics()
        return {(i, j) for i, j in pairs if contacts.touch(i, j, own.bodies[i][5], own.bodies[j][5])}

    pairs = {(i, j) for i, j in itertools.combinations(bodies, 2) if i != parents[j] and j != parents[i]}
    pairs -= touching(robot.home, pairs)
    rng = np.random.default_rng(0)
    low, high = (np.where(np.isfinite(x), x, 0.0) for x in (robot.lower, robot.upper))
    met = Counter(pair for _ in range(60) for pair in touching(robot.configuration(rng.uniform(low, high)), pairs))
    pairs -= {pair for pair, times in met.items() if times > 40}
    hit = set().union(*(touching(q, pairs) for q in found.q[::6]))
    return {f"{robot.joint_name(robot.bodies[i][1])} - {robot.joint_name(robot.bodies[j][1])}" for i, j in hit}
