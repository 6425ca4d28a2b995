"""The plant of robots by name: URDF through MuJoCo's reader, and MJCF files with objects and several roots."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import hqp.robots
from hqp.errors import ModelWarning
from hqp.robots.on_mujoco import Plant, Servo

DATA = Path(__file__).parents[1] / "data" / "mjcf"


@pytest.mark.parametrize("name", ["panda", "ur5", "go2", "g1", "talos"])
def test_urdf_robot_has_its_own_inertia_in_mujoco_and_stands(name: str) -> None:
    """M, nle and motors' limits are the robot's; position servos hold home on the ground for half a second."""
    kp = {"panda": 400.0, "ur5": 2000.0, "go2": 200.0, "g1": 300.0, "talos": 3000.0}[name]
    robot = hqp.robots.load(name)
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
    with pytest.warns(ModelWarning):
        free = hqp.robots.load(arm, floating=True)
    plant = Plant(free, terrain=None)
    assert plant.map.floating
    assert plant.model.nv == free.nv
