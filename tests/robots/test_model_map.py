"""Conversion of states between Pinocchio and MuJoCo, and the physics of both engines at one state."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import hqp.robots
from hqp.errors import JointNotFound, ModelError
from hqp.robots.mujoco_extra import full_inertia
from hqp.robots.on_mujoco import ModelMap, Plant

OWN = [("cbi", "cbi"), ("dreamer", "dreamer"), ("dreamer", "dreamer_rollers"), ("dreamer", "dreamer_hinges")]
TOLERANCE = 1e-10


@pytest.fixture(scope="module", params=[*OWN, ("hopper", "hopper")], ids=lambda pair: pair[1])
def plant(request: pytest.FixtureRequest, hopper: Path) -> tuple[Plant, Any]:
    """Plant and Pinocchio model with equal armature."""
    name, stem = request.param
    if name == "hopper":
        robot = hqp.robots.load(hopper)
        return Plant(robot, hopper), robot.model
    robot = hqp.robots.load(name, rotors=True)
    return Plant(robot, stem), robot.model


def random_state(model: Any, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    lower = np.maximum(model.lowerPositionLimit[7:], -3.0)
    upper = np.minimum(model.upperPositionLimit[7:], 3.0)
    quaternion = rng.normal(size=4)
    quaternion /= np.linalg.norm(quaternion)
    base = [*rng.uniform(-1, 1, 2), rng.uniform(4, 6)]
    q = np.concatenate((base, quaternion, rng.uniform(lower, upper)))
    return q, rng.normal(size=model.nv)


def states(model: Any, count: int = 10):
    rng = np.random.default_rng(11)
    for _ in range(count):
        yield random_state(model, rng)


def test_there_and_back(plant: tuple[Plant, Any]) -> None:
    plant, model = plant
    for q, v in states(model):
        found_q, found_v = plant.map.to_pinocchio(*plant.map.to_mujoco(q, v))
        np.testing.assert_allclose(found_q, q, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found_v, v, rtol=0, atol=1e-13)
        reset_q, reset_v = plant.reset(q, v)
        np.testing.assert_allclose(reset_q, q, rtol=0, atol=1e-14)
        np.testing.assert_allclose(reset_v, v, rtol=0, atol=1e-13)


def test_tangent_is_the_derivative(plant: tuple[Plant, Any]) -> None:
    """qvel of the map is B v; integration of either engine's velocity leads to one configuration."""
    plant, model = plant
    h = 1e-7
    for q, v in states(model, 3):
        qpos, qvel = plant.map.to_mujoco(q, v)
        np.testing.assert_allclose(plant.map.tangent(qpos) @ v, qvel, rtol=0, atol=1e-13)
        moved = qpos.copy()
        mujoco.mj_integratePos(plant.model, moved, qvel, h)
        expected, _ = plant.map.to_mujoco(pin.integrate(model, q, h * v), v)
        np.testing.assert_allclose(moved, expected, rtol=0, atol=20 * h * h * (1 + v @ v))


def test_mass_matrix_com_momentum(plant: tuple[Plant, Any]) -> None:
    plant, model = plant
    data = model.createData()
    for q, v in states(model):
        plant.reset(q, v)
        pin.crba(model, data, q)
        mass = np.triu(data.M) + np.triu(data.M, 1).T
        np.testing.assert_allclose(plant.mass_matrix(), mass, rtol=0, atol=TOLERANCE)
        pin.ccrba(model, data, q, v)
        np.testing.assert_allclose(plant.com(), data.com[0], rtol=0, atol=TOLERANCE)
        np.testing.assert_allclose(plant.momentum(), data.hg.vector, rtol=0, atol=TOLERANCE)


def test_frames(plant: tuple[Plant, Any]) -> None:
    plant, model = plant
    data = model.createData()
    sites = [plant.model.site(i).name for i in range(plant.model.nsite)]
    bodies = [plant.model.body(i).name for i in range(plant.model.nbody)]
    shared = [frame for frame in model.frames if frame.name in sites or frame.name in bodies]
    shared = [frame for frame in shared if frame.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME)]
    assert len(shared) >= 4
    for q, v in states(model):
        plant.reset(q, v)
        pin.forwardKinematics(model, data, q, v)
        pin.updateFramePlacements(model, data)
        for frame in shared:
            index = model.getFrameId(frame.name)
            position, rotation = plant.place(frame.name)
            np.testing.assert_allclose(position, data.oMf[index].translation, rtol=0, atol=TOLERANCE)
            np.testing.assert_allclose(rotation, data.oMf[index].rotation, rtol=0, atol=TOLERANCE)
            velocity = pin.getFrameVelocity(model, data, index, pin.LOCAL_WORLD_ALIGNED).vector
            np.testing.assert_allclose(plant.velocity(frame.name), velocity, rtol=0, atol=TOLERANCE)


def test_bias_forces(plant: tuple[Plant, Any]) -> None:
    """nle = B' (qfrc_bias + M dB/dt v): the world-axes base velocity turns with the base."""
    plant, model = plant
    data = model.createData()
    for q, v in states(model, 5):
        plant.reset(q, v)
        pin.nonLinearEffects(model, data, q, v)
        nv = plant.model.nv
        full = full_inertia(plant.model, plant.data)
        drift = np.zeros(nv)
        rotation = pin.Quaternion(q[3:7]).matrix()
        drift[:3] = rotation @ np.cross(v[3:6], v[:3])
        B = plant.map.tangent(plant.data.qpos)
        found = B.T @ (plant.data.qfrc_bias + full @ drift)
        np.testing.assert_allclose(found, data.nle, rtol=0, atol=1e-9 * max(1.0, np.abs(data.nle).max()))


def test_rates_of_a_ball_that_rolled_sideways() -> None:
    """The wheel's rate is the component about the axle on the base, for any orientation of the ball."""
    robot = hqp.robots.load("dreamer")
    plant = Plant(robot, "dreamer")
    rng = np.random.default_rng(3)
    plant.reset(*random_state(robot.model, rng))
    qpos, qvel = plant.data.qpos.copy(), plant.data.qvel.copy()
    for k in range(3):
        joint = plant.model.joint(f"wheel_j{k}")
        qpos[joint.qposadr[0] : joint.qposadr[0] + 4] = pin.Quaternion(pin.SE3.Random().rotation).coeffs()
    plant.data.qpos[:], plant.data.qvel[:] = qpos, qvel
    mujoco.mj_forward(plant.model, plant.data)
    _, v = plant.state()
    _, base = plant.place("base")
    for k, name in enumerate(("wheel_j0", "wheel_j1", "wheel_j2")):
        axle = base @ plant.map.axles[name]
        relative = plant.velocity(f"wheel_{k}")[3:] - plant.velocity("base")[3:]
        column = robot.joints(name)[0]
        assert v[column] == pytest.approx(axle @ relative, abs=1e-12)


CONTINUOUS = """<robot name="spinner"><link name="root"/>
<link name="disc"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="spin" type="continuous"><parent link="root"/><child link="disc"/><axis xyz="0 0 1"/></joint></robot>"""
SPINNER = """<mujoco><worldbody><body name="disc"><joint name="spin" axis="0 0 1"/>
<inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/></body></worldbody></mujoco>"""


def test_continuous_joint_has_two_numbers_in_q() -> None:
    model = pin.buildModelFromXML(CONTINUOUS)
    assert (model.nq, model.nv) == (2, 1)
    state_map = ModelMap(mujoco.MjModel.from_xml_string(SPINNER), model)
    qpos, qvel = state_map.to_mujoco(np.array([np.cos(2.0), np.sin(2.0)]), np.array([0.5]))
    assert qpos[0] == pytest.approx(2.0)
    assert qvel[0] == 0.5
    q, v = state_map.to_pinocchio(np.array([9.0]), np.array([-0.5]))
    np.testing.assert_allclose(q, [np.cos(9.0), np.sin(9.0)])
    assert v[0] == -0.5
    state_map.turn_joints(q, np.array([1.0]))
    np.testing.assert_allclose(q, [np.cos(10.0), np.sin(10.0)])
    np.testing.assert_array_equal(state_map.tangent(qpos), [[1.0]])


def test_spherical_joint() -> None:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "shoulder")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    text = SPINNER.replace('name="spin" axis="0 0 1"', 'name="shoulder" type="ball"')
    state_map = ModelMap(mujoco.MjModel.from_xml_string(text), model)
    q, v = pin.randomConfiguration(model, -np.ones(4), np.ones(4)), np.arange(3.0)
    qpos, qvel = state_map.to_mujoco(q, v)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, qpos)
    np.testing.assert_allclose(turn.reshape(3, 3), pin.Quaternion(q).matrix(), atol=1e-14)
    back, rate = state_map.to_pinocchio(qpos, qvel)
    np.testing.assert_allclose(back, q, atol=1e-15)
    np.testing.assert_array_equal(rate, v)
    np.testing.assert_array_equal(state_map.tangent(qpos), np.eye(3))


def test_models_that_do_not_fit() -> None:
    cbi = hqp.robots.load("cbi")
    with pytest.raises(ModelError, match="floating in Pinocchio and fixed"):
        ModelMap(mujoco.MjModel.from_xml_string(SPINNER), cbi)
    with pytest.raises(JointNotFound, match="spim"):
        ModelMap(mujoco.MjModel.from_xml_string(SPINNER.replace("spin", "spim")), pin.buildModelFromXML(CONTINUOUS))
    ball = SPINNER.replace('axis="0 0 1"', 'type="ball"')
    with pytest.raises(ModelError, match=r"spin.*mjJNT_BALL"):
        ModelMap(mujoco.MjModel.from_xml_string(ball), pin.buildModelFromXML(CONTINUOUS))
