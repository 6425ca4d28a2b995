"""Couplings of a file as any linear system: joints that several equalities name, chains, loops, repeated ones."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import hqp


def drawn(rng: np.random.Generator, path: Path) -> None:
    """A chain of hinges with equalities of drawn pairs of joints, the same pair and the same joint more than once."""
    joints = int(rng.integers(3, 8))
    bodies = "".join(f'<body pos="0 0 .1"><joint name="j{i}"/><geom size=".02" mass="1"/>' for i in range(joints))
    pairs = [rng.choice(joints, 2, replace=False) for _ in range(int(rng.integers(1, joints + 2)))]
    equalities = "".join(
        f'<joint joint1="j{a}" joint2="j{b}" polycoef="{rng.uniform(-0.2, 0.2):.3f} {rng.uniform(-2, 2):.3f} 0 0 0"/>'
        for a, b in pairs
    )
    path.write_text(
        f"<mujoco><worldbody>{bodies}{'</body>' * joints}</worldbody><equality>{equalities}</equality></mujoco>"
    )


@pytest.mark.parametrize("seed", range(20))
def test_home_satisfies_every_coupling(seed: int, tmp_path: Path) -> None:
    """Couplings that are kept are independent, home meets them all, and a session takes them."""
    drawn(np.random.default_rng(seed), path := tmp_path / "chain.xml")
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        robot = hqp.robots.load(path)
    state = robot.state(robot.home)
    rows = np.array([coupling.jacobian(state)[0] for coupling in robot.couplings])
    assert np.linalg.matrix_rank(rows) == len(robot.couplings) <= robot.nv
    for coupling in robot.couplings:
        np.testing.assert_allclose(coupling.error(state, coupling.hold(state).value), 0.0, atol=1e-9)
    ignored = [w for w in warned if "equalities before it determine" in str(w.message)]
    assert len(robot.couplings) + len(ignored) <= path.read_text().count("polycoef")
    posture = hqp.tasks.Posture()
    session = hqp.Controller(hqp.Stack(hqp.Level(posture)), hqp.Velocity()).session(robot, 0.002, stuck=False)
    q, v = robot.home, np.zeros(robot.nv)
    for _ in range(20):
        tick = session.step(robot.state(q, v), posture.at(np.full(robot.nv, 0.4)))
        assert tick.status.usable
        q, v = tick.advance()
    state = robot.state(q, v)
    for coupling in robot.couplings:
        np.testing.assert_allclose(coupling.error(state, coupling.hold(state).value), 0.0, atol=1e-6)
