"""LeRobot's kinematics and a Gymnasium environment."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.adapters.lerobot import RobotKinematics
from hqp.tasks import JointLimits, Position, Posture


@pytest.fixture(scope="module")
def arm() -> RobotKinematics:
    return RobotKinematics(hqp.robots.load("ur5"), "tool0")


def test_poses_within_reach_are_found(arm: RobotKinematics) -> None:
    rng = np.random.default_rng(1)
    start = np.array([10.0, -80.0, 90.0, -60.0, -70.0, 20.0])
    for _ in range(20):
        goal = arm.forward_kinematics(start + rng.uniform(-20.0, 20.0, 6))
        found = arm.inverse_kinematics(start, goal)
        for _ in range(3):
            found = arm.inverse_kinematics(found, goal)
        assert np.linalg.norm(arm.forward_kinematics(found)[:3, 3] - goal[:3, 3]) < 1e-3
        assert np.abs(arm.forward_kinematics(found)[:3, :3] - goal[:3, :3]).max() < 1e-2


def test_further_entries_are_handed_through(arm: RobotKinematics) -> None:
    start = np.array([10.0, -80.0, 90.0, -60.0, -70.0, 20.0, 42.0])
    goal = arm.forward_kinematics(start)
    found = arm.inverse_kinematics(start, goal, orientation_weight=0.0)
    assert found == pytest.approx(start, abs=1e-6)


def test_the_signatures_are_lerobots() -> None:
    kinematics = pytest.importorskip("lerobot.model.kinematics", exc_type=ImportError)
    for name in ("forward_kinematics", "inverse_kinematics"):
        theirs = list(inspect.signature(getattr(kinematics.RobotKinematics, name)).parameters)
        assert list(inspect.signature(getattr(RobotKinematics, name)).parameters) == theirs
    theirs = list(inspect.signature(kinematics.RobotKinematics.__init__).parameters)
    assert list(inspect.signature(RobotKinematics.__init__).parameters)[: len(theirs)] == theirs


def test_the_environment_passes_gymnasiums_check() -> None:
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    from hqp.adapters.gym import StackEnv

    hand = Position(frame="tool0", law=P(5.0))
    stack = Stack(Level(hand), Level(Posture(law=P(1.0))), subject_to=[JointLimits()])
    env = StackEnv(stack, hqp.robots.load("ur5"), "tool0", steps=20)
    checker.check_env(env, skip_render_check=True)
    env.reset(seed=3)
    goal = np.clip(env._goal - env._start, -0.3, 0.3)
    for _ in range(60):
        _, _, _, _, info = env.step(goal.astype(np.float32))
    assert info["error"] < 0.02
