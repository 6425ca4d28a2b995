"""RobotKinematics over drawn arms: unnamed joints rest, limits without jumps, nearest turns, degrees and order."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.adapters.lerobot import RETURN, RobotKinematics
from hqp.errors import DeclarationError
from hqp.tasks import JointLimits, Posture

LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/>'
    "</inertial></link>"
)
SEEDS = range(6)


class Drawn:
    """A chain of joints of drawn kinds and axes, some not named in the call, and a gripper of two coupled jaws."""

    def __init__(self, seed: int, folder: Path, kinds: Any = ("revolute", "prismatic", "continuous")) -> None:
        rng = np.random.default_rng(seed)
        count = int(rng.integers(5, 8))
        self.kinds = ["revolute", *rng.choice(kinds, count - 1)]
        text, self.range = "", []
        for k, kind in enumerate(self.kinds):
            axis = np.eye(3)[k % 3] + 0.2 * rng.normal(size=3)
            low, high = (-rng.uniform(0.1, 0.2), rng.uniform(0.1, 0.3)) if kind == "prismatic" else (-2.0, 2.4)
            self.range.append((low, high) if kind != "continuous" else (-math.pi, math.pi))
            ends = "" if kind == "continuous" else f'lower="{low}" upper="{high}" '
            text += self.joint(f"j{k}", kind, f"l{k}", f"l{k + 1}", axis, f'<limit {ends}velocity="3" effort="9"/>')
        limit = '<limit lower="0" upper=".04" velocity="1" effort="9"/>'
        text += self.joint("jaw", "prismatic", f"l{count}", "left", np.eye(3)[1], limit)
        follow = '<mimic joint="jaw" multiplier="-1" offset=".001"/>'
        text += self.joint(
            "other_jaw", "prismatic", f"l{count}", "tip", np.eye(3)[1], limit.replace("0", "-.05", 1) + follow
        )
        names = [f"l{k}" for k in range(count + 1)] + ["left", "tip"]
        self.path = folder / "arm.urdf"
        self.path.write_text(f'<robot name="arm">{"".join(map(LINK.format, names))}{text}</robot>')
        named = sorted(rng.choice(count, count - int(rng.integers(1, 3)), replace=False).tolist())
        self.names = [f"j{k}" for k in rng.permutation(named)]
        self.rng = rng

    def joint(self, name: str, kind: str, parent: str, child: str, axis: Any, more: str) -> str:
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0.03 0 .2"/><axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>{more}</joint>'
        )

    def positions(self, share: float = 0.8) -> Any:
        """Positions of the named joints inside their limits [deg]."""
        low, high = np.array([self.range[int(name[1:])] for name in self.names]).T
        return np.rad2deg(0.5 * (low + high) + share * 0.5 * (high - low) * self.rng.uniform(-1, 1, len(low)))


class Documented:
    """LeRobot's class as documented in its source, on Pinocchio: degrees for every joint, in the order of the names;
    unnamed joints stay at zero; entries after the named ones are passed through."""

    def __init__(self, path: Path, frame: str, names: list[str]) -> None:
        self.model, self.names = pin.buildModelFromUrdf(str(path)), names
        self.frame = self.model.getFrameId(frame)

    def forward_kinematics(self, degrees: Any) -> Any:
        q, data = pin.neutral(self.model), self.model.createData()
        for name, angle in zip(self.names, np.deg2rad(degrees), strict=False):
            joint = self.model.joints[self.model.getJointId(name)]
            q[joint.idx_q : joint.idx_q + joint.nq] = [angle] if joint.nq == 1 else [math.cos(angle), math.sin(angle)]
        pin.framesForwardKinematics(self.model, data, q)
        return data.oMf[self.frame].homogeneous


@pytest.mark.parametrize("seed", SEEDS)
def test_poses_are_those_of_the_documented_class(seed: int, tmp_path: Path) -> None:
    arm = Drawn(seed, tmp_path)
    ours, theirs = RobotKinematics(arm.path, "left", arm.names), Documented(arm.path, "left", arm.names)
    for _ in range(5):
        degrees = np.append(arm.positions(), [33.0, -7.0])
        np.testing.assert_allclose(ours.forward_kinematics(degrees), theirs.forward_kinematics(degrees), atol=1e-12)
        found = ours.inverse_kinematics(degrees, ours.forward_kinematics(degrees))
        assert found[-2:].tolist() == [33.0, -7.0]
        assert found == pytest.approx(degrees, abs=1e-4)
    assert RobotKinematics(arm.path, "left").joint_names == list(theirs.model.names[1:])
    with pytest.raises(DeclarationError, match="at least"):
        ours.forward_kinematics(degrees[: len(arm.names) - 1])


@pytest.mark.parametrize("seed", SEEDS)
def test_poses_are_those_of_lerobot(seed: int, tmp_path: Path) -> None:
    theirs = pytest.importorskip("lerobot.model.kinematics", exc_type=ImportError)
    pytest.importorskip("placo", exc_type=ImportError)
    arm, kinds = Drawn(seed, tmp_path), (RobotKinematics, theirs.RobotKinematics)
    ours, theirs = (kind(str(arm.path), "left").joint_names for kind in kinds)
    assert ours == theirs
    ours, theirs = (kind(str(arm.path), "left", arm.names) for kind in kinds)
    for _ in range(5):
        degrees = arm.positions()
        np.testing.assert_allclose(ours.forward_kinematics(degrees), theirs.forward_kinematics(degrees), atol=1e-9)
        more = np.append(degrees, 12.0)
        pose = ours.forward_kinematics(degrees)
        assert ours.inverse_kinematics(more, pose) == pytest.approx(theirs.inverse_kinematics(more, pose), abs=1e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_named_joints_alone_reach_the_pose(seed: int, tmp_path: Path) -> None:
    """The documented class, with unnamed joints at rest, finds the pose at the answer, for any frame and order."""
    arm = Drawn(seed, tmp_path)
    ours, theirs = RobotKinematics(arm.path, "left", arm.names), Documented(arm.path, "left", arm.names)
    for _ in range(4):
        start = arm.positions(0.5)
        goal = theirs.forward_kinematics(start + np.rad2deg(0.1) * arm.rng.uniform(-1, 1, start.size) * 0.3)
        answer = ours.inverse_kinematics(ours.inverse_kinematics(start, goal, orientation_weight=0.0), goal, 1.0, 0.0)
        assert np.linalg.norm(theirs.forward_kinematics(answer)[:3, 3] - goal[:3, 3]) < 1e-3


@pytest.mark.parametrize("seed", SEEDS)
def test_the_answer_is_the_nearest_turn(seed: int, tmp_path: Path) -> None:
    arm = Drawn(seed, tmp_path, kinds=("continuous", "revolute"))
    ours = RobotKinematics(arm.path, "tip", arm.names)
    turning = [k for k, name in enumerate(arm.names) if arm.kinds[int(name[1:])] == "continuous"]
    for _ in range(5):
        start = arm.positions(0.6)
        turns = np.zeros(start.size)
        turns[turning] = 360.0 * arm.rng.integers(-3, 4, len(turning))
        goal = ours.forward_kinematics(start + arm.rng.uniform(-4.0, 4.0, start.size))
        near, far = ours.inverse_kinematics(start, goal), ours.inverse_kinematics(start + turns, goal)
        assert far - turns == pytest.approx(near, abs=1e-5)
        assert np.abs(far - start - turns).max() < 90.0


@pytest.mark.parametrize("seed", SEEDS)
def test_a_joint_outside_its_limits_returns_without_a_jump(seed: int, tmp_path: Path) -> None:
    """The target is the pose of the measured joints: the answer moves inside by RETURN per call, and stays there."""
    arm = Drawn(seed, tmp_path, kinds=("revolute",))
    ours = RobotKinematics(arm.path, "left", arm.names)
    low, high = np.rad2deg([arm.range[int(name[1:])] for name in arm.names]).T
    q = arm.positions(0.4)
    k = int(arm.rng.integers(len(q)))
    out = arm.rng.uniform(1.5, 4.0)
    q[k] = high[k] + out if arm.rng.random() < 0.5 else low[k] - out
    for _ in range(int(out / RETURN) + 2):
        answer = ours.inverse_kinematics(q, ours.forward_kinematics(q))
        outside = max(float((q - high).max()), float((low - q).max()))
        assert abs(answer[k] - q[k]) <= RETURN + 0.05
        assert np.abs(answer - q).max() < 40.0 * RETURN
        q = answer
        assert max(float((q - high).max()), float((low - q).max())) < max(outside - 0.9 * RETURN, 1e-6)


@pytest.mark.parametrize("goal", [175.0, 185.0, -175.0, 545.0, -190.0])
def test_a_posture_goes_the_nearest_way(goal: float, tmp_path: Path) -> None:
    """Target and measurement on both sides of the half turn: the joint moves by the small difference."""
    arm = Drawn(0, tmp_path, kinds=("continuous",))
    robot = hqp.robots.load(arm.path)
    turn = Posture(joints=["j1"], law=P(5.0))
    session = hqp.Controller(Stack(Level(turn), subject_to=[JointLimits()])).session(robot, dt=0.01)
    angles = robot.state().angles.copy()
    angles[robot.joints("j1")] = math.radians(178.0)
    q, v, way = robot.configuration(angles), np.zeros(robot.nv), 0.0
    for _ in range(300):
        q, v = session.step(robot.state(q, v), turn.at([math.radians(goal)])).advance()
        way += math.degrees(0.01 * float(v[robot.joints("j1")][0]))
    assert way == pytest.approx(math.remainder(goal - 178.0, 360.0), abs=0.05)
