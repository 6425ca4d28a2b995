"""Action term of Isaac Lab on a stand-in for its articulation: torch, quaternions w x y z, other joints."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp
import hqp.tasks as t
from hqp import Level, Stack
from hqp.errors import DeclarationError, JointNotFound, ModelError
from hqp.robots import Robot

torch = pytest.importorskip("torch", reason="an environment of make test-environments has it")

WORLDS, DT = 3, 0.01


class Articulation:
    """Joints that reach their targets in each step, in another order, with one that the robot lacks."""

    def __init__(self, robot: Robot, base: tuple[float, ...]) -> None:
        names = list(robot.model.names)[2 if robot.floating else 1 :]
        self.joint_names = ["lamp", *reversed(names)]
        self.pulls: list[Any] = []
        tiled = torch.tensor(base, dtype=torch.float32).repeat(WORLDS, 1)
        zero = torch.zeros(WORLDS, 3)
        joints = torch.zeros(WORLDS, len(self.joint_names))
        self.data = SimpleNamespace(
            joint_pos=joints, joint_vel=joints.clone(), root_pos_w=tiled[:, :3], root_quat_w=tiled[:, 3:],
            root_lin_vel_w=zero, root_ang_vel_w=zero,
        )  # fmt: skip

    def find_joints(self, names: list[str], preserve_order: bool = False) -> tuple[list[int], list[str]]:
        assert preserve_order
        return [self.joint_names.index(name) for name in names], names

    def set_joint_position_target(self, target: Any, joint_ids: list[int]) -> None:
        self.data.joint_pos[:, joint_ids] = target

    def set_joint_velocity_target(self, target: Any, joint_ids: list[int]) -> None:
        self.data.joint_vel[:, joint_ids] = target

    def set_joint_effort_target(self, target: Any, joint_ids: list[int]) -> None:
        self.pulls.append(target)


def world(robot: Robot, base: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), dt: float = DT) -> Any:
    asset = Articulation(robot, base)
    joints = robot.home[7 if robot.floating else 0 :]
    asset.data.joint_pos[:, 1:] = torch.tensor(joints[::-1].copy(), dtype=torch.float32)
    scene = type("Scene", (dict,), {"env_origins": torch.tensor([[10.0 * k, 0.0, 0.0] for k in range(WORLDS)])})
    asset.data.root_pos_w = asset.data.root_pos_w + scene.env_origins  # type: ignore[attr-defined]
    sim = SimpleNamespace(get_physics_dt=lambda: dt)
    return SimpleNamespace(scene=scene(robot=asset), num_envs=WORLDS, device="cpu", sim=sim)


def plan(path: Path, name: str, formulation: Any, element: Any, floating: bool | None = None) -> Robot:
    robot = hqp.robots.load(name) if floating is None else hqp.robots.load(name, floating=floating)
    stack = Stack(Level(element), Level(t.Posture()), subject_to=[] if robot.floating else [t.JointLimits()])
    hqp.Controller(stack, formulation).session(robot, DT).export(path)
    return robot


def term(path: Path, env: Any, **options: Any) -> Any:
    from hqp.adapters.isaaclab import DifferentialIKAction, DifferentialIKActionCfg

    return DifferentialIKAction(
        DifferentialIKActionCfg(plan=str(path), targets=("hand",), **{"robot": "panda", **options}), env
    )


@pytest.mark.parametrize("formulation", [hqp.Velocity(), hqp.Acceleration()])
def test_hands_arrive_at_their_offsets(tmp_path: Path, formulation: Any) -> None:
    hand = t.Position(frame="panda_hand", name="hand")
    robot = plan(tmp_path / "panda.hqp", "panda", formulation, hand)
    env = world(robot)
    action = term(tmp_path / "panda.hqp", env, scale=0.1)
    assert action.action_dim == 3
    given = torch.tensor([[0.3, 0.0, 0.2], [0.0, 0.3, -0.2], [-0.2, 0.1, 0.0]])
    began = robot.state(robot.home).position("panda_hand")

    def hands() -> Any:
        joints = env.scene["robot"].data.joint_pos[:, 1:].numpy().astype(float)[:, ::-1]
        return np.array([robot.state(q).position("panda_hand") for q in joints])

    for _ in range(150):
        action.process_actions(given)
        action.apply_actions()
        assert (action.status <= 1).all()
    np.testing.assert_allclose(hands() - began, 0.1 * given.numpy(), atol=1e-3)
    action.reset(torch.tensor([1]))
    for _ in range(150):  # this world holds its hand in place, the others at their targets
        action.process_actions(torch.where(torch.tensor([[True], [False], [True]]), given, torch.zeros(3, 3)))
        action.apply_actions()
    np.testing.assert_allclose(hands() - began, 0.1 * given.numpy(), atol=1e-3)


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_a_turned_base_is_seen_in_the_order_of_its_quaternion(tmp_path: Path, order: Any) -> None:
    """The command of a floating arm equals that of the session at this state."""
    hand = t.Position(frame="panda_hand", name="hand")
    robot = plan(tmp_path / "free.hqp", "panda", hqp.Velocity(), hand, floating=True)
    half = math.radians(40.0)
    xyzw = (0.0, math.sin(half), 0.0, math.cos(half))
    env = world(robot, (0.3, 0.2, 0.5, *(xyzw if order == "xyzw" else (xyzw[3], *xyzw[:3]))))
    action = term(tmp_path / "free.hqp", env, quaternion=order)
    action.process_actions(torch.full((WORLDS, 3), 0.05))
    action.apply_actions()
    q = robot.home.copy()
    q[:7] = 0.3, 0.2, 0.5, *xyzw
    session = hqp.load(tmp_path / "free.hqp")
    goal = robot.state(q).position("panda_hand") + 0.05
    expected = session.step(q, targets={"hand": goal}).command
    asset = env.scene["robot"]
    rates = asset.data.joint_vel.numpy()[:, asset.find_joints(list(session.joint_names), True)[0]]
    np.testing.assert_allclose(rates, np.tile(expected, (WORLDS, 1)), atol=1e-4)


def test_what_cannot_be_meant_is_refused(tmp_path: Path) -> None:
    robot = plan(tmp_path / "arm.hqp", "panda", hqp.Velocity(), t.Position(frame="panda_hand", name="hand"))
    with pytest.raises(DeclarationError, match="period of the simulation"):
        term(tmp_path / "arm.hqp", world(robot, dt=0.005))
    env = world(robot)
    env.scene["robot"].joint_names[1] = "other"
    with pytest.raises(JointNotFound):
        term(tmp_path / "arm.hqp", env)
    with pytest.raises(ModelError, match="give the robot"):
        term(tmp_path / "arm.hqp", world(robot), robot="")
    plan(tmp_path / "pose.hqp", "panda", hqp.Velocity(), t.Pose(frame="panda_hand", name="hand"))
    with pytest.raises(DeclarationError, match="is a matrix"):
        term(tmp_path / "pose.hqp", world(robot))
