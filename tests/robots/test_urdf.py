"""URDF files: errors, warnings, mimic joints, user frames and shapes."""

from __future__ import annotations

import gc
import os
import weakref
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.robots
from hqp import Level, Stack
from hqp.errors import DeclarationError, FrameNotFound, ModelError, ModelWarning
from hqp.robots import Robot, geometry
from hqp.robots.surface import surface
from hqp.tasks import JointCoupling, Position, Posture

LINK = """<link name="{name}"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/>
<inertia ixx="{ixx}" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.1"/><geometry><box size="0.1 0.1 0.2"/></geometry></collision></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 0.2"/><axis xyz="{axis}"/>{limit}{mimic}</joint>"""
LIMIT = '<limit lower="-1" upper="1.5" velocity="2" effort="30"/>'


def write(folder: Path, *, mass: str = "1", ixx: str = "0.02", axis: str = "0 1 0", limit: str = LIMIT) -> Path:
    """Three links and two joints; faults go to the second link or joint ``elbow``."""
    path = folder / "arm.urdf"
    base = LINK.format(name="base", mass=5, ixx=0.02)
    links = [base, LINK.format(name="upper", mass=1, ixx=0.02), LINK.format(name="fore", mass=mass, ixx=ixx)]
    joints = [
        JOINT.format(
            name="shoulder", kind="revolute", parent="base", child="upper", axis="0 0 1", limit=LIMIT, mimic=""
        ),
        JOINT.format(name="elbow", kind="revolute", parent="upper", child="fore", axis=axis, limit=limit, mimic=""),
    ]
    path.write_text(f'<robot name="arm">{"".join(links + joints)}</robot>')
    return path


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ({"mass": "nan"}, r"link 'fore'.*not finite"),
        ({"mass": "-1"}, r"link 'fore' has a negative mass"),
        ({"ixx": "-4", "axis": "1 0 0"}, r"link 'fore' has a negative principal moment.*inertia negative"),
        ({"axis": "0 0 0"}, r"joint 'elbow'.*zero vector"),
        ({"limit": '<limit lower="1" upper="-1" velocity="2" effort="30"/>'}, r"joint 'elbow'.*swapped"),
        ({"limit": '<limit lower="0" upper="inf" velocity="2" effort="30"/>'}, r"joint 'elbow'.*not finite"),
        ({"limit": '<limit lower="0" upper="1" velocity="-2" effort="30"/>'}, r"joint 'elbow' has a negative limit"),
    ],
    ids=["mass-nan", "mass-negative", "inertia-negative", "axis-zero", "limits-swapped", "limit-inf", "speed-negative"],
)
def test_refused_by_name(tmp_path: Path, fault: dict[str, str], told: str) -> None:
    with pytest.raises(ModelError, match=told):
        hqp.robots.load(write(tmp_path, **fault), floating=False)


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ({"ixx": "0.2"}, r"link 'fore'.*no rigid body has this inertia"),
        (
            {"limit": '<limit lower="-1" upper="1" velocity="0" effort="30"/>'},
            r"velocity limit.*joint not limited: elbow",
        ),
        ({"limit": '<limit lower="-1" upper="1" velocity="1" effort="0"/>'}, r"effort limit.*joint not limited: elbow"),
        (
            {"limit": '<limit lower="0" upper="0" velocity="1" effort="3"/>'},
            r"position limit.*joint not limited: elbow",
        ),
        ({"limit": '<limit lower="0.3" upper="0.3" velocity="1" effort="3"/>'}, r"joint 'elbow'.*both 0.3"),
    ],
    ids=["triangle", "speed-zero", "effort-zero", "limits-zero", "limits-equal"],
)
def test_warned_of_by_name(tmp_path: Path, fault: dict[str, str], told: str) -> None:
    with pytest.warns(ModelWarning, match=told):
        robot = hqp.robots.load(write(tmp_path, **fault), floating=False)
    assert robot.source == tmp_path / "arm.urdf"
    if "0.3" in fault.get("limit", ""):
        assert robot.state().angles[1] == 0.3  # home is inside the limits


def test_a_joint_that_moves_no_mass_is_told(tmp_path: Path) -> None:
    """Its row of the joint-space inertia is zero; a session at torque level refuses it."""
    path = write(tmp_path, mass="0", ixx="0")
    path.write_text(path.read_text().replace('ixx="0" iyy="0.02" izz="0.01"', 'ixx="0" iyy="0" izz="0"'))
    with pytest.warns(ModelWarning, match=r"no mass moves with 'elbow'"):
        hqp.robots.load(path, floating=False)


def test_robot_of_one_joint(tmp_path: Path) -> None:
    path = tmp_path / "one.urdf"
    joint = JOINT.format(name="j", kind="revolute", parent="base", child="arm", axis="0 1 0", limit=LIMIT, mimic="")
    links = LINK.format(name="base", mass=1, ixx=0.02) + LINK.format(name="arm", mass=1, ixx=0.02)
    path.write_text(f"<robot name='one'>{links}{joint}</robot>")
    robot = hqp.robots.load(path, floating=False)
    for formulation in (hqp.Velocity(), hqp.Acceleration(), hqp.Torque()):
        session = hqp.Controller(Stack(Level(Posture())), formulation).session(robot, dt=0.002)
        tick = session.step(robot.state(), Posture().at([0.3]))
        assert tick.status is hqp.Status.OPTIMAL


def with_fingers(folder: Path) -> Path:
    path, sides = folder / "gripper.urdf", ("left", "right")
    links = [LINK.format(name=n, mass=1, ixx=0.02) for n in ("base", "hand", *sides)]
    joints = [
        JOINT.format(name="arm", kind="revolute", parent="base", child="hand", axis="0 1 0", limit=LIMIT, mimic="")
    ]
    for side in sides:
        mimic = '<mimic joint="left_finger" multiplier="-0.5" offset="0.01"/>' if side == "right" else ""
        fields = {"name": f"{side}_finger", "kind": "prismatic", "parent": "hand", "child": side}
        joints.append(JOINT.format(**fields, axis="0 1 0", limit=LIMIT, mimic=mimic))
    path.write_text(f'<robot name="gripper">{"".join(links + joints)}</robot>')
    return path


@pytest.mark.parametrize(
    "formulation", [hqp.Velocity(), hqp.Acceleration(), hqp.Torque()], ids=lambda f: type(f).__name__
)
def test_mimic_joint_is_bound_by_itself(tmp_path: Path, formulation: hqp.Formulation) -> None:
    robot = hqp.robots.load(with_fingers(tmp_path), floating=False)
    assert robot.joint_names == ("arm", "left_finger")
    assert "coupled by the file: right_finger_left_finger" in str(robot)
    posture = Posture(joints=("arm", "left_finger"))
    session = hqp.Controller(Stack(Level(posture)), formulation).session(robot, dt=0.002)
    q, v = robot.home, np.zeros(3)
    for _ in range(1000):
        q, v = session.step(robot.state(q, v), posture.at([0.5, 0.2])).advance()
    angles = robot.state(q).angles
    np.testing.assert_allclose(angles[robot.joints(("arm", "left_finger"))], [0.5, 0.2], atol=1e-3)
    assert angles[robot.joints("right_finger")[0]] == pytest.approx(-0.5 * 0.2 + 0.01, abs=1e-3)


def test_coupling_that_the_stack_has_is_not_added_again(tmp_path: Path) -> None:
    robot = hqp.robots.load(with_fingers(tmp_path), floating=False)
    own = JointCoupling({"left_finger": 1.0, "right_finger": 2.0}, offset=0.02, name="mine")
    stack = Stack(Level(Posture()), subject_to=[own])
    assert hqp.Controller(stack, hqp.Velocity()).session(robot, dt=0.002).stack == stack


def test_mimic_of_an_unknown_joint_is_left_free(tmp_path: Path) -> None:
    path = with_fingers(tmp_path)
    path.write_text(path.read_text().replace('mimic joint="left_finger"', 'mimic joint="left_thumb"'))
    with pytest.warns(ModelWarning, match="'right_finger' mimics 'left_thumb'"):
        robot = hqp.robots.load(path, floating=False)
    assert robot.couplings == ()


def test_frame_of_ones_own(tmp_path: Path) -> None:
    robot = hqp.robots.load(write(tmp_path), floating=False)
    placement = pin.SE3(pin.utils.rotate("x", 0.3), np.array([0.0, 0.1, 0.2]))
    tooled = robot.with_frame("tool", "fore", placement)
    assert "tool" not in robot.frame_names
    q = np.array([0.4, 0.7])
    host, state = robot.state(q).position("fore"), tooled.state(q)
    expected = host + robot.state(q).rotation("fore") @ placement.translation
    np.testing.assert_allclose(state.position("tool"), expected, atol=1e-14)
    twice = tooled.with_frame("tip", "tool", [0.0, 0.0, 0.05])
    np.testing.assert_allclose(np.linalg.norm(twice.state(q).position("tip") - expected), 0.05)
    session = hqp.Controller(Stack(Level(Position(frame="tip", axes="xy"))), hqp.Velocity()).session(twice, dt=0.01)
    assert session.step(twice.state(q)).status is hqp.Status.OPTIMAL
    with pytest.raises(FrameNotFound, match="forr"):
        robot.with_frame("tool", "forr")
    with pytest.raises(DeclarationError, match="duplicate frame name"):
        tooled.with_frame("tool", "fore")
    with pytest.raises(DeclarationError, match="no placement"):
        robot.with_frame("tool", "fore", [1.0, 2.0])


def test_shapes_are_kept(tmp_path: Path) -> None:
    robot = hqp.robots.load(write(tmp_path), floating=False)
    assert [g.name for g in robot.geometry.geometryObjects] == ["base_0", "upper_0", "fore_0"]
    assert robot.visual.ngeoms == 0
    bare = Robot(pin.buildSampleModelManipulator())
    with pytest.raises(ModelError, match="has no file"):
        _ = bare.geometry


def test_mesh_that_is_missing_is_told(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace('<box size="0.1 0.1 0.2"/>', '<mesh filename="package://no/arm.stl"/>'))
    robot = hqp.robots.load(path, floating=False)
    with pytest.raises(ModelError, match=r"collision shape.*no/arm.stl"):
        _ = robot.geometry


def test_joints_of_several_axes(tmp_path: Path) -> None:
    """Planar, floating and spherical joints inside the tree: states, rows by finite differences, sessions."""
    model = pin.buildSampleModelHumanoid()  # its root is a free flyer
    wrist = model.addJoint(model.njoints - 1, pin.JointModelSpherical(), pin.SE3.Random(), "wrist")
    model.appendBodyToJoint(wrist, pin.Inertia.Random(), pin.SE3.Random())
    tip = model.addJoint(wrist, pin.JointModelPlanar(), pin.SE3.Random(), "slider")
    model.appendBodyToJoint(tip, pin.Inertia.Random(), pin.SE3.Random())
    model.addFrame(pin.Frame("tip", tip, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    robot = Robot(model)
    assert robot.joints("wrist").size == 3
    assert robot.joint_name(robot.joints("slider")[1]) == "slider[1]"
    rng = np.random.default_rng(1)
    q = robot.integrate(robot.home, rng.uniform(-0.5, 0.5, robot.nv), 1.0)
    J = robot.state(q).jacobian("tip").copy()
    h = 1e-6
    for i in range(robot.nv):
        ends = [robot.state(robot.integrate(q, np.eye(robot.nv)[i], s * h)).position("tip") for s in (1, -1)]
        np.testing.assert_allclose((ends[0] - ends[1]) / (2 * h), J[:3, i], atol=1e-8)
    task = Position(frame="tip")
    session = hqp.Controller(Stack(Level(task)), hqp.Velocity()).session(robot, dt=0.01)
    goal = robot.state(q).position("tip") + 0.05
    for _ in range(200):
        q, _ = session.step(robot.state(q), task.at(goal)).advance()
    np.testing.assert_allclose(robot.state(q).position("tip"), goal, atol=1e-3)


def test_pinocchios_own_mimic_joints_are_refused(tmp_path: Path) -> None:
    model = pin.buildModelFromUrdf(str(with_fingers(tmp_path)), mimic=True)
    with pytest.raises(ModelError, match=r"right_finger.*mimic=True"):
        Robot(model)


def test_a_prefix_that_the_file_does_not_declare_is_read_over(tmp_path: Path) -> None:
    """Drake's attributes and elements occur in files of several packages; URDF readers ignore them."""
    path = write(tmp_path, limit=LIMIT.replace("lower", 'drake:acceleration="2.5" lower'))
    path.write_text(path.read_text().replace("</robot>", "<drake:group name='a'><drake:member/></drake:group></robot>"))
    robot = hqp.robots.load(path, floating=False)
    assert robot.upper[robot.joints("elbow")[0]] == 1.5


def test_a_root_that_the_file_frees_is_freed_once(tmp_path: Path) -> None:
    path = write(tmp_path)
    joint = '<joint name="free" type="floating"><parent link="world"/><child link="base"/></joint>'
    path.write_text(path.read_text().replace("</robot>", f'<link name="world"/>{joint}</robot>'))
    for floating in (None, True):
        robot = hqp.robots.load(path, floating=floating)
        assert robot.floating
        assert robot.nv == 8
    with pytest.raises(DeclarationError, match="'free'"):
        hqp.robots.load(path, floating=False)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('type="revolute"', 'type="spherical"', r"joint 'shoulder' is of type 'spherical'"),
        ('<origin xyz="0 0 0.2"/>', '<origin xyz="0 0 0.2 0"/>', r"xyz='0 0 0.2 0' has 4 numbers"),
        ('<origin xyz="0 0 0.2"/>', '<origin rpy="1, 2 3"/>', r"rpy='1, 2 3' is not a number"),
    ],
)
def test_what_the_reader_would_not_name_is_named(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ModelError, match=told):
        hqp.robots.load(path)


def write_mesh(path: Path, size: float) -> None:
    """Write a corner of a cube as an STL of text."""
    corners = size * np.vstack((np.zeros(3), np.eye(3)))
    faces = [
        "facet normal 0 0 0 outer loop "
        + " ".join("vertex {:g} {:g} {:g}".format(*corners[k]) for k in face)
        + " endloop endfacet"
        for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    ]
    path.write_text("\n".join(["solid corner", *faces, "endsolid corner"]))


def largest(robot: Robot) -> float:
    return max(
        float(np.max(surface(item).placed(item.placement.inverse()).points()))
        for item in robot.geometry.geometryObjects
    )


@pytest.mark.long
def test_robots_of_one_file_share_meshes_as_long_as_there_are_any(tmp_path: Path) -> None:
    path, mesh = write(tmp_path), tmp_path / "corner.stl"
    path.write_text(path.read_text().replace('<box size="0.1 0.1 0.2"/>', f'<mesh filename="{mesh}"/>'))
    write_mesh(mesh, 0.2)
    one, two = hqp.robots.load(path), hqp.robots.load(path)
    loader = weakref.ref(one.geometry.loader)
    assert two.geometry.loader is two.copy().geometry.loader is loader()
    assert largest(one) == largest(two) == pytest.approx(0.2)
    write_mesh(mesh, 0.3)  # replaced by another mesh
    os.utime(mesh, (mesh.stat().st_atime, mesh.stat().st_mtime + 5.0))
    assert largest(hqp.robots.load(path)) == pytest.approx(0.3)
    assert largest(two) == pytest.approx(0.2)
    del one, two
    gc.collect()
    assert loader() is None
    assert path not in geometry._LOADERS


def test_angles_given_as_q_are_told_how_to_become_one() -> None:
    """Continuous joints have two numbers in q."""
    robot = hqp.robots.load("kinova")
    angles = np.zeros(robot.nv)
    for give in (robot.set_home, robot.state):
        with pytest.raises((DeclarationError, ModelError), match=r"configuration\(angles\)"):
            give(angles)
    robot.set_home(robot.configuration(angles))
