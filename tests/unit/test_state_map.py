"""States of other programs: bodies move alike for every order and all axes of the program."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
from hqp import StateMap
from hqp.errors import DeclarationError, JointNotFound

WORLDS = 5


def turned(quaternions: Any, vectors: Any) -> Any:
    """Vectors of the base in the world, by Pinocchio."""
    pin = pytest.importorskip("pinocchio")
    return np.array([pin.Quaternion(np.array(q)).matrix() @ v for q, v in zip(quaternions, vectors, strict=True)])


@pytest.mark.parametrize("quaternion", ["xyzw", "wxyz"])
@pytest.mark.parametrize(("linear", "angular"), [("base", "base"), ("world", "base"), ("world", "world")])
def test_every_convention_gives_one_state(quaternion: Any, linear: Any, angular: Any) -> None:
    robot = hqp.robots.load("g1")
    rng = np.random.default_rng(0)
    Q = np.array([robot.integrate(robot.home, rng.normal(size=robot.nv), 1.0) for _ in range(WORLDS)])
    V = rng.normal(size=(WORLDS, robot.nv))
    order = rng.permutation(len(robot.joint_names) + 1)
    names = [("lamp", *robot.joint_names)[k] for k in order]
    columns = np.asarray(robot.actuated)
    joints, rates = (
        np.concatenate((np.full((WORLDS, 1), np.nan), given), axis=1)[:, order] for given in (Q[:, 7:], V[:, columns])
    )
    there = StateMap(robot, names, quaternion=quaternion, linear=linear, angular=angular)
    twist = {
        name: turned(Q[:, 3:7], V[:, 3 * k : 3 * k + 3]) if axes == "world" else V[:, 3 * k : 3 * k + 3]
        for k, (name, axes) in enumerate((("linear", linear), ("angular", angular)))
    }
    read = Q[:, [6, 3, 4, 5] if quaternion == "wxyz" else [3, 4, 5, 6]]
    q, v = there.state(joints, rates, place=Q[:, :3], quaternion=read, **twist)
    np.testing.assert_array_equal(q, Q)
    np.testing.assert_allclose(v, V, atol=1e-12)
    alone = there.state(joints[2], rates[2], place=Q[2, :3], quaternion=read[2], **{k: w[2] for k, w in twist.items()})
    np.testing.assert_array_equal(alone[0], q[2])
    np.testing.assert_allclose(alone[1], v[2], atol=1e-12)
    sent = there.command(V[:, columns], others=7.0)
    np.testing.assert_array_equal(sent[:, names.index("lamp")], 7.0)
    np.testing.assert_array_equal(np.delete(sent, names.index("lamp"), 1), np.delete(rates, names.index("lamp"), 1))


def test_a_simulator_moves_as_the_robot_does() -> None:
    """Positions and velocities of frames by MuJoCo, from its own state."""
    mujoco = pytest.importorskip("mujoco")
    robot = hqp.robots.load("cbi")
    plant = hqp.robots.Plant(robot)
    model, data = plant.model, plant.data
    rng = np.random.default_rng(1)
    names = [model.joint(k).name for k in range(model.njnt) if model.jnt_type[k] != mujoco.mjtJoint.mjJNT_FREE]
    there = StateMap(robot, names, quaternion="wxyz", linear="world", angular="base")
    data.qpos[7:], data.qvel[:] = rng.uniform(-0.5, 0.5, model.nq - 7), rng.normal(size=model.nv)
    data.qpos[3:7] = (lambda q: q / np.linalg.norm(q))(rng.normal(size=4))
    mujoco.mj_forward(model, data)
    q, v = there.state(
        data.qpos[7:], data.qvel[6:],
        place=data.qpos[:3], quaternion=data.qpos[3:7], linear=data.qvel[:3], angular=data.qvel[3:6],
    )  # fmt: skip
    for frame in ("r_palm", "l_sole"):
        here, soon = (robot.state(robot.integrate(q, v, t)).position(frame).copy() for t in (0.0, 1e-6))
        np.testing.assert_allclose(here, plant.place(frame)[0], atol=1e-9)
        np.testing.assert_allclose((soon - here) / 1e-6, plant.velocity(frame)[:3], atol=1e-4)


def test_what_does_not_fit_is_refused() -> None:
    robot = hqp.robots.load("ur5")
    names = list(robot.joint_names)
    with pytest.raises(JointNotFound):
        StateMap(robot, names[1:])
    with pytest.raises(DeclarationError, match="twice"):
        StateMap(robot, [*names, names[0]])
    with pytest.raises(DeclarationError, match="quaternion"):
        StateMap(robot, names, quaternion="zyxw")  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match="shape of positions"):
        StateMap(robot, names).state(np.zeros(5))
    free = hqp.robots.load("g1")
    with pytest.raises(DeclarationError, match="needs place and quaternion"):
        StateMap(free, free.joint_names).state(np.zeros(len(free.joint_names)))
