"""Frozen joints, motors with a torque-speed line, and welds with a limited constraint force."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.tasks as t
from hqp import PD, Level, P, Stack, serial
from hqp.errors import DeclarationError, HqpError
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.problem import Status

DT = 0.002


@pytest.fixture(scope="module")
def robots() -> dict[str, Any]:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return {name: hqp.robots.load(name) for name in ("talos", "panda")}


def feet(robot: Any) -> list[Any]:
    return [t.FixedContact(frame=f, name=f) for f in robot.landmarks.get("soles", ())] if robot.floating else []


FORMULATIONS = {
    "velocity": hqp.Velocity(law=P(3.0)),
    "acceleration": hqp.Acceleration(law=PD(50.0), contact_law=PD(400.0)),
    "torque": hqp.Torque(law=PD(50.0), contact_law=PD(400.0)),
}


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize(
    ("name", "frame", "joints"),
    [
        ("talos", "gripper_left_base_link", ("torso_1_joint", "torso_2_joint")),
        ("panda", "panda_hand", ("panda_joint3", "panda_joint5")),
    ],
)
def test_frozen_joints_do_not_move(robots: dict[str, Any], kind: str, name: str, frame: str, joints: Any) -> None:
    robot = robots[name]
    hand, frozen = t.Position(frame=frame, name="hand"), t.Frozen(joints=joints)
    posture = t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0))
    stack = Stack(Level(hand), Level(posture), subject_to=[*feet(robot), t.JointLimits(), frozen])
    session = hqp.Controller(stack, FORMULATIONS[kind], deadline=math.inf).session(robot, DT)
    q, v = robot.home, np.zeros(robot.nv)
    goal = robot.state().position(frame) + [0.05, 0.1, 0.1]
    columns = frozen.selection(robot)
    for _ in range(1000):
        tick = session.step(robot.state(q, v), hand.at(goal))
        q, v = tick.advance()
        assert tick.status is Status.OPTIMAL
        assert np.abs(v[columns]).max() < 1e-9
    assert np.linalg.norm(robot.state(q).position(frame) - goal) < 0.01


@pytest.mark.parametrize("kind", ["acceleration", "torque"])
def test_a_joint_that_moves_comes_to_rest(robots: dict[str, Any], kind: str) -> None:
    """Freeze a joint that turns at 1 rad/s: it slows down at most at the declared rate and returns to its place."""
    robot = robots["panda"]
    frozen = t.Frozen(joints="panda_joint4", acceleration=10.0)
    stack = Stack(Level(t.Posture()), subject_to=[frozen])
    session = hqp.Controller(stack, FORMULATIONS[kind], deadline=math.inf).session(robot, DT)
    q, v = robot.home, np.zeros(robot.nv)
    column = int(frozen.selection(robot)[0])
    v[column] = 1.0
    rates = [1.0]
    for _ in range(1000):
        q, v = session.step(robot.state(q, v)).advance()
        rates.append(float(v[column]))
    assert np.abs(np.diff(rates)).max() < 10.0 * DT * (1.0 + 1e-6)
    assert abs(q[robot.positions(frozen.selection(robot))[0]] - robot.home[3]) < 1e-3
    assert abs(rates[-1]) < 1e-3


def test_a_joint_without_end_is_frozen_the_short_way() -> None:
    """Freeze just below pi and start a little beyond it: the error is 0.02 rad, not a turn."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), "spin")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    robot = hqp.robots.load(model)
    stack = Stack(Level(t.Posture()), subject_to=[t.Frozen(joints="spin")])
    session = hqp.Controller(stack, hqp.Acceleration(), deadline=math.inf).session(robot, DT)
    for turn in (math.pi - 0.01, math.pi - 0.01, math.pi + 0.01):
        tick = session.step(robot.state(np.array([math.cos(turn), math.sin(turn)])))
    assert tick.command[0] == pytest.approx(-(20.0**2) * 0.02)


def test_a_motor_at_speed_has_less_torque(robots: dict[str, Any]) -> None:
    robot = robots["panda"]
    limits = t.TorqueSpeedLimits(joints="panda_joint1", corner=0.5, no_load=2.0, scale=0.5)
    column = int(robot.actuated[limits.selection(robot)][0])
    most = 0.5 * robot.effort_limit[column]
    for speed, upper, lower in ((0.0, 1.0, 1.0), (1.0, 1.0, 1.0), (1.5, 0.5, 1.0), (3.0, 0.0, 1.0), (-1.75, 1.0, 0.25)):
        v = np.zeros(robot.nv)
        v[column] = speed
        low, high = limits.bounds(robot.state(robot.home, v))
        assert high[0] == pytest.approx(upper * most)
        assert low[0] == pytest.approx(-lower * most)
    whole = t.TorqueSpeedLimits()
    low, high = whole.bounds(robot.state())
    assert np.allclose(high, robot.effort_limit[robot.actuated])
    limits = t.TorqueSpeedLimits(no_load=2.0, corner=0.3)
    stack = Stack(Level(t.Posture(law=PD(4e4))), subject_to=[limits])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, DT)
    q, v, less = robot.home, np.zeros(robot.nv), 0
    goal = t.Posture().at(robot.state().angles[robot.joints(None)] + 0.8)
    for _ in range(300):
        state = robot.state(q, v)
        low, high = limits.bounds(state)
        tick = session.step(state, goal)
        assert (tick.command <= high + 1e-6).all()
        assert (tick.command >= low - 1e-6).all()
        q, v = tick.advance()
        less += int(((tick.command > high - 1e-6) & (high < 0.9 * robot.effort_limit[robot.actuated])).any())
    assert less > 10  # ticks with a moving motor at its limit


def hands(robot: Any, law: Any = None) -> t.Weld:
    return t.Weld(frame="gripper_left_base_link", relative_to="gripper_right_base_link", name="box", law=law)


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_weld_keeps_two_hands_together(robots: dict[str, Any], kind: str) -> None:
    """Talos carries a box: one hand moves by 15 cm, the other follows, and their relative pose is constant."""
    robot = robots["talos"]
    weld = hands(robot, P(20.0) if kind == "velocity" else PD(400.0))
    hand = t.Position(frame=weld.frame, name="hand")
    posture = t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0))
    stack = Stack(Level(hand), Level(posture), subject_to=[*feet(robot), weld])
    session = hqp.Controller(stack, FORMULATIONS[kind], deadline=math.inf).session(robot, DT)
    q, v = robot.home, np.zeros(robot.nv)
    start, goal = weld.value(robot.state()).copy(), robot.state().position(weld.frame) + [0.1, 0.0, 0.1]
    for _ in range(1000):
        q, v = session.step(robot.state(q, v), hand.at(goal)).advance()
        assert np.abs(weld.value(robot.state(q)) - start).max() < 1e-5
    assert np.linalg.norm(robot.state(q).position(weld.frame) - goal) < 0.01


def test_a_weld_without_a_law_does_not_drift_at_torque_level(robots: dict[str, Any]) -> None:
    """The hands start 2 mm off the declared relative place and reach it within half a second."""
    robot = robots["talos"]
    weld, posture = hands(robot), t.Posture(law=PD(20.0))
    stack = Stack(Level(posture), subject_to=[*feet(robot), weld])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, DT)
    state = robot.state()
    place = np.eye(4)
    other = "gripper_right_base_link"
    R = state.rotation(other)
    place[:3, :3] = R.T @ state.rotation(weld.frame)
    place[:3, 3] = R.T @ (state.position(weld.frame) - state.position(other)) + [0.0, 0.0, 0.002]
    q, v = robot.home, np.zeros(robot.nv)
    for _ in range(300):
        q, v = session.step(robot.state(q, v), weld.at(place)).advance()
    state = robot.state(q)
    found = state.rotation(other).T @ (state.position(weld.frame) - state.position(other))
    assert np.abs(found - place[:3, 3]).max() < 1e-4


def test_the_wrench_of_a_weld_is_real(robots: dict[str, Any]) -> None:
    """With the torques and that wrench on both hands, Pinocchio's forward dynamics give the program's acceleration."""
    robot = robots["talos"]
    weld = hands(robot)
    stack = Stack(Level(t.Com()), Level(t.Posture()), subject_to=[*feet(robot), weld])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, DT)
    rng = np.random.default_rng(0)
    q = robot.integrate(robot.home, rng.uniform(-0.2, 0.2, robot.nv), 1.0)
    goal = t.Com().at(robot.state(q).com() + [0.0, 0.02, 0.01])
    tick = session.step(robot.state(q, np.zeros(robot.nv)), goal)
    forces = session.program.contact_forces(tick.x, world=True)
    state = robot.state(q, np.zeros(robot.nv))
    tau = np.zeros(robot.nv)
    tau[robot.actuated] = tick.command
    for foot in robot.landmarks["soles"]:
        tau += state.jacobian(foot).T @ forces[foot]
    R, arm = state.rotation(weld.relative_to), state.position(weld.frame) - state.position(weld.relative_to)
    f, m = R @ forces["box"][:3], R @ forces["box"][3:]
    tau += state.jacobian(weld.frame).T @ np.concatenate((f, m))
    tau -= state.jacobian(weld.relative_to).T @ np.concatenate((f, m + np.cross(arm, f)))
    qdd = pin.aba(robot.model, robot.model.createData(), q, np.zeros(robot.nv), tau)
    assert np.allclose(qdd, session.program.acceleration(tick.x), atol=1e-6 * (1.0 + np.abs(qdd).max()))  # type: ignore[attr-defined]
    assert np.abs(forces["box"]).max() > 0.1


def test_the_wrench_of_a_weld_is_limited(robots: dict[str, Any]) -> None:
    """A level pulls both hands apart: the box bears its limit of force and no more."""
    robot = robots["talos"]
    weld = hands(robot, PD(400.0))
    squeeze = t.ContactForce(contact="box", components=("fy",), name="squeeze")
    limits = t.ForceLimits(contact="box", force=30.0, moment=5.0)
    stack = Stack(Level(squeeze), Level(t.Posture()), subject_to=[*feet(robot), weld, limits])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, DT)
    q, v = robot.home, np.zeros(robot.nv)
    for wanted, expected in ((10.0, 10.0), (-25.0, -25.0), (80.0, 30.0)):
        for _ in range(20):
            tick = session.step(robot.state(q, v), squeeze.at([wanted]))
            found = session.program.contact_forces(tick.x)["box"]  # type: ignore[attr-defined]
            assert np.abs(found[:3]).max() < 30.0 + 1e-5
            assert np.abs(found[3:]).max() < 5.0 + 1e-5
            q, v = tick.advance()
        assert found[1] == pytest.approx(expected, abs=0.2)


def test_what_is_refused(robots: dict[str, Any]) -> None:
    robot = robots["panda"]
    for make, what in (
        (lambda: t.Frozen(joints=None), "joints"),
        (lambda: t.Frozen(joints="a", rate=0.0), "rate"),
        (lambda: t.TorqueSpeedLimits(corner=1.0), "corner"),
        (lambda: t.TorqueSpeedLimits(no_load=0.0), "no_load"),
        (lambda: t.ForceLimits(contact="box"), "one of them"),
        (lambda: t.ForceLimits(contact="box", force=-1.0), "force"),
    ):
        with pytest.raises(DeclarationError, match=what):
            make()
    for element in (t.Frozen(joints="panda_joint9"), t.TorqueSpeedLimits(joints="panda_joint9")):
        with pytest.raises(HqpError, match="panda_joint"):
            hqp.Controller(Stack(Level(t.Posture()), subject_to=[element]), hqp.Torque()).session(robot, DT)
    stack = Stack(
        Level(t.Posture()),
        subject_to=[
            hands(robot),
            t.Frozen(joints=["a", "b"]),
            t.ForceLimits(contact="box", force=3.0),
            t.TorqueSpeedLimits(scale=0.5),
        ],
    )
    assert serial.loads(serial.dumps(stack)) == stack


BARS = """
<robot name="bars">{links}
<link name="coupler_end"/><joint name="ce" type="fixed"><parent link="coupler"/><child link="coupler_end"/>
 <origin xyz="{span} 0 0" rpy="{turn} 0.2 0.1"/></joint>
<link name="rocker_end"/><joint name="re" type="fixed"><parent link="rocker"/><child link="rocker_end"/>
 <origin xyz="{arm} 0 0"/></joint></robot>"""
BAR = (
    '<link name="{0}"><inertial><mass value=".5"/><origin xyz=".1 0 0"/>'
    '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
TURN = (
    '<joint name="{0}_j" type="revolute"><parent link="{1}"/><child link="{0}"/><origin xyz="{2} 0 0"/>'
    '<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="4" effort="9"/></joint>'
)


@pytest.mark.parametrize("closure", ["Hinge", "Ball"])
@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize("seed", range(2))
def test_a_parallelogram_moves_on_its_circle(closure: str, kind: str, seed: int, tmp_path: Any) -> None:
    """Crank and rocker turn equally, the coupler keeps its direction: closed form, for drawn lengths and poses."""
    rng = np.random.default_rng(seed)
    span, arm = rng.uniform(0.2, 0.6), rng.uniform(0.1, 0.4)
    places = (("crank", "ground", 0.0), ("coupler", "crank", arm), ("rocker", "ground", span))
    links = "".join(BAR.format(n) for n in ("ground", *(name for name, *_ in places)))
    links += "".join(TURN.format(*place) for place in places)
    path = tmp_path / "bars.urdf"
    path.write_text(BARS.format(links=links, span=span, arm=arm, turn=rng.uniform(-1, 1)))
    robot = hqp.robots.load(path)
    start, goal = rng.uniform(-1.2, -0.8), rng.uniform(-0.7, -0.4)
    at = {"crank_j": start, "rocker_j": start, "coupler_j": -start}
    q, v = robot.configuration(np.array([at[robot.joint_name(i)] for i in range(3)])), np.zeros(3)
    lead = t.Posture(joints=["crank_j"], law=P(8.0) if kind == "velocity" else PD(100.0), name="lead")
    extra: dict[str, Any] = {"axis": "y"} if closure == "Hinge" else {}
    loop = getattr(t, closure)(frame="coupler_end", relative_to="rocker_end", name="loop", **extra)
    stack = Stack(Level(lead), subject_to=[loop])
    session = hqp.Controller(stack, FORMULATIONS[kind], deadline=math.inf).session(robot, DT)
    file = LoadedSession(text(session))
    for k in range(600):
        tick, found = session.step(robot.state(q, v), lead.at([goal])), file.step(q, v, {"lead": ([goal],)})
        np.testing.assert_allclose(found.x, tick.x, atol=1e-9, err_msg=f"tick {k}")
        q, v = tick.advance()
    crank, coupler, rocker = (robot.state(q).angles[robot.joints(n)[0]] for n in ("crank_j", "coupler_j", "rocker_j"))
    assert crank == pytest.approx(goal, abs=1e-2)
    assert (rocker, coupler) == pytest.approx((crank, -crank), abs=1e-4)
