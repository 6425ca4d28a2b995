"""A batch of walkers under an agent: MuJoCo's worlds follow the actions, with equal numbers on any threads."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from hqp.errors import DeclarationError
from hqp.solvers.lexicographic import kernel

pytest.importorskip("gymnasium")
pytest.importorskip("mujoco")
pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")

ACTIONS = np.array([[0.2, 0.0, 0.0], [0.0, 0.0, 0.0], [-0.1, 0.0, 0.2]], dtype=np.float32)


def run(threads: int, steps: int, episode: int = 1000) -> tuple[np.ndarray, list[np.ndarray]]:
    from hqp.adapters.gym import WalkersEnv
    from hqp.walking import Walker

    robot = hqp.robots.load("g1", rotors=True)
    env = WalkersEnv(Walker(robot, dt=0.002), 3, frame_skip=25, steps=episode, threads=threads)
    first, _ = env.reset(seed=0)
    assert env.observation_space.contains(first)
    ends = []
    for _ in range(steps):
        obs, _, fallen, late, _ = env.step(ACTIONS)
        assert not fallen.any()
        ends.append(late)
    env.close()
    return obs, ends


@pytest.mark.slow
def test_walkers_go_where_the_actions_say() -> None:
    obs, _ = run(0, 120)  # 6 s
    ahead, still, back = obs[:, 0]
    assert 0.6 < ahead < 1.4
    assert abs(still) < 0.06  # the weight shifts over the soles
    assert back < -0.2
    turned = 2.0 * np.arctan2(obs[2, 5], obs[2, 6])
    assert turned > 0.6


@pytest.mark.long
def test_episodes_end_and_threads_do_not_matter() -> None:
    (obs, ends), (other, _) = run(1, 12, 8), run(2, 12, 8)
    np.testing.assert_array_equal(obs, other)
    assert [int(end.sum()) for end in ends] == [3 * (i == 7) for i in range(12)]


def test_errors_name_the_class() -> None:
    from hqp.adapters.gym import WalkersEnv
    from hqp.walking import Walker

    walker = Walker(hqp.robots.load("g1", rotors=True), dt=0.002)
    with pytest.raises(DeclarationError, match="WalkersEnv: bad frame_skip"):
        WalkersEnv(walker, 2, frame_skip=0)
    with pytest.raises(DeclarationError, match="Walkers"):
        WalkersEnv(walker, 0)
