"""In a drawn MJCF scene the actuated bodies form the robot; other moving bodies are obstacles, in any order."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hqp.robots
from hqp import Level, P, Stack
from hqp.errors import DeclarationError
from hqp.robots.model_map import ModelMap
from hqp.robots.on_mujoco import Plant
from hqp.tasks import CollisionAvoidance, Com, JointLimits, Position

SEEDS = range(6)
GEOMS = (
    '<geom type="box" size=".04 .02 .03"/>',
    '<geom type="sphere" size=".03"/>',
    '<geom type="cylinder" size=".02 .06"/>',
    '<geom type="cylinder" size=".06 .01"/>',
    '<geom type="capsule" size=".02 .05"/>',
    '<geom type="ellipsoid" size=".05 .02 .03"/>',
    '<geom type="mesh" mesh="wedge"/>',
)
MESH = '<asset><mesh name="wedge" vertex="0 0 0 .1 0 0 0 .06 0 0 0 .08 .1 .06 .02"/></asset>'


class Scene:
    """An arm, a gripper on one tendon, and objects in drawn order: free, on a hinge, static, mocap."""

    def __init__(self, seed: int, folder: Path) -> None:
        rng = np.random.default_rng(seed)
        self.rng, self.folder = rng, folder
        length = rng.uniform(0.2, 0.4, 2)
        jaws = "".join(
            f'<body name="{n}" pos="{length[1]} 0 0"><joint name="{n}" type="slide" axis="0 {s} 0" range="0 .04"/>'
            '<geom type="box" size=".02 .005 .01"/></body>'
            for n, s in (("left", 1), ("right", -1))
        )
        self.arm = (
            '<body name="arm" pos="0 0 .1"><joint name="j0" axis="0 0 1" range="-120 120"/>'
            f'<joint name="j1" axis="0 1 0" range="-120 120"/>'
            f'<geom type="capsule" fromto="0 0 0 {length[0]} 0 0" size=".03"/>'
            f'<body name="fore" pos="{length[0]} 0 0"><joint name="j2" axis="0 1 0" range="-120 120"/>'
            f'<geom type="capsule" fromto="0 0 0 {length[1]} 0 0" size=".03"/><site name="tip" pos="{length[1]} 0 0"/>'
            f"{jaws}</body></body>"
        )
        self.after = (
            '<tendon><fixed name="both"><joint joint="left" coef=".5"/><joint joint="right" coef=".5"/></fixed>'
            '</tendon><equality><joint joint1="left" joint2="right"/></equality>'
            '<actuator><motor joint="j0"/><motor joint="j1"/><motor joint="j2"/><motor tendon="both"/></actuator>'
        )
        self.objects, self.free, self.doors = [], [], []
        for k in range(int(rng.integers(2, 6))):
            at, turn = rng.uniform(-0.4, 0.4, 3) + [0.8, 0.0, 0.6], rng.uniform(-90, 90, 3)
            place = f'pos="{at[0]} {at[1]} {at[2]}" euler="{turn[0]} {turn[1]} {turn[2]}"'
            geoms = "".join(rng.choice(GEOMS, int(rng.integers(1, 3)), replace=False))
            kind = ["free", "door", "still", "mocap"][int(rng.integers(4))] if k else "free"
            name = f"{kind}{k}"
            joint = {"free": "<freejoint/>", "door": f'<joint name="hinge{k}" axis="0 0 1" range="0 90"/>'}.get(
                kind, ""
            )
            mocap = 'mocap="true"' if kind == "mocap" else ""
            self.objects.append(f'<body name="{name}" {place} {mocap}>{joint}{geoms}</body>')
            self.free += [name] if kind == "free" else []
            self.doors += [name] if kind == "door" else []

    def file(self, bodies: Any, stem: str) -> Path:
        path = self.folder / f"{stem}.xml"
        path.write_text(f"<mujoco>{MESH}<worldbody>{''.join(bodies)}</worldbody>{self.after}</mujoco>")
        return path

    def whole(self) -> Path:
        bodies = [self.arm, *self.objects]
        return self.file([bodies[k] for k in self.rng.permutation(len(bodies))], "scene")


@pytest.mark.parametrize("seed", SEEDS)
def test_the_robot_is_that_without_its_scene(seed: int, tmp_path: Path) -> None:
    drawn = Scene(seed, tmp_path)
    alone, robot = hqp.robots.load(drawn.file([drawn.arm], "alone")), hqp.robots.load(drawn.whole())
    assert robot.joint_names == alone.joint_names
    assert list(robot.model.names) == list(alone.model.names)
    assert robot.mass == pytest.approx(alone.mass)
    rng = np.random.default_rng(seed)
    for _ in range(3):
        q, v = alone.random_configuration(rng), rng.normal(size=alone.nv)
        one, two = robot.state(q, v), alone.state(q, v)
        np.testing.assert_allclose(one.mass_matrix(), two.mass_matrix(), atol=1e-12)
        np.testing.assert_allclose(one.bias_force(), two.bias_force(), atol=1e-12)
        np.testing.assert_allclose(one.com(), two.com(), atol=1e-12)
    assert {c.name for c in robot.couplings} == {"left_right"}
    objects = drawn.free + drawn.doors
    (note,) = [n for n in robot.notes if "not part of the robot" in n]
    assert all(name in note for name in objects)
    assert set(robot.obstacles.bodies) == set(objects)
    assert not alone.obstacles.shapes
    assert [i.parentJoint for i in robot.geometry.geometryObjects if i.parentJoint] == [2, 3, 4, 5]


@pytest.mark.parametrize("seed", SEEDS)
def test_obstacles_contain_the_geoms_where_they_are(seed: int, tmp_path: Path) -> None:
    """Move bodies in MuJoCo: its rays from far away end inside the shapes at the poses of ``at``."""
    drawn = Scene(seed, tmp_path)
    path = drawn.whole()
    obstacles, simulated = hqp.robots.load(path).obstacles, mujoco.MjModel.from_xml_path(str(path))
    data, rng = mujoco.MjData(simulated), np.random.default_rng(seed)
    for moved in (False, True):
        if moved:
            data.qpos[:] += rng.uniform(-0.3, 0.3, simulated.nq)
            mujoco.mj_normalizeQuat(simulated, data.qpos)
        mujoco.mj_forward(simulated, data)
        poses = {}
        for name in obstacles.bodies:
            poses[name] = np.eye(4)
            poses[name][:3, :3], poses[name][:3, 3] = data.body(name).xmat.reshape(3, 3), data.body(name).xpos
        at = obstacles.at(poses) if moved else {s.name: s.pose for s in obstacles.shapes}
        for name, pose in poses.items():
            own = [s for s in obstacles.shapes if s.name.split("/")[0] == name]
            points = surface_points(simulated, data, name, rng)
            depth = np.min([outside(s, at[s.name], points) for s in own], axis=0)
            assert depth.max() < 1e-6, (name, depth.max())
            size = max(float(np.ptp(points, axis=0).max()), 0.01)
            for s in own:
                assert np.linalg.norm(at[s.name][:3, 3] - pose[:3, 3]) < 2.0 * size


def surface_points(simulated: Any, data: Any, name: str, rng: Any) -> Any:
    """Points of a body's geoms hit by rays ``(n, 3)``."""
    body, found = simulated.body(name), []
    for g in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]):
        middle, size = data.geom_xpos[g], 2.0 * simulated.geom_rbound[g]
        for _ in range(200):
            start = rng.normal(size=3)
            start *= size / np.linalg.norm(start)
            way = 0.3 * size * rng.uniform(-1, 1, 3) - start
            way /= np.linalg.norm(way)
            start = start + middle
            kind = simulated.geom_type[g]
            if kind == mujoco.mjtGeom.mjGEOM_MESH:
                far = mujoco.mj_rayMesh(simulated, data, g, start, way)
            else:
                far = mujoco.mju_rayGeom(middle, data.geom_xmat[g], simulated.geom_size[g], start, way, int(kind))
            if far >= 0.0:
                found.append(start + far * way)
    assert len(found) > 50
    return np.array(found)


def outside(shape: Any, pose: Any, points: Any) -> Any:
    """Distances of points from a shape, negative inside ``(n,)`` [m]."""
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    if shape.kind == "sphere":
        return np.linalg.norm(local, axis=1) - shape.size[0]
    if shape.kind == "capsule":
        core = np.clip(local[:, 2], -0.5 * shape.size[1], 0.5 * shape.size[1])
        return np.linalg.norm(local - np.outer(core, [0, 0, 1]), axis=1) - shape.size[0]
    assert shape.kind == "box"
    return (np.abs(local) - 0.5 * np.array(shape.size)).max(axis=1)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_task_of_the_whole_robot_leaves_the_objects_alone(seed: int, tmp_path: Path) -> None:
    robot = hqp.robots.load(Scene(seed, tmp_path).whole())
    com = Com(law=P(5.0))
    session = hqp.Controller(Stack(Level(com), subject_to=[JointLimits()])).session(robot, dt=0.01)
    q, v = robot.home, np.zeros(robot.nv)
    goal, before = com.value(robot.state(q)) + [-0.05, 0.03, 0.04], robot.state(q).position("free0").copy()
    for _ in range(300):
        q, v = session.step(robot.state(q, v), com.at(goal)).advance()
    np.testing.assert_array_equal(robot.state(q).position("free0"), before)
    assert np.linalg.norm(com.value(robot.state(q)) - goal) < 1e-3


@pytest.mark.filterwarnings("ignore:.*fitting capsules")
@pytest.mark.parametrize("seed", SEEDS)
def test_the_arm_gives_way_to_an_object_that_comes(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An object passes through the place of the tip; MuJoCo's distance of its geoms to the arm keeps the clearance."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    drawn = Scene(seed, tmp_path)
    path = drawn.whole()
    robot, simulated = hqp.robots.load(path), mujoco.MjModel.from_xml_path(str(path))
    avoid = CollisionAvoidance(pairs="world", world=robot.obstacles.shapes, clearance=0.02, recovery=0.3)
    tip = Position(frame="tip", law=P(2.0))
    session = hqp.Controller(Stack(Level(tip), subject_to=[JointLimits(), avoid])).session(robot, dt=0.01)
    q, v = robot.home, np.zeros(robot.nv)
    plant = mujoco.MjData(simulated)
    goal, name = robot.state(q).position("tip").copy(), "free0"
    away = {n: np.array([5.0 + k, 5.0, 5.0]) for k, n in enumerate(robot.obstacles.bodies)}
    start = goal + [0.25, 0.3, 0.1]
    convert, least = ModelMap(simulated, robot), np.inf
    for k in range(250):
        at = start + (goal - start) * k / 150.0
        velocity = (goal - start) / 1.5
        poses = {**away, name: at}
        given = robot.obstacles.at(poses)
        rates = {s: velocity for s in given if s.split("/")[0] == name}
        q, v = session.step(robot.state(q, v), tip.at(goal), avoid.at(given, rates)).advance()
        plant.qpos[:] = convert.to_mujoco(q, v)[0]
        joint = simulated.jnt_qposadr[simulated.body(name).jntadr[0]]
        plant.qpos[joint : joint + 3] = at + velocity * 0.01
        mujoco.mj_kinematics(simulated, plant)
        arm = [
            g
            for n in ("arm", "fore")
            for g in range(simulated.ngeom)
            if simulated.geom_bodyid[g] == simulated.body(n).id
        ]
        own = [g for g in range(simulated.ngeom) if simulated.geom_bodyid[g] == simulated.body(name).id]
        least = min(least, *(mujoco.mj_geomDistance(simulated, plant, a, b, 1.0, None) for a in arm for b in own))
    assert 0.02 - 2e-3 < least < 0.2


def geoms(simulated: Any, body: str) -> list[int]:
    return [g for g in range(simulated.ngeom) if simulated.geom_bodyid[g] == simulated.body(body).id]


@pytest.mark.parametrize("seed", SEEDS)
def test_root_chooses(seed: int, tmp_path: Path) -> None:
    drawn = Scene(seed, tmp_path)
    path = drawn.whole()
    robot = hqp.robots.load(path, root="free0")
    assert (robot.nv, robot.floating) == (6, True)
    assert {"arm"} <= set(robot.obstacles.bodies)
    both = hqp.robots.load(path, root=["arm", "free0"])
    assert both.nv == 5 + 6
    assert not both.floating
    assert hqp.robots.load(path, root="fore").nv == 5
    with pytest.raises(DeclarationError, match="arm"):
        hqp.robots.load(path, root="nobody")
    with pytest.raises(DeclarationError, match="MJCF"):
        hqp.robots.load("panda", root="panda_link0")


@pytest.mark.filterwarnings("ignore")
def test_what_an_equality_ties_to_the_robot_is_the_robot(tmp_path: Path) -> None:
    drawn = Scene(1, tmp_path)
    drawn.after += '<equality><weld body1="fore" body2="free0"/></equality>'
    assert hqp.robots.load(drawn.whole()).nv == 5 + 6


def test_objects_of_a_plant_fall_beside_the_robot(tmp_path: Path) -> None:
    robot = hqp.robots.load(Scene(2, tmp_path).whole())
    plant = Plant(robot, terrain=None)
    before = plant.place("free0")[0][2]
    plant.step(np.zeros(len(robot.joint_names)), steps=100)
    q = plant.state()[0]
    assert q.shape == robot.home.shape
    assert plant.place("free0")[0][2] < before - 0.04
