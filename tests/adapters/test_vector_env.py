"""Many Gymnasium environments over a Batch: G1 stands in MuJoCo while an agent moves its hands."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import PD, Level, Stack
from hqp.errors import DeclarationError
from hqp.solvers.lexicographic import kernel

pytest.importorskip("gymnasium")
pytest.importorskip("mujoco")
pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")


def controller() -> tuple[hqp.Controller, hqp.robots.Robot]:
    robot = hqp.robots.load("g1")
    soles, palms = robot.landmarks["soles"], robot.landmarks["palms"]
    stack = Stack(
        Level(t.Com(axes="xy", name="balance", law=PD(50.0, 14.0))),
        Level(*(t.Position(frame=palm, name=f"hand{k}", law=PD(80.0, 18.0)) for k, palm in enumerate(palms))),
        Level(t.Posture(law=PD(40.0, 12.0))),
        subject_to=[
            *(t.FixedContact(frame=sole, law=PD(0.0, 40.0)) for sole in soles),
            *(t.FrictionCone(contact=sole, mu=0.6) for sole in soles),
            *(t.UnilateralContact(contact=sole) for sole in soles),
            t.TorqueLimits(),
        ],
    )
    return hqp.Controller(stack, hqp.Torque()), robot


def run(threads: int) -> tuple[np.ndarray, list[np.ndarray]]:
    from hqp.adapters.gym import VectorEnv

    env = VectorEnv(*controller(), ("hand0", "hand1"), 4, steps=12, threads=threads)
    first, _ = env.reset(seed=3)
    assert env.observation_space.contains(first)
    ends = []
    action = np.full((4, 6), 0.02, dtype=np.float32)
    for _ in range(20):
        obs, _, terminated, truncated, info = env.step(action)
        assert not terminated.any()
        assert (info["status"] <= 1).all()
        ends.append(truncated)
    env.close()
    return obs, ends


@pytest.mark.long
def test_worlds_stand_end_and_begin_anew_whatever_the_threads() -> None:
    (obs, ends), (other, _) = run(1), run(2)
    np.testing.assert_array_equal(obs, other)
    assert [int(end.sum()) for end in ends] == [4 * (i == 11) for i in range(20)]
    assert np.abs(obs[:, 2] - 0.78).max() < 0.01


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()])
@pytest.mark.parametrize(("name", "frame", "far"), [("panda", "panda_hand", 5e-3), ("cbi", "r_palm", 2e-2)])
def test_servos_carry_out_velocities_and_accelerations(
    name: str, frame: str, far: float, formulation: hqp.Velocity
) -> None:
    """MuJoCo's hands reach the places of the action, up to the sag of the servos: an arm, and CBi on its feet."""
    from hqp.adapters.gym import VectorEnv
    from hqp.robots import Servo

    robot = hqp.robots.load(name)
    feet = [t.FixedContact(frame=sole) for sole in robot.landmarks.get("soles", ())]
    levels = [t.Com(axes="xy", name="balance")] if feet else []
    stack = Stack(
        *map(Level, (*levels, t.Position(frame=frame, name="hand"), t.Posture())), subject_to=[*feet, t.JointLimits()]
    )
    servo = None if feet else Servo(other=4000.0)
    spread = 0.0 if feet else 0.05
    env = VectorEnv(hqp.Controller(stack, formulation), robot, ("hand",), 2, steps=200, spread=spread, servo=servo)
    env.reset(seed=1)
    action = np.array([[0.03, 0.0, 0.02], [0.0, 0.03, -0.02]], dtype=np.float32)
    began = robot.state(robot.home).position(frame)
    for _ in range(80):
        obs, _, ended, _, info = env.step(action)
        assert not ended.any()
    env.close()
    assert (info["status"] <= 1).all()
    for world, offset in zip(obs.astype(float), action, strict=True):
        place = robot.state(world[: robot.nq]).position(frame)
        assert np.linalg.norm(place - began - offset) < far


def test_targets_that_are_no_vectors_are_refused() -> None:
    from hqp.adapters.gym import VectorEnv

    robot = hqp.robots.load("ur5")
    hand = t.Pose(frame="tool0", name="hand")
    with pytest.raises(DeclarationError, match="not a vector"):
        VectorEnv(hqp.Controller(Stack(Level(hand))), robot, ("hand",), 2)
