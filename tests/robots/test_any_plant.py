"""The plant of robots by name: URDF through MuJoCo's reader, and MJCF files with objects and several roots."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hqp.robots
from hqp.errors import DeclarationError, ModelError, ModelWarning
from hqp.robots.on_mujoco import Plant, Servo
from hqp.robots.physical import LIGHT, make_physical
from hqp.walking.feet import feet_of
from hqp.walking.stance import standing

DATA = Path(__file__).parents[1] / "data" / "mjcf"


@pytest.mark.long
@pytest.mark.parametrize("name", ["panda", "ur5", "go2", "g1", "talos"])
def test_urdf_robot_has_its_own_inertia_in_mujoco_and_stands(name: str) -> None:
    """M, nle and motor limits match the robot; position servos hold home on the ground for half a second."""
    kp = {"panda": 400.0, "ur5": 2000.0, "go2": 200.0, "g1": 300.0, "talos": 3000.0}[name]
    robot = hqp.robots.load(name, rotors=True)
    plant = Plant(robot, actuation="position", servo=Servo(other=kp))
    assert plant.joint_names == robot.joint_names
    rng = np.random.default_rng(2)
    q = robot.integrate(robot.home, rng.uniform(-0.3, 0.3, robot.nv), 1.0)
    plant.reset(q)
    np.testing.assert_allclose(plant.mass_matrix(), robot.state(q).mass_matrix(), atol=1e-11)
    effort = plant.model.actuator_forcerange[plant._order, 1]
    limits = robot.effort_limit[robot.actuated]
    np.testing.assert_array_equal(effort[limits < np.inf], limits[limits < np.inf])
    start, _ = plant.reset()
    np.testing.assert_allclose(start, robot.home, atol=1e-12)
    centre, command = plant.com(), robot.state(robot.home).angles[robot.actuated]
    for _ in range(250):
        plant.step(command, steps=2)
    assert np.linalg.norm(plant.com() - centre) < 0.025
    if robot.floating:
        touching = {plant.model.body(b).name for b in plant.model.geom_bodyid[plant.data.contact.geom].ravel()}
        feet = [f.removesuffix("_sole") for f in robot.landmarks.get("soles", robot.landmarks.get("feet"))]
        assert touching - {"world"}
        assert len(touching - {"world"}) <= len(feet), touching


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "link", "off"),
    [("icub", "head", 1e-2), ("romeo", "RElbowYawLink", 1e-2), ("anymal", "depth_camera", 1e-2), ("human", "", 1e-1)],
)
def test_inertias_that_no_body_has_are_mended_in_the_plant_and_told(name: str, link: str, off: float) -> None:
    """MuJoCo refuses the inertia; the plant's M stays close to the robot's."""
    robot = hqp.robots.load(name, rotors=True)
    with pytest.warns(ModelWarning, match=f"inertias.*{link}"):
        plant = Plant(robot)
    q, _ = plant.reset()
    M = robot.state(q).mass_matrix()
    assert np.abs(plant.mass_matrix() - M).max() < off * np.abs(M).max()
    assert np.linalg.eigvalsh(plant.mass_matrix())[0] > 0.0


@pytest.mark.parametrize("name", ["go1", "a1"])
def test_a_robot_whose_home_is_in_the_ground_starts_on_it(name: str) -> None:
    """The file has no height of the base: the plant lifts the robot, and it stays near its start."""
    source = hqp.robots.load(name).source
    assert source is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        robot = hqp.robots.load(source, floating=True)  # the catalogue has a height, the file does not
        plant = Plant(robot, actuation="position", servo=Servo(other=300.0))
    q, _ = plant.reset()
    assert q[2] > robot.home[2] + 0.3
    assert np.min(plant.data.contact.dist, initial=0.0) > -5e-3
    start, command = plant.com(), robot.state(robot.home).angles[robot.actuated]
    plant.step(command, steps=200)
    assert np.linalg.norm(plant.com() - start) < 0.1
    placed, _ = plant.reset(robot.home)
    np.testing.assert_allclose(placed, robot.home, atol=1e-12)  # an explicit configuration is used unchanged


@pytest.mark.parametrize(
    ("mass", "moments", "wanted"),
    [
        (1.0, (1.0, 1.0, 5.0), (2.0, 2.0, 4.0)),  # A + B < C
        (1.0, (-1e-8, 1.0, 1.0), (1e-4, 1.0, 1.0)),
        (0.0, (0.0, 0.0, 0.0), (1e-7, 1e-7, 1e-7)),
        (1.0, (0.3, 0.4, 0.5), (0.3, 0.4, 0.5)),
    ],
)
def test_the_nearest_inertia_that_a_body_has(mass: float, moments: Any, wanted: Any) -> None:
    tensor = 'ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"'.format(*moments)
    inertial = f'<inertial><mass value="{mass}"/><inertia {tensor}/></inertial>'
    text = f'<robot><link name="arm">{inertial}</link><joint type="revolute"><child link="arm"/></joint></robot>'
    root = ET.fromstring(text)
    assert make_physical(root) == (["arm"] if moments != wanted else [])
    found = next(root.iter("inertia"))
    assert [float(found.get(k, 0.0)) for k in ("ixx", "iyy", "izz")] == pytest.approx(wanted, rel=1e-6)
    assert float(next(root.iter("mass")).get("value", 0.0)) == (mass or LIGHT)


def test_mobile_arm_with_an_object_and_a_door() -> None:
    robot = hqp.robots.load(DATA / "mobile_arm.xml")
    plant = Plant(robot)
    q, _ = plant.reset()
    np.testing.assert_allclose(q, robot.home, atol=1e-12)
    assert plant.joint_names == robot.joint_names
    np.testing.assert_allclose(plant.mass_matrix(), robot.state(q).mass_matrix(), atol=1e-11)
    planes = [g for g in range(plant.model.ngeom) if plant.model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE]
    assert [plant.model.geom(g).name for g in planes] == ["ground"]
    force = np.zeros(6)
    force[robot.joint_names.index("base_x")] = 20.0
    plant.step(force, steps=100)
    _, v = plant.state()
    assert v[robot.joints("base_x")[0]] > 0.02


def test_free_base_beside_a_ball_and_names_left_out() -> None:
    robot = hqp.robots.load(DATA / "two_legs.xml")
    plant = Plant(robot, actuation="position", servo=Servo(other=50.0))
    assert plant.joint_names == robot.joint_names
    q, _ = plant.state()
    np.testing.assert_allclose(q, robot.home, atol=1e-12)
    q[2] += 1.0
    q, _ = plant.reset(q)
    height = q[2]
    assert plant.model.body(plant._root).name == "pelvis"
    plant.step(robot.state(q).angles[robot.actuated], steps=50)
    q, _ = plant.state()
    assert height - q[2] == pytest.approx(0.5 * 9.81 * 0.05**2, rel=0.1)


def test_root_that_was_freed_on_loading_is_free_in_the_plant() -> None:
    arm = DATA / "arm.xml"
    free = hqp.robots.load(arm, floating=True)
    plant = Plant(free, terrain=None)
    assert plant.map.floating
    assert plant.model.nv == free.nv


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_freed_link_named_world_is_refused(tmp_path: Path) -> None:
    """MuJoCo takes it for the ground and frees the next link: states were off by the joint between both."""
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    path = tmp_path / "hung.urdf"
    for name, refused in (("world", True), ("pelvis", False)):
        path.write_text(
            f'<robot name="hung"><link name="{name}">{"" if refused else inertial}</link>'
            f'<joint name="hung" type="fixed"><parent link="{name}"/><child link="body"/><origin xyz="0 0 1"/></joint>'
            f'<link name="body">{inertial}</link>'
            '<joint name="arm" type="revolute"><parent link="body"/><child link="hand"/><axis xyz="1 0 0"/>'
            f'<limit lower="-1" upper="1" effort="9" velocity="9"/></joint><link name="hand">{inertial}</link></robot>'
        )
        robot = hqp.robots.load(path, floating=True)
        if refused:
            with pytest.raises(ModelError, match="link 'world'"):
                Plant(robot)
            continue
        plant = Plant(robot)
        q, _ = plant.reset()
        np.testing.assert_allclose(plant.com(), robot.state(q).com(), atol=1e-9)


@pytest.mark.long
def test_every_robot_of_the_catalogue_has_a_plant() -> None:
    for name in hqp.robots.names():
        q, _ = Plant(hqp.robots.load(name)).reset()
        assert np.all(np.isfinite(q)), name


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["talos", "icub", *(pytest.param(n, marks=pytest.mark.slow) for n in ("g1", "romeo"))])
def test_a_sole_bears_what_all_links_fixed_to_it_bear(name: str) -> None:
    """Two feet bear the weight: Talos' sole link has no shapes, its parent has; iCub's sole has shapes on two links."""
    robot = hqp.robots.load(name)
    plant = Plant(robot, watched=robot.landmarks["soles"], actuation="position", servo=Servo(other=3e3))
    start = standing(robot, feet_of(robot), lower=0.05)
    plant.reset(start)
    for _ in range(1000):
        plant.step(start[7:])
    load = plant.contacts().load
    assert load.sum() == pytest.approx(9.81 * robot.mass, rel=0.02)
    assert load.min() > 0.3 * load.sum()
    assert Plant(robot).watched == robot.landmarks["soles"]


@pytest.mark.long
def test_a_watched_frame_that_can_touch_nothing_is_refused() -> None:
    robot = hqp.robots.load("talos")

    def bare(spec: Any) -> None:
        for geom in spec.body("leg_left_6_link").geoms:
            geom.contype, geom.conaffinity = 0, 0

    with pytest.raises(DeclarationError, match="left_sole_link"):
        Plant(robot, watched=["left_sole_link"], edit=bare)
    assert Plant(robot, edit=bare).watched == ("right_sole_link",)
    with pytest.raises(DeclarationError, match=r"on one body.*leg_right_6_link"):
        Plant(robot, watched=["right_sole_link", "leg_right_6_link"])


@pytest.mark.slow
def test_a_urdf_robot_has_rotors_in_the_plant() -> None:
    """Rotors of G1's ankles: 50 and 35 N m; the control model includes them on request, and then M agrees."""
    robot = hqp.robots.load("g1", rotors=True)
    plant = Plant(robot)
    told = plant.armature
    assert tuple(told) == robot.joint_names
    effort = dict(zip(robot.joint_names, robot.effort_limit[robot.actuated], strict=True))
    assert told == pytest.approx({name: min(0.01, effort[name] / 5000.0) for name in told})
    assert told["left_wrist_yaw_joint"] < told["left_ankle_roll_joint"] < told["left_knee_joint"] == 0.01
    q, _ = plant.reset(robot.home.copy())
    np.testing.assert_allclose(plant.mass_matrix(), robot.state(q).mass_matrix(), atol=1e-9)
    bare = hqp.robots.load("g1")
    assert not bare.model.armature.any()
    assert Plant(bare).armature == told
    assert set(Plant(bare, armature={}).armature.values()) == {0.0}
