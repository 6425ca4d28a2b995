"""The plant: commands, forces, delay, terrain, sensors, and standing robots."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import hqp.robots
from hqp.errors import DeclarationError, FrameNotFound, JointNotFound, ModelError
from hqp.robots.on_mujoco import Plane, Plant, Ramp, Sensors, Servo
from hqp.robots.sensors import Noise

GRAVITY = 9.81

BOX = """<mujoco model="box"><worldbody><body name="box"><freejoint/>
<inertial pos="0 0 0" mass="3" diaginertia="0.02 0.03 0.04"/>
<geom name="skin" type="box" size="0.1 0.1 0.05"/><site name="corner" pos="0.1 0.1 0.05"/>
</body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mjcf") / "box.xml"
    path.write_text(BOX)
    return path


def free(height: float, x: float = 0.0, angle: float = 0.0) -> np.ndarray:
    """q of a free body, tilted uphill by an angle about -y."""
    return np.array([x, 0.0, height, 0.0, -math.sin(angle / 2), 0.0, math.cos(angle / 2)])


def hold(robot: Any, plant: Plant, q0: np.ndarray, seconds: float) -> float:
    """Hold Dreamer's upper body with gravity compensation and a stiff PD, wheels braked; return the least wheel load
    [N]."""
    index = [robot.model.joints[robot.model.getJointId(n)].idx_q for n in plant.joint_names]
    wheel = np.array([name.startswith("wheel") for name in plant.joint_names])
    kp = np.where(wheel, 0.0, [2000.0 if name.startswith("torso") else 300.0 for name in plant.joint_names])
    kd = np.where(wheel, 5.0, 0.05 * kp)
    hip, thorax = plant.joint_names.index("torso_hip"), robot.joints("torso_thorax")[0]
    least = math.inf
    for _ in range(round(seconds / (2 * plant.timestep))):
        q, v = plant.state()
        gravity = robot.state(q).gravity_force()
        torque = gravity[robot.actuated] - kp * (q - q0)[index] - kd * v[robot.actuated]
        torque[hip] += gravity[thorax]  # one motor drives both joints
        plant.step(torque, steps=2)
        least = min(least, plant.contacts().load.min())
    return float(least)


# ---------------------------------------------------------------------------------------- robots stand


def test_cbi_stands_under_the_position_servo() -> None:
    robot = hqp.robots.load("cbi")
    plant = Plant(robot, actuation="position")
    q0, _ = plant.reset()
    before = plant.com()
    index = [robot.model.joints[robot.model.getJointId(n)].idx_q for n in plant.joint_names]
    command = q0[index]
    feet = plant.place("l_sole")[0], plant.place("r_sole")[0]
    for _ in range(1000):
        plant.step(command, steps=2)
    q, v = plant.state()
    assert plant.time == pytest.approx(2.0)
    assert np.linalg.norm(plant.com() - before) < 3e-3
    assert np.abs(v).max() < 1e-3
    assert np.abs((q - q0)[index]).max() < 0.01
    for foot, name in zip(feet, ("l_sole", "r_sole"), strict=True):
        assert np.linalg.norm(plant.place(name)[0] - foot) < 1e-3
    contacts = plant.contacts()
    assert plant.watched == ("l_sole", "r_sole")
    assert contacts.load.sum() == pytest.approx(87.0 * GRAVITY, rel=1e-4)
    np.testing.assert_allclose(contacts.load, 43.5 * GRAVITY, rtol=0.02)
    np.testing.assert_allclose(contacts.normal, [[0, 0, 1]] * 2, atol=1e-9)
    assert (np.abs(plant.torque) <= robot.effort_limit[robot.actuated]).all()


@pytest.mark.parametrize("stem", ["dreamer", "dreamer_rollers"])
def test_dreamer_stands(stem: str) -> None:
    robot = hqp.robots.load("dreamer")
    plant = Plant(robot, stem)
    q0, _ = plant.reset()
    before = plant.com()
    assert hold(robot, plant, q0, 1.0) > 50.0
    q, v = plant.state()
    assert np.linalg.norm(plant.com() - before) < 2e-3
    assert np.abs(v[robot.joints("upper_body")]).max() < 1e-3
    contacts = plant.contacts()
    assert plant.watched == ("wheel_0", "wheel_1", "wheel_2")
    assert contacts.load.sum() == pytest.approx(71.464 * GRAVITY, rel=5e-3)
    np.testing.assert_allclose(contacts.normal, [[0, 0, 1]] * 3, atol=1e-6)
    np.testing.assert_allclose(contacts.point[:, :2], [[0.24, 0], [-0.12, 0.2078], [-0.12, -0.2078]], atol=2e-3)
    hip, thorax = (robot.model.joints[robot.model.getJointId(n)].idx_q for n in ("torso_hip", "torso_thorax"))
    assert abs(math.degrees(q[hip] - q[thorax])) < 0.02


def frictionless_and_stiff(stem: str) -> Plant:
    """Dreamer with springs that lock the upper body, frictionless wheels, settled on the ground."""
    plant = Plant(hqp.robots.load("dreamer"), stem)
    model = plant.model
    for i in range(1, model.njnt):
        name, dof = model.joint(i).name, model.jnt_dofadr[i]
        if name.startswith("wheel_j"):
            model.dof_damping[dof : dof + 3] = 0.0
        elif "roller" not in name:
            model.jnt_stiffness[i], model.dof_damping[dof] = 2e4, 200.0
            model.qpos_spring[model.jnt_qposadr[i]] = plant.data.qpos[model.jnt_qposadr[i]]
    plant.step(np.zeros(12), steps=300)
    return plant


# three wheels at 120 degrees turn with cos^2 of the heading: 3/2 of one wheel in any direction
ROLLING_MASS = 71.464 + 1.5 * 0.0027981 / 0.101**2


@pytest.mark.parametrize("heading", [0.0, 0.7, math.pi / 2])
@pytest.mark.parametrize(("stem", "tolerance"), [("dreamer", 0.01), ("dreamer_rollers", 0.07)])
def test_omnidirectional_wheels_roll(stem: str, tolerance: float, heading: float) -> None:
    """Push the robot at its centre of mass: in any direction its acceleration follows from mass and wheel inertia.

    Rollers cost some: the ground spins up each roller that touches down.
    """
    plant = frictionless_and_stiff(stem)
    along = np.array([math.cos(heading), math.sin(heading), 0.0])
    start = plant.momentum()[:3] / 71.464
    for _ in range(100):
        plant.push("base", 20.0 * along, at=plant.com())
        plant.step(np.zeros(12), steps=5)
    rate = (plant.momentum()[:3] / 71.464 - start) / 0.5
    assert rate @ along == pytest.approx(20.0 / ROLLING_MASS, rel=tolerance)
    assert abs(np.cross(along, rate)[2]) < 0.02 * 20.0 / ROLLING_MASS


@pytest.mark.parametrize(("stem", "tolerance"), [("dreamer", 0.01), ("dreamer_rollers", 0.07)])
def test_wheel_torque_drives_along_the_rim(stem: str, tolerance: float) -> None:
    """The ground gives F = tau / r along axle x z: opposite torques on the rear wheels drive along x."""
    plant = frictionless_and_stiff(stem)
    torque = np.zeros(12)
    torque[plant.joint_names.index("wheel_j1")] = 1.0
    torque[plant.joint_names.index("wheel_j2")] = -1.0
    start = plant.momentum()[:3]
    plant.step(torque, steps=500)
    found = (plant.momentum()[:3] - start) / 0.5
    force = math.sqrt(3.0) / 0.101 * 71.464 / ROLLING_MASS
    assert found[0] == pytest.approx(force, rel=tolerance)
    assert abs(found[1]) < tolerance * force
    _, v = plant.state()
    for k, wheel in enumerate(hqp.robots.load("dreamer").joints("wheels")):
        place = np.array([0.24 * math.cos(2 * math.pi * k / 3), 0.24 * math.sin(2 * math.pi * k / 3), 0.0])
        rim = np.cross(place / 0.24, [0.0, 0.0, 1.0])
        assert v[wheel] * 0.101 == pytest.approx(rim @ (v[:3] + np.cross(v[3:6], place)), abs=0.02 * v[0])


@pytest.mark.parametrize(("name", "stem"), [("cbi", "cbi"), ("dreamer", "dreamer"), ("dreamer", "dreamer_rollers")])
def test_plant_starts_at_the_robots_home(name: str, stem: str) -> None:
    robot = hqp.robots.load(name)
    q, v = Plant(robot, stem).reset()
    np.testing.assert_allclose(q, robot.home, rtol=0, atol=1e-12)
    assert not v.any()


# ---------------------------------------------------------------------------------------- forces and ground


def test_push_changes_the_momentum(box: Path) -> None:
    robot = hqp.robots.load(box)
    plant = Plant(robot, box, terrain=None)
    plant.reset(free(2.0))
    force, moment = np.array([4.0, -2.0, 3.0 * GRAVITY + 1.0]), np.array([0.01, 0.02, -0.03])
    plant.push("box", force, moment)
    plant.step(np.zeros(0), steps=50)
    expected = np.concatenate((force - [0, 0, 3.0 * GRAVITY], moment)) * 0.05
    np.testing.assert_allclose(plant.momentum(), expected, rtol=1e-6, atol=1e-9)
    plant.reset(free(2.0))
    plant.push("corner", np.array([0.0, 0.0, 2.0]))
    plant.step(np.zeros(0))
    kick = np.cross([0.1, 0.1, 0.05], [0, 0, 2.0]) * 1e-3
    np.testing.assert_allclose(plant.momentum()[3:], kick, rtol=0, atol=1e-8)
    plant.step(np.zeros(0))  # a push lasts one call
    np.testing.assert_allclose(plant.momentum()[3:], kick, rtol=0, atol=1e-7)
    assert plant.momentum()[2] == pytest.approx(0.002 - 2 * 3.0 * GRAVITY * 1e-3)


@pytest.mark.parametrize(("friction", "slides"), [(0.25, True), (0.5, False)])
def test_friction_on_the_ramp(box: Path, friction: float, slides: bool) -> None:
    """A box slides where tan(angle) exceeds the ground's friction, with g (sin - mu cos)."""
    angle = math.radians(20.0)
    terrain = Ramp(start=0.0, angle=angle, friction=friction)
    plant = Plant(hqp.robots.load(box), box, terrain=terrain, watched=["box"])
    normal = terrain.normal(1.0)
    where = np.array([1.0, 0.0, terrain.height(1.0)]) + 0.05 * normal
    q = free(where[2], where[0], angle)
    plant.reset(q)
    plant.step(np.zeros(0), steps=100)
    contacts = plant.contacts()
    np.testing.assert_allclose(contacts.normal[0], normal, atol=1e-3)
    if not slides:  # a sliding box rattles on its corners
        assert contacts.load[0] == pytest.approx(3.0 * GRAVITY * math.cos(angle), rel=1e-3)
    down = -np.array([math.cos(angle), 0.0, math.sin(angle)])
    speed = [plant.velocity("box")[:3] @ down]
    plant.step(np.zeros(0), steps=200)
    speed.append(plant.velocity("box")[:3] @ down)
    expected = GRAVITY * (math.sin(angle) - friction * math.cos(angle)) if slides else 0.0
    assert (speed[1] - speed[0]) / 0.2 == pytest.approx(expected, rel=0.05, abs=1e-3)


def test_ramp_geometry(box: Path) -> None:
    """The formulas match the ground that a ray from above hits."""
    terrain = Ramp(start=0.35, angle=math.radians(12.0), top=0.3)
    plant = Plant(hqp.robots.load(box), box, terrain=terrain)
    plant.reset(free(5.0, -3.0))
    for x in (-1.0, 0.3, 0.36, 0.7, 1.2, terrain.end - 0.01, terrain.end + 0.01, 3.0):
        hit, normal = np.zeros(1, np.int32), np.zeros(3)
        origin, down = np.array([x, 0.4, 3.0]), np.array([0.0, 0.0, -1.0])
        distance = mujoco.mj_ray(plant.model, plant.data, origin, down, None, 1, -1, hit, normal)
        assert 3.0 - distance == pytest.approx(terrain.height(x), abs=1e-9)
        np.testing.assert_allclose(normal, terrain.normal(x), atol=1e-9)
    assert terrain.height(terrain.end + 1.0) == pytest.approx(0.3)
    assert Ramp(angle=0.1).height(10.35) == pytest.approx(10.0 * math.tan(0.1))
    assert Plane().height(3.0) == 0.0


def test_dreamer_feels_the_ramp_through_its_front_wheel() -> None:
    """Half on the slope: the front wheel has the slope's normal, the others the plane's."""
    robot = hqp.robots.load("dreamer")
    terrain = Ramp(start=0.10, angle=math.radians(7.0))
    for stem in ("dreamer", "dreamer_rollers"):
        plant = Plant(robot, stem, terrain=terrain)
        q0 = np.array(robot.home)
        pitch = -math.atan2(terrain.height(0.24), 0.36)
        q0[3:7] = [0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2)]
        q0[2] += 0.015
        plant.reset(q0)
        hold(robot, plant, q0, 0.4)
        contacts = plant.contacts()
        assert (contacts.load > 50.0).all()
        np.testing.assert_allclose(contacts.normal[0], terrain.normal(0.3), atol=0.03)
        np.testing.assert_allclose(contacts.normal[1:], [[0, 0, 1]] * 2, atol=1e-3)


# ---------------------------------------------------------------------------------------- commands


def test_torque_in_the_robots_order(hopper: Path) -> None:
    """Without contact a torque accelerates by Pinocchio's forward dynamics, for any order of the file's actuators."""
    robot = hqp.robots.load(hopper)
    plant = Plant(robot, hopper, timestep=1e-5)
    q = pin.neutral(robot.model)
    q[2] = 3.0
    plant.reset(q)
    assert set(plant.joint_names) == {"hip", "leg", "shoulder"}
    torque = np.array([{"hip": 3.0, "leg": 7.0, "shoulder": -2.0}[name] for name in plant.joint_names])
    plant.step(torque)
    np.testing.assert_array_equal(plant.torque, torque)
    generalised = np.zeros(robot.nv)
    generalised[robot.actuated] = torque
    acceleration = pin.aba(robot.model, robot.model.createData(), q, np.zeros(robot.nv), generalised)
    np.testing.assert_allclose(plant.state()[1] / 1e-5, acceleration, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("name", ["cbi", "dreamer"])
def test_a_link_to_a_robots_folder_gives_the_same_plant(name: str, tmp_path: Path) -> None:
    """A package may be installed through links: gains, armatures and groups come from the file behind them."""
    source = Path(str(hqp.robots.load(name).source))
    (tmp_path / "linked").symlink_to(source.resolve().parent)
    plain = Plant(hqp.robots.load(source.resolve(), floating=True))
    linked = Plant(hqp.robots.load(tmp_path / "linked" / source.name, floating=True))
    assert plain.servo == linked.servo
    assert plain.watched == linked.watched
    np.testing.assert_array_equal(plain.model.dof_armature, linked.model.dof_armature)


def test_effort_limits_come_from_the_file(hopper: Path) -> None:
    robot = hqp.robots.load(hopper)
    plant = Plant(robot, hopper)
    plant.reset()
    plant.step(np.full(3, 1e3))
    limit = {"hip": 40.0, "leg": 1e3, "shoulder": 15.0}  # gear 20 times control 2; none; the force range
    np.testing.assert_allclose(plant.torque, [limit[name] for name in plant.joint_names])
    servo = Plant(robot, hopper, actuation="position", servo=Servo(other=1e5))
    servo.reset()
    servo.step(np.ones(3) * 0.1, np.zeros(3))
    wanted = {"hip": 40.0, "shoulder": 15.0}
    for name, torque in zip(servo.joint_names, servo.torque, strict=True):
        assert name == "leg" or torque == pytest.approx(wanted[name])
    native = Plant(robot, hopper, actuation="native")
    native.reset()
    order = [("shoulder", 0.1), ("hip", 1.0), ("leg", 0.01)]
    command = np.array([dict(order)[name] for name in native.joint_names])
    native.step(command)
    expected = {"shoulder": 50 * 0.1, "hip": 1.0, "leg": 900 * 0.01}
    for name, torque in zip(native.joint_names, native.torque, strict=True):
        assert torque == pytest.approx(expected[name])


def test_servo_follows_a_moving_reference(hopper: Path) -> None:
    """With the reference's rate a heavily damped servo has no lag, without it one of damping_time."""
    text = hopper.read_text().replace('<freejoint name="floating"/>', "")
    path = hopper.with_name("fixed_hopper.xml")
    path.write_text(text)
    robot = hqp.robots.load(path)
    assert not robot.floating
    errors = []
    for feedforward in (True, False):
        plant = Plant(robot, path, actuation="position", servo=Servo(other=4000.0, damping_time=0.05))
        plant.model.opt.gravity[:] = 0.0
        for k in range(1000):
            goal = np.full(3, 0.1 * k * 1e-3)
            plant.step(goal, np.full(3, 0.1) if feedforward else None)
        errors.append(goal[1] - plant.state()[0][robot.joints(plant.joint_names[1])[0]])
    assert abs(errors[0]) < 2e-3
    assert errors[1] - errors[0] == pytest.approx(0.1 * 0.05, rel=0.05)


def test_delay_counts_steps(hopper: Path) -> None:
    robot = hqp.robots.load(hopper)
    plant = Plant(robot, hopper, delay=0.004)
    plant.reset()
    seen = []
    for k in range(8):
        plant.step(np.full(3, k + 1.0))
        seen.append(plant.torque[0])
    assert seen == [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_run_twice_gives_the_same_numbers() -> None:
    robot = hqp.robots.load("dreamer")
    noise = Sensors(gyro=Noise(0.1), angle=Noise(0.01))
    ends = []
    for _ in range(2):
        plant = Plant(robot, "dreamer_rollers", sensors=noise, seed=4)
        for _ in range(2):  # a second plant, and the same one again
            plant.reset()
            for k in range(100):
                plant.step(np.full(12, 0.1 * math.sin(k)))
            ends.append(np.concatenate((*plant.state(), plant.measure().gyro, plant.measure().q)))
    for end in ends[1:]:
        np.testing.assert_array_equal(end, ends[0])


# ---------------------------------------------------------------------------------------- sensors


def test_perfect_sensors_read_the_truth() -> None:
    robot = hqp.robots.load("dreamer")
    plant = Plant(robot)
    rng = np.random.default_rng(1)
    q = np.array(robot.home)
    q[2] += 1.0
    q[3:7] = pin.Quaternion(pin.SE3.Random().rotation).coeffs()
    v = rng.normal(size=robot.nv)
    plant.reset(q, v)
    reading = plant.measure()
    assert reading.time == 0.0
    assert abs(reading.q[3:7] @ q[3:7]) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(np.delete(reading.q, slice(3, 7)), np.delete(q, slice(3, 7)), atol=1e-12)
    np.testing.assert_allclose(reading.v, v, atol=1e-12)
    np.testing.assert_allclose(reading.gyro, v[3:6], atol=1e-12)
    np.testing.assert_allclose(reading.rotation, plant.place("imu")[1], atol=1e-12)


def test_accelerometer() -> None:
    """At rest it measures g upwards in its own axes; in free fall zero."""
    robot = hqp.robots.load("cbi")
    plant = Plant(robot, actuation="position")
    q, _ = plant.reset()
    index = [robot.model.joints[robot.model.getJointId(n)].idx_q for n in plant.joint_names]
    for _ in range(300):
        plant.step(q[index], steps=2)
    reading = plant.measure()
    np.testing.assert_allclose(reading.rotation @ reading.accelerometer, [0, 0, GRAVITY], atol=0.05)
    high = np.array(q)
    high[2] += 5.0
    plant.reset(high)
    plant.step(q[index], steps=3)
    assert np.linalg.norm(plant.measure().accelerometer) < 0.3


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_readings_of_the_accelerometer_add_up_to_the_velocity(seed: int) -> None:
    """Under servos, too, whose damping is part of an implicit step: the sensor of MuJoCo reads a fifth more there."""
    rng = np.random.default_rng(seed)
    robot = hqp.robots.load(("g1", "cbi", "talos")[seed % 3])
    servo = Servo(other=500.0, damping_time=0.03)
    plant = Plant(robot, actuation="position" if seed % 2 else "torque", servo=servo, watched=())
    q, _ = plant.reset()
    index = [robot.model.joints[robot.model.getJointId(n)].idx_q for n in plant.joint_names]
    middle = q[index] if seed % 2 else np.zeros(len(index))
    size, rate = (0.1, rng.uniform(3.0, 9.0)) if seed % 2 else (10.0, 20.0)
    phases, gained, steps = rng.uniform(0.0, 6.0, len(index)), np.zeros(3), int(rng.integers(1, 5))
    site = plant.model.site("plant_imu").name
    start = plant.velocity(site)[:3]
    for k in range(100):
        plant.step(middle + size * np.sin(rate * k * steps * plant.timestep + phases), steps=steps)
        reading = plant.measure()
        gained += steps * plant.timestep * (reading.rotation @ reading.accelerometer - [0.0, 0.0, GRAVITY])
    change = plant.velocity(site)[:3] - start
    np.testing.assert_allclose(gained, change, atol=0.05 * np.linalg.norm(change) + 5e-3)


def test_noise_and_bias() -> None:
    robot = hqp.robots.load("dreamer")
    pitch = math.radians(0.5)
    sensors = Sensors(
        orientation=Noise(0.0, (0.0, pitch, 0.0)),
        gyro=Noise(0.02, (0.1, 0.0, -0.1)),
        accelerometer=Noise(0.3),
        angle=Noise(1e-3, 0.01),
        rate=Noise(0.05),
        force=Noise(2.0),
    )
    plant = Plant(robot, sensors=sensors, seed=7)
    q, v = plant.reset()
    plant.step(np.zeros(12), steps=5)
    q, v = plant.state()
    n = 2000
    readings = [plant.measure() for _ in range(n)]
    gyro = np.array([r.gyro for r in readings]) - v[3:6]
    np.testing.assert_allclose(gyro.mean(axis=0), [0.1, 0, -0.1], atol=4 * 0.02 / math.sqrt(n))
    np.testing.assert_allclose(gyro.std(axis=0), 0.02, rtol=0.1)
    joints = np.array([r.q[7:] for r in readings]) - q[7:]
    np.testing.assert_allclose(joints.mean(axis=0), 0.01, atol=5e-3 / math.sqrt(n))
    np.testing.assert_allclose(joints.std(axis=0), 1e-3, rtol=0.1)
    np.testing.assert_allclose(np.array([r.v[6:] for r in readings]).std(axis=0), 0.05, rtol=0.1)
    np.testing.assert_allclose(np.array([r.accelerometer for r in readings]).std(axis=0), 0.3, rtol=0.1)
    np.testing.assert_allclose(np.array([r.contacts.force[0] for r in readings]).std(axis=0), 2.0, rtol=0.1)
    true = pin.Quaternion(q[3:7]).matrix()
    read = pin.Quaternion(readings[0].q[3:7]).matrix()
    np.testing.assert_allclose(pin.log3(true.T @ read), [0, pitch, 0], atol=1e-9)
    np.testing.assert_array_equal(readings[0].q[:3], q[:3])
    np.testing.assert_array_equal(readings[0].v[:3], v[:3])


@pytest.mark.long
def test_armature_and_edit() -> None:
    """The control model can use the plant's armature; the plant can use another one."""
    robot = hqp.robots.load("cbi", rotors=True)
    data = robot.model.createData()
    pin.crba(robot.model, data, np.array(robot.home))
    M = np.triu(data.M) + np.triu(data.M, 1).T
    bare = Plant(robot, armature={}).mass_matrix()
    extra = np.diag(M - bare)
    np.testing.assert_allclose(extra[:6], 0.0, atol=1e-10)
    np.testing.assert_allclose(extra[6:], 0.01, atol=1e-10)
    np.testing.assert_allclose(Plant(robot).mass_matrix(), M, rtol=0, atol=1e-10)
    own = np.diag(Plant(robot, armature={"legs": 0.3}).mass_matrix() - bare)
    np.testing.assert_allclose(own[robot.joints("legs")], 0.3, atol=1e-10)
    np.testing.assert_allclose(own[robot.joints("arms")], 0.0, atol=1e-10)

    def payload(spec: Any) -> None:
        body = spec.body("r_hand").add_body(name="load", pos=[0, 0, -0.136])
        body.mass, body.inertia, body.explicitinertial = 1.0, [1e-4] * 3, True

    heavier = Plant(robot, edit=payload)
    assert mujoco.mj_getTotalmass(heavier.model) == pytest.approx(88.0, abs=5e-4)


def test_scene_and_hand() -> None:
    plant = Plant(hqp.robots.load("dreamer"), terrain=Ramp(top=0.2))
    names = {plant.model.camera(i).name for i in range(plant.model.ncam)}
    assert {"side", "front", "corner", "top"} <= names
    plant.move_hand(np.array([1.0, 0.0, 1.0]))
    plant.step(np.zeros(12))
    np.testing.assert_allclose(plant.place("human_hand")[0], [1.0, 0.0, 1.0])
    hand = plant.model.body("human_hand").id
    geoms = plant.model.geom_bodyid == hand
    assert geoms.any()
    assert not plant.model.geom_contype[geoms].any()
    assert not plant.model.geom_conaffinity[geoms].any()


# ---------------------------------------------------------------------------------------- bad input


def test_errors(hopper: Path, box: Path, tmp_path: Path) -> None:
    robot = hqp.robots.load("dreamer")
    with pytest.raises(ModelError, match="no MJCF 'nowhere'"):
        Plant(robot, "nowhere")
    with pytest.raises(JointNotFound, match="torso_yaw"):
        Plant(robot, box)
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody><body></worldbody></mujoco>")
    with pytest.raises(ModelError, match="could not be read"):
        Plant(robot, broken)
    with pytest.raises(FrameNotFound, match="imu"):
        Plant(robot, imu="imo")
    with pytest.raises(ModelError, match="not fixed to the root body"):
        Plant(robot, imu="hand")
    with pytest.raises(FrameNotFound, match="wheel_1"):
        Plant(robot, watched=["wheel_9"])
    with pytest.raises(JointNotFound, match="torso_hip"):
        Plant(robot, armature={"torso_hib": 0.1})
    with pytest.raises(DeclarationError, match=r"unknown actuation .*allowed: torque, position, native"):
        Plant(robot, actuation="velocity")  # type: ignore[arg-type]
    with pytest.raises(DeclarationError, match=r"no servos; allowed: servo=Servo"):
        Plant(robot.model, "dreamer", actuation="position")
    with pytest.raises(DeclarationError, match="timestep"):
        Plant(robot, timestep=0.0)
    plant = Plant(robot)
    with pytest.raises(DeclarationError, match=r"shape \(12,\)"):
        plant.step(np.zeros(13))
    with pytest.raises(DeclarationError, match="finite"):
        plant.step(np.full(12, np.nan))
    with pytest.raises(DeclarationError, match="rate needs position servos"):
        plant.step(np.zeros(12), np.zeros(12))
    with pytest.raises(FrameNotFound, match="wheel_0"):
        plant.push("wheel_o", np.zeros(3))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Ramp(angle=0.0),
        lambda: Ramp(angle=math.radians(80)),
        lambda: Ramp(top=0.0),
        lambda: Plane(friction=-0.1),
        lambda: Plane(friction=math.nan),
        lambda: Plane(solref=(0.0, 1.0)),
        lambda: Noise(-1.0),
        lambda: Noise(0.0, math.inf),
        lambda: Servo(kp={"L_HFE": -1.0}),
        lambda: Servo(damping_time=math.nan),
    ],
)
def test_bad_declarations(make: Any) -> None:
    with pytest.raises(DeclarationError):
        make()


@pytest.mark.long
def test_missing_mujoco_names_the_pip_line() -> None:
    program = (
        "import sys; sys.modules['mujoco'] = None\n"
        "import hqp.robots\n"
        "from hqp.errors import HqpError\n"
        "try:\n    import hqp.robots.on_mujoco\n"
        "except HqpError as error:\n    print(error)\n"
    )
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=root, check=True)
    assert "pip install 'hqp[mujoco]'" in done.stdout


@pytest.mark.long
def test_robots_do_not_import_mujoco() -> None:
    program = "import sys, hqp.robots; hqp.robots.load('cbi'); print('mujoco' in sys.modules)"
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=root, check=True)
    assert done.stdout.strip() == "False"


LEG = """<mujoco><worldbody><body name="base" pos="0 0 2"><freejoint/><geom type="sphere" size="0.1"/>
<body name="shank" pos="0 0 -0.5"><joint name="knee" axis="0 1 0"/>
<geom name="shin" type="box" size="0.02 0.02 0.2" pos="0 0 0.2"/>
<body name="cross"><joint name="pitch" axis="0 1 0"/><inertial pos="0 0 0" mass="0.1" diaginertia="1 1 1"/>
<body name="foot"><joint name="roll"/><geom name="sole" type="box" size="0.1 0.05 0.02" pos="0 0 {middle}"/></body>
</body></body></body></worldbody><contact><pair geom1="shin" geom2="sole"/></contact></mujoco>"""


@pytest.mark.parametrize("depth", [1e-3, 0.01, 0.04])
def test_a_foot_does_not_bear_what_its_own_shank_presses_on_it(tmp_path: Path, depth: float) -> None:
    """In the air, where a shank that touches it by the file overlaps it beyond an ankle of two joints."""
    (tmp_path / "leg.xml").write_text(LEG.format(middle=depth - 0.02))
    plant = Plant(hqp.robots.load(tmp_path / "leg.xml"), watched=["foot"])
    for _ in range(3):
        plant.step(np.zeros(len(plant.joint_names)))
        assert plant.data.ncon
        assert plant.contacts().load == pytest.approx([0.0])
