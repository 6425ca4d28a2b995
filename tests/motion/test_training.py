"""Reference motions for training: MuJoCo has the same bodies and velocities, and the trackers' loader reads them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hqp.arrays import Mat
from hqp.errors import DeclarationError, FrameNotFound, JointNotFound
from hqp.motion import save_training, training_arrays
from hqp.robots import Plant, Robot

from .robots import robot as catalogued


@dataclass
class Drawn:
    """Random configurations and velocities."""

    q: Mat
    v: Mat
    fps: float = 50.0


def drawn(robot: Robot, frames: int, seed: int) -> Drawn:
    rng = np.random.default_rng(seed)
    q = [robot.random_configuration(rng) for _ in range(frames)]
    return Drawn(np.array(q), rng.normal(size=(frames, robot.nv)))


@pytest.mark.long
@pytest.mark.parametrize("name", ["g1", "talos", "cbi"])
def test_bodies_and_joints_are_those_of_mujoco(name: str) -> None:
    """Bodies and joints in a random order."""
    robot = catalogued(name)
    plant = Plant(robot)
    model, data = plant.model, plant.data
    rng = np.random.default_rng(3)
    links = [model.body(b).name for b in range(1, model.nbody) if model.body(b).name in robot.frame_names]
    links = [links[0], *rng.permutation(links[1:])]
    joints = [str(joint) for joint in rng.permutation(robot.joint_names)]
    motion = drawn(robot, 4, 5)
    found = training_arrays(robot, motion, joints=joints, bodies=links)
    for k, (q, v) in enumerate(zip(motion.q, motion.v, strict=True)):
        data.qpos[:], data.qvel[:] = plant.map.to_mujoco(q, v)
        mujoco.mj_forward(model, data)
        for j, joint in enumerate(joints):
            assert found["joint_pos"][k, j] == pytest.approx(data.joint(joint).qpos[0], abs=1e-12)
            assert found["joint_vel"][k, j] == pytest.approx(data.joint(joint).qvel[0], abs=1e-12)
        for b, link in enumerate(links):
            body, twist = model.body(link).id, np.empty(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, twist, 0)
            np.testing.assert_allclose(found["body_pos_w"][k, b], data.xpos[body], atol=1e-6)
            assert abs(found["body_quat_w"][k, b] @ data.xquat[body]) == pytest.approx(1.0, abs=1e-9)
            np.testing.assert_allclose(found["body_ang_vel_w"][k, b], twist[:3], atol=1e-6)
            np.testing.assert_allclose(found["body_lin_vel_w"][k, b], twist[3:], atol=1e-5)


def test_quaternions_keep_their_sign_over_full_turns() -> None:
    robot = catalogued("g1")
    turns = np.linspace(0.0, 4.0 * np.pi, 200)
    q = np.tile(robot.home, (200, 1))
    q[:, 3:7] = np.column_stack([0.0 * turns, 0.0 * turns, np.sin(turns / 2.0), np.cos(turns / 2.0)])
    motion = Drawn(q, np.zeros((200, robot.nv)))
    quaternions = training_arrays(robot, motion)["body_quat_w"]
    assert (quaternions[0, :, 0] >= 0.0).all()
    assert np.abs(np.diff(quaternions, axis=0)).max() < 0.05


@pytest.mark.long
def test_a_walk_is_written_and_read_as_the_trackers_do(tmp_path: Path) -> None:
    from hqp.walking import Walker

    robot = catalogued("g1")
    walker = Walker(robot, dt=0.002)
    walker.go(0.2)
    walk = walker.plan(1.0, fps=50.0)
    data = np.load(save_training(tmp_path / "walk.npz", robot, walk))
    assert float(data["fps"][0]) == 50.0
    frames, bodies = data["body_pos_w"].shape[:2]
    assert frames == len(walk.q) == len(data["joint_pos"])
    assert data["body_names"][0] == "pelvis"
    moved = np.diff(data["body_pos_w"], axis=0) * 50.0
    means = 0.5 * (data["body_lin_vel_w"][1:] + data["body_lin_vel_w"][:-1])
    assert np.abs(moved - means)[data["body_lin_vel_w"].shape[0] // 4 :].mean() < 0.02, "velocities of other bodies"
    assert bodies == len(data["body_names"])


def test_errors_name_the_cause(tmp_path: Path) -> None:
    robot = catalogued("g1")
    motion = drawn(robot, 2, 0)
    with pytest.raises(JointNotFound, match="left_knee_joint"):
        training_arrays(robot, motion, joints=["left_knee_jiont"])
    with pytest.raises(FrameNotFound, match="pelvis"):
        training_arrays(robot, motion, bodies=["pelvsi"])
    with pytest.raises(DeclarationError, match="another robot"):
        training_arrays(catalogued("ur5"), motion)
    with pytest.raises(DeclarationError, match="not finite"):
        training_arrays(robot, Drawn(motion.q, motion.v * np.nan))
    with pytest.raises(DeclarationError, match=r"ends in \.npz"):
        save_training(tmp_path / "walk.csv", robot, motion)
