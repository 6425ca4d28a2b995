"""MJCF through MuJoCo's compiled model: supported parts, refused parts, notes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import hqp.robots
from hqp import PD, Level, P, Stack
from hqp.errors import DeclarationError, ModelError, ModelWarning
from hqp.robots import agreement, from_mjcf
from hqp.robots.model_map import ModelMap
from hqp.robots.mujoco_extra import full_inertia
from hqp.robots.on_mujoco import Plant, Servo
from hqp.tasks import Ball, Posture

pytestmark = pytest.mark.filterwarnings("ignore:arm.xml:hqp.errors.ModelWarning")
DATA = Path(__file__).parents[1] / "data" / "mjcf"
FILES = sorted(DATA.glob("*.xml"))
EVERY = {"mobile_arm": ("cube", "base", "post"), "two_legs": ("pelvis", "ball"), "arm": ("stand",)}
"""Roots of all moving bodies, by file."""


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_frames_mass_matrix_and_bias_are_mujocos(path: Path) -> None:
    """In addition to the check at load: position of each body, M and the bias forces at states of every joint."""
    robot, simulated = hqp.robots.load(path, root=EVERY[path.stem]), mujoco.MjModel.from_xml_path(str(path))
    assert robot.nv == simulated.nv
    data, convert = mujoco.MjData(simulated), ModelMap(simulated, robot)
    rng = np.random.default_rng(3)
    for _ in range(5):
        q = robot.integrate(robot.home, rng.uniform(-1, 1, robot.nv), 1.0)
        v = rng.normal(size=robot.nv)
        data.qpos[:], data.qvel[:] = convert.to_mujoco(q, v)
        mujoco.mj_forward(simulated, data)
        state = robot.state(q, v)
        for b in range(1, simulated.nbody):
            name = simulated.body(b).name
            if name and name not in [simulated.site(s).name for s in range(simulated.nsite)]:
                np.testing.assert_allclose(state.position(name), data.xpos[b], atol=1e-12)
                np.testing.assert_allclose(state.rotation(name).ravel(), data.xmat[b], atol=1e-12)
        for s in range(simulated.nsite):
            np.testing.assert_allclose(state.position(simulated.site(s).name), data.site_xpos[s], atol=1e-12)
        full = full_inertia(simulated, data)
        B = convert.tangent(data.qpos)
        np.testing.assert_allclose(state.mass_matrix(), B.T @ full @ B, atol=1e-11)
        # bias forces of MuJoCo at zero acceleration in its own coordinates: Pinocchio's have M dB/dt v more
        h = 1e-6
        later = robot.integrate(q, v, h), robot.integrate(q, v, -h)
        turn = [convert.tangent(convert.to_mujoco(at, v)[0]) @ v for at in later]
        drift = (turn[0] - turn[1]) / (2 * h)
        expected = B.T @ (data.qfrc_bias + full @ drift)
        np.testing.assert_allclose(state.bias_force(), expected, rtol=0, atol=2e-6 * np.abs(expected).max())


def test_mobile_arm_is_taken_over() -> None:
    robot = hqp.robots.load(DATA / "mobile_arm.xml", root=EVERY["mobile_arm"])
    assert not robot.floating
    assert robot.nv == 3 + 2 + 3 + 2 + 1 + 6
    assert robot.joint_names == ("base_x", "base_y", "base_yaw", "shoulder", "lift", "left")
    assert robot.effort_limit[robot.joints("shoulder")[0]] == 40.0
    assert robot.effort_limit[robot.joints("lift")[0]] == 100.0
    assert robot.lower[robot.joints("lift")[0]] == -0.1
    assert robot.spherical == {"wrist": (robot.joints("wrist")[0], 1.2)}
    assert set(robot.configurations) == {"stand", "reach"}
    np.testing.assert_array_equal(robot.home, robot.configurations["stand"])
    angles = robot.state().angles
    assert angles[robot.joints("lift")[0]] == 0.2
    (coupling,) = robot.couplings
    assert dict(coupling.coefficients) == {"right": 1.0, "left": -1.0}
    assert coupling.offset == 0.001
    assert "coupled by the file: right_left" in str(robot)
    mocap = robot.state().position("goal")
    np.testing.assert_allclose(mocap, [0.8, 0.1, 0.6])
    assert robot.support(robot.frame("goal")).sum() == 0.0
    assert {g.name for g in robot.geometry.geometryObjects} >= {"floor", "cube", "upper", "door"}


def test_a_keyframe_is_a_configuration_by_name() -> None:
    robot = hqp.robots.load(DATA / "mobile_arm.xml")
    reach = robot.configuration("reach")
    np.testing.assert_array_equal(reach, robot.configurations["reach"])
    reach[:] = 99.0
    assert np.all(robot.configuration("reach") != 99.0)
    with pytest.raises(ModelError, match=r"mobile_arm has no configuration 'stnd'; closest: stand"):
        robot.configuration("stnd")
    with pytest.raises(DeclarationError, match=rf"shape \(3,\).*allowed: \({robot.nv},\), or a name"):
        robot.configuration(np.zeros(3))
    with pytest.raises(DeclarationError, match="no angles"):
        robot.configuration(["a"])
    with pytest.raises(ModelError, match="no configuration 'stand'; closest: none at all"):
        hqp.robots.load("cbi").configuration("stand")


GEARED = """<mujoco model="geared"><worldbody><body name="link"><joint name="turn" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02"/></body></worldbody><actuator>{}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("actuator", "limit"),
    [
        ('<motor joint="turn" gear="7" forcerange="-3 3"/>', 21.0),
        ('<motor joint="turn" gear="-7" ctrlrange="-3 3"/>', 21.0),
        ('<position joint="turn" kp="1000" gear="7" forcerange="-3 3"/>', 21.0),
        ('<general joint="turn" gear="7" gainprm="2" ctrlrange="-3 3"/>', 42.0),
        ('<general joint="turn" gear="7" gainprm="2" ctrlrange="-3 3" forcerange="-5 5"/>', 35.0),
        ('<general joint="turn" gear="7" gainprm="2" ctrlrange="-2 2" forcerange="-5 5"/>', 28.0),
    ],
    ids=["force", "control", "servo", "gain", "less by force", "less by control"],
)
def test_an_effort_limit_is_the_torque_that_mujocos_actuator_can_give(
    actuator: str, limit: float, tmp_path: Path
) -> None:
    path = tmp_path / "geared.xml"
    path.write_text(GEARED.format(actuator))
    simulated = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(simulated)
    data.ctrl[:] = 1e3
    mujoco.mj_forward(simulated, data)
    assert abs(data.qfrc_actuator[0]) == pytest.approx(limit)
    robot = hqp.robots.load(path)
    np.testing.assert_allclose(robot.effort_limit, [limit])
    for actuation in ("torque", "position"):
        plant = Plant(robot, actuation=actuation, servo=Servo(other=1e3))
        plant.step(np.array([1e3]))
        assert plant.torque[0] == pytest.approx(limit), actuation


def test_base_is_the_free_body_with_joints_and_starts_where_the_file_says() -> None:
    robot = hqp.robots.load(DATA / "two_legs.xml", root=EVERY["two_legs"])
    assert robot.floating
    assert robot.nv == 6 + 3 + 1 + 1 + 6
    np.testing.assert_allclose(robot.home[:3], [0.3, 0.1, 0.75])
    assert robot.joint_name(0) == "base"
    assert robot.support(robot.frame("left_leg"))[:6].all()
    assert not robot.support(robot.frame("ball"))[:6].any()
    assert robot.joint_names == ("hip_x", "hip_z", "left_leg_joint_2", "left_knee", "right_leg_joint")
    assert any("left_knee" in note for note in robot.notes)  # zero is below its lower limit
    assert robot.state().angles[robot.joints("left_knee")[0]] == pytest.approx(np.deg2rad(10))


def test_what_does_not_move_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "still.xml"
    path.write_text("<mujoco><worldbody><body name='table'><geom size='0.1'/></body></worldbody></mujoco>")
    with pytest.raises(ModelError, match=r"no joint .*nv = 0"):
        hqp.robots.load(path)
    path.write_text("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>")
    with pytest.raises(ModelError, match="could not be read"):
        hqp.robots.load(path)


def test_root_freed_and_fixed() -> None:
    fixed = hqp.robots.load(DATA / "arm.xml")
    free = hqp.robots.load(DATA / "arm.xml", floating=True)
    assert (fixed.floating, free.floating, free.nv) == (False, True, fixed.nv + 6)
    np.testing.assert_allclose(free.state().position("hand"), fixed.state().position("hand"), atol=1e-12)
    with pytest.raises(DeclarationError, match="root"):
        hqp.robots.load(DATA / "mobile_arm.xml", floating=True)


@pytest.mark.parametrize(
    ("equality", "why"),
    [
        ('<joint name="bend" joint1="shoulder" joint2="elbow" polycoef="0 1 0.3 0 0"/>', "polynomial of degree 2"),
        ('<weld name="bend" body1="hand" body2="target"/>', "mocap"),
        ('<weld name="bend" body1="hand" body2="cup"/>', "not the robot's"),
    ],
)
def test_an_equality_that_cannot_be_kept_is_named(equality: str, why: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body name="target" mocap="true"/><body name="cup"><freejoint/><geom size=".1"/></body>'
        '<body name="arm"><joint name="shoulder" axis="0 1 0"/><geom size=".1"/><body name="hand" pos=".3 0 0">'
        '<joint name="elbow" axis="0 1 0"/><geom size=".1"/></body></body></worldbody>'
        f'<equality>{equality}</equality><actuator><motor joint="shoulder"/></actuator></mujoco>'
    )
    with pytest.warns(ModelWarning, match="equality constraint bend") as told:
        robot = hqp.robots.load(path, **({"root": "arm"} if "cup" in equality else {}))
    assert why in str(told[0].message)
    assert not robot.couplings


def test_a_connect_is_a_closure() -> None:
    robot = hqp.robots.load(DATA / "arm.xml")
    closure = next(c for c in robot.couplings if c.name == "loop")
    assert isinstance(closure, Ball)
    mine = replace(closure, name="mine", law=P(3.0))
    names = [e.name for e in hqp.Controller(Stack(Level(Posture()), subject_to=[mine])).session(robot, 0.01).stack]
    assert "mine" in names
    assert "loop" not in names


@pytest.mark.parametrize("fault", ["mass", "axis", "anchor", "ref"])
def test_a_fault_in_the_reader_is_seen(fault: str) -> None:
    """The check at load refuses a model with another mass, axis, anchor or zero than MuJoCo's."""
    simulated = from_mjcf.compiled(DATA / "mobile_arm.xml")
    found = from_mjcf.describe(simulated, DATA / "mobile_arm.xml")
    agreement.check(found)
    model, joint = found.model, found.model.getJointId("wrist" if fault == "mass" else "shoulder")
    if fault == "mass":
        own = model.inertias[joint]
        model.inertias[joint] = pin.Inertia(1.01 * own.mass, own.lever, own.inertia)
    elif fault == "axis":
        model.jointPlacements[joint].rotation = model.jointPlacements[joint].rotation @ pin.utils.rotate("x", 0.01)
    elif fault == "anchor":
        model.jointPlacements[joint].translation += np.array([0.0, 1e-4, 0.0])
    else:
        model.jointPlacements[joint].rotation = model.jointPlacements[joint].rotation @ pin.utils.rotate("y", -0.4)
    with pytest.raises(ModelError, match="in MuJoCo"):
        agreement.check(found)


GRIPPER = """
<mujoco><compiler angle="radian" autolimits="true"/><default><geom contype="0" conaffinity="0"/>
<equality solref="0.004 1" solimp="0.9999 0.9999 0.01"/></default>
<worldbody><body name="wrist" pos="0 0 1"><joint name="wrist" axis="1 0 0"/><geom size=".05" mass="1"/>
 <body name="one" pos="0 .05 0"><joint name="one" type="{kind}" axis="0 1 0.2"/>
  <geom size=".02" mass="0.3" pos=".03 0 .08"/></body>
 <body name="two" pos="0 -.05 0"><joint name="two" type="{kind}" axis="0 -1 0.1"/>
  <geom size=".02" mass="0.4" pos=".02 0 .1"/></body>
</body></worldbody>
<tendon><fixed name="pull"><joint joint="one" coef="{a}"/><joint joint="two" coef="{b}"/></fixed></tendon>
<equality>{equality}</equality>
<actuator><motor joint="wrist" ctrlrange="-90 90"/>
 <motor name="grip" tendon="pull" gear="{gear}" ctrlrange="-9 9"/></actuator></mujoco>
"""


@pytest.mark.parametrize("seed", range(6))
def test_a_gripper_on_one_tendon_has_torques(seed: int, tmp_path: Path) -> None:
    """MuJoCo's fingers accelerate as in the program, with the tendon force of the leader's torque."""
    rng = np.random.default_rng(seed)
    a, b, gear, ratio = (float(x) for x in rng.uniform(0.3, 2.0, 4) * rng.choice([-1, 1], 4))
    equality = f'<joint joint1="two" joint2="one" polycoef="0.01 {ratio} 0 0 0"/>'
    path = tmp_path / "gripper.xml"
    kind = str(rng.choice(["hinge", "slide"]))
    path.write_text(GRIPPER.format(kind=kind, a=a, b=b, gear=gear, equality=equality))
    robot, simulated = hqp.robots.load(path), mujoco.MjModel.from_xml_path(str(path))
    assert robot.joint_names == ("wrist", "one")
    through = a + b * ratio
    assert robot.effort_limit[robot.joints("one")[0]] == pytest.approx(9.0 * abs(gear * through))
    assert any("'grip'" in note or "grip" in note for note in robot.notes)
    goal = Posture(joints=["wrist", "one"], law=PD(50.0), name="goal")
    session = hqp.Controller(Stack(Level(goal)), hqp.Torque(), deadline=np.inf).session(robot, 0.002)
    convert, data = ModelMap(simulated, robot), mujoco.MjData(simulated)
    q = robot.home
    v = np.zeros(robot.nv)
    v[robot.joints(["wrist", "one", "two"])] = 0.3, 0.2, 0.2 * ratio
    there = robot.state(q).angles[robot.joints(["wrist", "one"])] + 0.02
    tick = session.step(robot.state(q, v), goal.at(there))
    data.qpos[:], data.qvel[:] = convert.to_mujoco(q, v)
    torque = dict(zip(robot.joint_names, tick.command, strict=True))
    data.ctrl[:] = torque["wrist"], torque["one"] / (gear * through)
    mujoco.mj_forward(simulated, data)
    expected = session.program.acceleration(tick.x)  # type: ignore[attr-defined]
    found = convert.to_pinocchio(data.qpos, data.qacc)[1]
    np.testing.assert_allclose(found, expected, atol=1e-2 * float(np.abs(expected).max()))


@pytest.mark.parametrize("seed", range(6))
def test_a_tendon_is_as_strong_as_its_joints_let_it_be(seed: int, tmp_path: Path) -> None:
    """MuJoCo clips the force of the tendon on each joint: at the limit of the leader's torque it clips none."""
    rng = np.random.default_rng(seed)
    a, b, gear, ratio = (float(x) for x in rng.uniform(0.3, 2.0, 4) * rng.choice([-1, 1], 4))
    equality = f'<joint joint1="two" joint2="one" polycoef="0 {ratio} 0 0 0"/>'
    path = tmp_path / "gripper.xml"
    text = GRIPPER.format(kind="hinge", a=a, b=b, gear=gear, equality=equality)
    for name in ("one", "two"):
        most = rng.uniform(0.1, 4.0)
        text = text.replace(f'<joint name="{name}"', f'<joint name="{name}" actuatorfrcrange="-{most} {most}"')
    path.write_text(text)
    robot, simulated = hqp.robots.load(path), mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(simulated)
    most = float(robot.effort_limit[robot.joints("one")[0]])
    for share, clipped in ((0.999, False), (1.001, True)):
        force = share * most / (a + b * ratio)  # of the tendon
        data.ctrl[1] = force / gear
        mujoco.mj_forward(simulated, data)
        found = [data.qfrc_actuator[simulated.joint(name).dofadr[0]] for name in ("one", "two")]
        assert (np.abs(np.subtract(found, (a * force, b * force))).max() > 1e-9) == clipped
