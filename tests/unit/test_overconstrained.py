"""Session start warns of contacts that constrain more than the joints can follow."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack
from hqp.declare.element import Element
from hqp.declare.robot import Robot
from hqp.errors import ModelWarning
from hqp.loop.session import one_second
from hqp.search.newton import Search
from hqp.tasks import Ball, Com, EdgeContact, FixedContact, Hinge, JointLimits, PointContact, Posture, Weld
from tests.scenes import mechanisms


def biped(folder: Path, ankles: tuple[str, ...]) -> Robot:
    """Two straight legs below a pelvis: yaw, roll, pitch, knee, and ankles about the given axes."""

    def leg(side: str, y: float) -> str:
        def joint(name: str, axis: str) -> str:
            return f'<joint name="{side}_{name}" axis="{axis}" range="-2 2"/>'

        def body(name: str, z: float, inside: str) -> str:
            shape = '<geom type="sphere" size="0.05" mass="1"/>'
            return f'<body name="{side}_{name}" pos="0 0 {z}">{shape}{inside}</body>'

        foot = body("foot", -0.4, "".join(joint(f"ankle_{axis[::2]}", axis) for axis in ankles))
        knee = body("shin", -0.4, joint("knee", "0 1 0") + foot)
        hip = "".join(joint(f"hip_{axis[::2]}", axis) for axis in ("0 0 1", "1 0 0", "0 1 0"))
        return f'<body pos="0 {y} -0.1"><geom type="sphere" size="0.05" mass="1"/>{hip}{knee}</body>'

    pelvis = '<geom type="box" size="0.1 0.1 0.1" mass="10"/><freejoint/>' + leg("left", 0.1) + leg("right", -0.1)
    path = folder / "biped.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody><body name="pelvis" pos="0 0 1">{pelvis}</body></worldbody>'
        "</mujoco>"
    )
    return hqp.robots.load(path)


def session(robot: Robot, *contacts: Element) -> tuple[hqp.Session, list[str]]:
    com = Com(axes="xyz", law=P(10.0))
    stack = Stack(Level(com, name="com"), Level(Posture(), name="posture"), subject_to=[*contacts, JointLimits()])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        made = hqp.Controller(stack, deadline=np.inf).session(robot, 0.002)
    return made, [str(one.message) for one in told if issubclass(one.category, ModelWarning)]


def reversals(run: hqp.Session) -> float:
    """Reversals of commands per second, mean over joints, while the CoM goes down, ahead and to the side."""
    robot = run.robot
    q, v = robot.home, np.zeros(robot.nv)
    goal = robot.state(q, v).com() + np.array([0.05, 0.05, -0.1])
    com, commands = run.stack.find("com"), []
    for _ in range(150):
        tick = run.step(robot.state(q, v), com.at(goal))  # type: ignore[attr-defined]
        commands.append(tick.command)
        q, v = tick.advance()
    change = np.diff(commands, axis=0)
    turned = (change[1:] * change[:-1] < 0.0) & (np.minimum(abs(change[1:]), abs(change[:-1])) > 1e-3)
    return float(turned.sum(axis=0).mean() / 0.3)


FLAT = FixedContact(frame="left_foot", name="left"), FixedContact(frame="right_foot", name="right")


def test_flat_feet_on_legs_of_five_joints_are_told(tmp_path: Path) -> None:
    robot = biped(tmp_path, ("0 1 0",))
    run, told = session(robot, *FLAT)
    (text,) = told
    assert text.startswith("left, right: overconstrained. Only 11 of 12 rows are independent")
    notes = run.step(robot.state()).notes
    assert [note.detail for note in notes if note.element == "contacts"] == [text]
    assert not [note for note in run.step(robot.state()).notes if note.element == "contacts"]
    assert reversals(run) > 50.0


@pytest.mark.parametrize("other", [EdgeContact(frame="right_foot", axis="x"), PointContact(frame="right_foot")])
def test_what_the_text_names_is_a_cure(tmp_path: Path, other: Element) -> None:
    run, told = session(biped(tmp_path, ("0 1 0",)), FLAT[0], other)
    assert not told
    assert reversals(run) < 10.0


def arm(folder: Path, *turns: float) -> Robot:
    """Three links in a plane, each with a given angle to the previous one."""
    inside = '<geom type="sphere" size="0.05" mass="1"/>'
    for k, turn in reversed([*enumerate(turns)]):
        joint = (
            f'<joint name="joint_{k}" axis="0 0 1"/><geom type="capsule" size="0.02" fromto="0 0 0 1 0 0" mass="1"/>'
        )
        end = f'<body name="end_{k}" pos="1 0 0">{inside}</body>' if k == len(turns) - 1 else inside
        inside = f'<body pos="{float(k > 0)} 0 0" euler="0 0 {turn}">{joint}{end}</body>'
    path = folder / "arm.xml"
    path.write_text(f'<mujoco><compiler angle="degree"/><worldbody>{inside}</worldbody></mujoco>')
    return hqp.robots.load(path)


def test_a_stretched_arm_is_held_and_a_folded_one_can_move(tmp_path: Path) -> None:
    held = PointContact(frame="end_2", name="end")
    for turns, expected in (((0.0, 0.0, 0.0), 1), ((0.0, 180.0, 180.0), 0), ((0.0, 40.0, 40.0), 0)):
        robot = arm(tmp_path, *turns)
        values = np.linalg.svd(robot.state().jacobian("end_2")[:2], compute_uv=False)
        assert (values[1] < 1e-9) == (turns[1] % 180.0 == 0.0)
        assert len(session(robot, held)[1]) == expected, turns


@pytest.mark.parametrize("name", ["cbi", "talos", "g1", "icub", "romeo"])
def test_humanoids_with_legs_of_six_joints_are_not_told(name: str) -> None:
    robot = hqp.robots.load(name)
    assert not session(robot, *(FixedContact(frame=sole) for sole in robot.landmarks["soles"]))[1]


def test_contacts_that_depend_on_each_other_everywhere_are_not_told() -> None:
    robot = hqp.robots.load("quadruped")
    feet = [frame for frame in robot.frame_names if "FOOT" in frame.upper()] or list(robot.frame_names)[-4:]
    assert not session(robot, *(PointContact(frame=frame) for frame in feet))[1]


def parallelogram(folder: Path, bend: float, axis: str) -> Robot:
    """Crank 0.2 m, coupler 0.4 m and rocker 0.2 m about an axis across x, the crank bent at home by an angle [rad]."""

    def rod(name: str, length: float) -> str:
        return f'<joint name="{name}" axis="{axis}"/><geom type="capsule" size="0.02" fromto="0 0 0 {length} 0 0"/>'

    coupler = f'<body name="coupler" pos=".2 0 0">{rod("coupler", 0.4)}<site name="end" pos=".4 0 0"/></body>'
    bars = f"<body>{rod('crank', 0.2)}{coupler}</body>"
    bars += f'<body pos=".4 0 0">{rod("rocker", 0.2)}<site name="bearing" pos=".2 0 0"/></body>'
    path = folder / "bars.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody>{bars}</worldbody>'
        f'<keyframe><key name="home" qpos="{bend} {-bend} {bend}"/></keyframe></mujoco>'
    )
    return hqp.robots.load(path)


def warned(robot: Robot, *closures: Element) -> str:
    lead = Posture(joints=[robot.joint_names[0]], law=P(5.0), name="lead")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        hqp.Controller(Stack(Level(lead), subject_to=[*closures])).session(robot, 0.002)
    return " ".join(str(one.message) for one in told if issubclass(one.category, ModelWarning))


@pytest.mark.parametrize("bend", [0.0, 0.4, -1.0, 2.5])
@pytest.mark.parametrize("axis", ["0 1 0", "0 0.6 0.8"])
def test_a_weld_that_locks_a_loop_is_reported_with_its_cure(bend: float, axis: str, tmp_path: Path) -> None:
    """The text names the bearing's axis, and the closures that it names move and are not reported."""
    robot = parallelogram(tmp_path, bend, axis)
    text = warned(robot, Weld(frame="end", relative_to="bearing", name="loop"))
    assert text.startswith("loop: ")
    assert "Ball(frame='end', relative_to='bearing')" in text
    found = re.search(r"Hinge\(frame='end', relative_to='bearing', axis=\((.*?)\)\)", text)
    assert found is not None
    x, y, z = (float(number) for number in found[1].split(","))
    np.testing.assert_allclose((x, y, z), [float(number) for number in axis.split()], atol=1e-6)
    if bend:
        assert not warned(robot, Hinge(frame="end", relative_to="bearing", axis=(x, y, z)))
        assert not warned(robot, Ball(frame="end", relative_to="bearing"))


def test_a_hinge_across_the_bearing_is_reported(tmp_path: Path) -> None:
    text = warned(parallelogram(tmp_path, 0.4, "0 1 0"), Hinge(frame="end", relative_to="bearing", axis="x", name="h"))
    assert text.startswith("h: holds all motion of crank, coupler, rocker")
    assert "instead of the Hinge: the loop then has 1 motion" in text


@pytest.mark.parametrize("kind", mechanisms.KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_welds_of_drawn_mechanisms_are_reported(kind: str, seed: int, tmp_path: Path) -> None:
    """Points that MuJoCo connects let the mechanism move, welds in their place lock it."""
    text = mechanisms.draw(np.random.default_rng(seed), kind)
    for welded in (False, True):
        path = tmp_path / f"{welded}.xml"
        path.write_text(re.sub(r'<connect (.*?) anchor=".*?"/>', r"<weld \1/>", text) if welded else text)
        told = warned(hqp.robots.load(path))
        assert ("instead of the Weld" in told) == welded, told


def test_closures_that_leave_motion_are_not_reported(tmp_path: Path) -> None:
    """An object in two hands, and a body that a weld fixes in the world."""
    talos = hqp.robots.load("talos")
    assert not warned(talos, Weld(frame="gripper_left_base_link", relative_to="gripper_right_base_link"))
    path = tmp_path / "free.xml"
    path.write_text(
        '<mujoco><worldbody><body name="box"><freejoint/><geom size=".1"/><body pos=".3 0 0"><joint name="j"/>'
        '<geom size=".1" pos=".1 0 0"/></body></body></worldbody><equality><weld body1="box" body2="world"/></equality>'
        '<actuator><motor joint="j"/></actuator></mujoco>'
    )
    assert not warned(hqp.robots.load(path))


def test_a_session_warns_once_where_it_is_made(tmp_path: Path) -> None:
    """A search for a way out compiles the stack again: its thread does not end by a warning that is an error."""
    robot = parallelogram(tmp_path, 0.4, "0 1 0")
    lead = Posture(joints=["crank"], law=P(5.0), name="lead")
    controller = hqp.Controller(Stack(Level(lead), subject_to=[Weld(frame="end", relative_to="bearing")]))
    with pytest.warns(ModelWarning, match="instead of the Weld") as told:
        session = controller.session(robot, 0.002)
    assert [Path(one.filename).name for one in told] == [Path(__file__).name]
    state = robot.state()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Search(session.stack, robot.copy(), one_second).aim(state.q, [lead.at([1.0])])
