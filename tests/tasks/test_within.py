"""Bounds on values of tasks: bounded rates from inside and from outside, calm commands."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.tasks as t
from hqp import PD, Level, P, Stack, serial
from hqp.declare.element import Element, Task
from hqp.errors import DeclarationError, FrameNotFound, HqpError

DT = 0.002
FORMULATIONS = {
    "velocity": hqp.Velocity(law=P(5.0)),
    "acceleration": hqp.Acceleration(law=PD(100.0, 20.0), contact_law=PD(400.0, 40.0)),
    "torque": hqp.Torque(law=PD(100.0, 20.0), contact_law=PD(400.0, 40.0)),
}


@pytest.fixture(scope="module")
def robots() -> dict[str, Any]:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return {name: hqp.robots.load(name) for name in ("talos", "g1", "panda")}


def contacts(robot: Any) -> list[Element]:
    return [t.FixedContact(frame=f, name=f) for f in robot.landmarks.get("soles", ())] if robot.floating else []


def run(
    robot: Any, stack: Stack, kind: str, references: list[Any], ticks: int, measure: Any
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], Any]:
    """Measurements of each tick, the commands, and the last state."""
    session = hqp.Controller(stack, FORMULATIONS[kind], deadline=math.inf).session(robot, DT)
    q, v = robot.home, np.zeros(robot.nv)
    found, commands = [], []
    for _ in range(ticks):
        tick = session.step(robot.state(q, v), *references)
        q, v = tick.advance()
        found.append(measure(robot.state(q, v)))
        commands.append(tick.command)
    return np.array(found), np.array(commands), robot.state(q, v)


def frame_of(robot: Any) -> str:
    return {"talos": "gripper_left_base_link", "g1": "left_wrist_yaw_link", "panda": "panda_hand"}[robot.name]


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize("name", ["talos", "g1", "panda"])
def test_a_hand_stays_within_its_box(robots: dict[str, Any], name: str, kind: str) -> None:
    """The goal lies 20 cm behind a wall 6 cm ahead: the hand stops there, without a jump of the command."""
    robot = robots[name]
    frame = frame_of(robot)
    start = robot.state().position(frame)
    hand = t.Position(frame=frame, name="hand")
    wall = t.Within(t.Position(frame=frame, axes="x"), upper=float(start[0]) + 0.06, name="wall", rate=5.0)
    posture = Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))
    stack = Stack(Level(hand), posture, subject_to=[*contacts(robot), wall])
    goal = hand.at(start + [0.26, 0.0, 0.0])
    x, commands, _ = run(robot, stack, kind, [goal], 1000, lambda s: s.position(frame)[0] - start[0])
    assert x.max() < 0.06
    assert x[-1] > 0.0595
    jump = np.abs(np.diff(commands[1:], axis=0)).max()  # without the first command
    assert jump < {"velocity": 0.02, "acceleration": 1.5, "torque": 8.0}[kind]  # rad/s, rad/s2, N m
    assert np.diff(x).min() > -1e-7  # it does not bounce


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize("name", ["talos", "panda"])
def test_from_outside_it_comes_back_no_faster_than_recovery(robots: dict[str, Any], name: str, kind: str) -> None:
    robot = robots[name]
    frame = frame_of(robot)
    start = robot.state().position(frame)
    wall = t.Within(t.Position(frame=frame, axes="z"), lower=float(start[2]) + 0.05, name="wall", recovery=0.05)
    posture = Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))
    stack = Stack(posture, subject_to=[*contacts(robot), wall])
    z, _, _ = run(robot, stack, kind, [], 1500, lambda s: s.position(frame)[2] - start[2])
    rate = np.diff(z) / DT
    assert rate.max() < 0.05001
    assert rate.min() > 0.0  # no reversal
    assert 0.0499 < z[-1] <= z.max() < 0.05


OUTSIDE = {"wall": 0.1, "cone": 0.4, "polygon": 0.03}
"""Distance of the start from the bound [m, rad]."""


@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize(
    ("name", "what"),
    [("talos", "polygon"), ("talos", "wall"), ("g1", "polygon"), ("g1", "cone"), ("panda", "wall"), ("panda", "cone")],
)
def test_a_return_from_outside_sets_in_gradually(robots: dict[str, Any], name: str, what: str, kind: str) -> None:
    """No tick violates a constraint, the demand is at most rate * recovery, the command keeps its sign."""
    robot, off = robots[name], OUTSIDE[what]
    frame, home = frame_of(robot), robots[name].state()
    start, com, references = home.position(frame), home.com()[:2], []
    bound: Any
    if what == "wall":
        bound = t.Within(t.Position(frame=frame, axes="x"), upper=float(start[0]) - off, name="wall")
    elif what == "polygon":
        corners = com - [off, 0.0] + 0.04 * np.array([[0, 1], [-2, 1], [-2, -1], [0, -1]])
        bound = t.SupportPolygon(polygon=tuple((float(x), float(y)) for x, y in corners))
    else:
        bound = t.Cone(t.AlignAxis(frame=frame, axis=(0.0, 0.0, 1.0)), angle=0.2, name="cone")
        turn = 0.2 + off
        references = [bound.at(home.rotation(frame) @ [0.0, math.sin(turn), math.cos(turn)])]
    held = references[0].value if references else bound.hold(home).value if what == "wall" else None
    posture = Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))
    hard = [*contacts(robot), t.JointLimits(), *([t.TorqueLimits()] if kind == "torque" else []), bound]
    session = hqp.Controller(Stack(posture, subject_to=hard), FORMULATIONS[kind], deadline=math.inf).session(robot, DT)

    def way(state: Any) -> float:
        low, high = bound.bounds(state, *(() if held is None else (held,)))
        return float(min(np.min(high), np.min(-np.asarray(low))))

    q, v, ways, rates = robot.home, np.zeros(robot.nv), [way(home)], [np.zeros(robot.nv)]
    for _ in range(1000):
        tick = session.step(robot.state(q, v), *references)
        assert tick.status == hqp.Status.OPTIMAL
        q, v = tick.advance()
        ways.append(way(robot.state(q, v)))
        rates.append(v)
    speed = np.diff(ways) / DT
    most = bound.rate * bound.recovery
    assert ways[0] == pytest.approx(-off, abs=1e-3)
    assert ways[-1] > -2e-3
    assert max(ways) < 1e-3
    assert np.min(speed) > -1e-3  # no reversal
    assert np.max(np.diff(speed, prepend=0.0)) < 1.2 * most * DT
    assert np.abs(np.diff(rates, axis=0)).max() / DT < 30.0


def test_bounds_travel_with_a_reference(robots: dict[str, Any]) -> None:
    robot = robots["panda"]
    start = robot.state().position("panda_hand")
    box = t.Within(t.Position(frame="panda_hand"), lower=-0.02, upper=0.02, name="box", rate=20.0)
    hand = t.Position(frame="panda_hand", name="hand", law=P(10.0))
    session = hqp.Controller(Stack(Level(hand), subject_to=[box]), deadline=math.inf).session(robot, DT)
    q, v = robot.home, np.zeros(robot.nv)
    for k in range(1000):
        centre = start + [0.0, 0.05 * k * DT, 0.0]
        q, v = session.step(robot.state(q, v), hand.at(start), box.at(centre)).advance()
    off = robot.state(q).position("panda_hand") - centre
    assert np.abs(off).max() < 0.02 + 0.05 / 20.0 + 1e-4  # the bounds move on without a given velocity
    assert off[1] < -0.02


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_gaze_stays_within_its_cone(robots: dict[str, Any], kind: str) -> None:
    """The hand turns by 1 rad about y and 0.6 about x; the axis of the gripper may leave its direction by 0.3 rad."""
    robot = robots["panda"]
    axis = t.AlignAxis(frame="panda_hand", axis=(0.0, 0.0, 1.0))
    cone = t.Cone(axis, angle=0.3, name="cone")
    turn = t.Orientation(frame="panda_hand", name="turn")
    R = robot.state().rotation("panda_hand")
    y, x = (np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]) for a in (1.0, 0.6))
    swap = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], dtype=float)
    goal = turn.at(swap.T @ y @ swap @ x @ R)
    posture = Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))
    stack = Stack(Level(turn), posture, subject_to=[cone, t.JointLimits()])
    hold = cone.hold(robot.state()).value[0]
    e, _, _ = run(robot, stack, kind, [goal], 1500, lambda s: np.linalg.norm(axis.error(s, hold)))
    assert e.max() < 0.3 + 1e-4
    assert e[-1] > 0.29


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_gaze_that_is_far_off_comes_back_at_the_recovery_speed(robots: dict[str, Any], kind: str) -> None:
    """The point to look at lies 1.2 rad from the axis; the cone is 0.2 rad wide."""
    robot = robots["panda"]
    gaze = t.LookAt(frame="panda_hand", axis=(0.0, 0.0, 1.0))
    cone = t.Cone(gaze, angle=0.2, name="cone", recovery=0.4)
    state = robot.state()
    R = state.rotation("panda_hand")
    point = state.position("panda_hand") + 0.8 * R @ [np.sin(1.2), 0.0, np.cos(1.2)]
    posture = Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))
    stack = Stack(posture, subject_to=[cone, t.JointLimits()])
    e, _, _ = run(robot, stack, kind, [cone.at(point)], 2500, lambda s: np.linalg.norm(gaze.error(s, point)))
    rate = np.diff(e) / DT
    assert rate.min() > -0.41
    assert rate.max() < 1e-3
    assert 0.19 < e[-1] < 0.202


@pytest.mark.long
@pytest.mark.parametrize("kind", FORMULATIONS)
@pytest.mark.parametrize("name", ["talos", pytest.param("g1", marks=pytest.mark.slow)])
def test_the_balance_stays_over_the_feet(robots: dict[str, Any], name: str, kind: str) -> None:
    """A hand pulls the body over its toes: the centre of mass stays in the polygon of the stack's soles."""
    robot = robots[name]
    frame, sole = frame_of(robot), (-0.1, 0.1, -0.05, 0.05)
    start = robot.state().position(frame)
    hand = t.Position(frame=frame, name="hand")
    polygon = t.SupportPolygon(sole=sole, margin=0.02)
    posture = Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))
    feet = contacts(robot)
    stack = Stack(Level(hand), posture, subject_to=[*feet, polygon])
    ready = polygon.among(list(stack))
    assert isinstance(ready, t.SupportPolygon)
    goal = hand.at(start + [0.6, 0.0, -0.4])
    ways, commands, _ = run(robot, stack, kind, [goal], 1000, lambda s: ready.bounds(s)[1].min())
    loose, _, _ = run(
        robot, Stack(Level(hand), posture, subject_to=feet), kind, [goal], 1000, lambda s: ready.bounds(s)[1].min()
    )
    assert loose.min() < -0.01  # without it the robot would fall
    assert ways.min() > -5e-4
    if kind == "velocity":  # at arrival the hand frees the posture; no JointLimits bound its speed
        assert np.abs(np.diff(commands[1:], axis=0)).max() < 0.5


def test_the_polygon_holds_where_the_feet_stand(robots: dict[str, Any]) -> None:
    """Points in the frames of feet: if the feet move, the distances change with J and its drift."""
    robot, h = robots["talos"], 1e-6
    feet = contacts(robot)
    corners = ((0.1, 0.05), (-0.1, 0.06), (-0.11, -0.05), (0.12, -0.04))
    points = tuple((f.name, x, y if f is feet[0] else -y, 0.0) for f in feet for x, y in corners)
    polygon = t.SupportPolygon(points=points, margin=0.01)
    assert isinstance(polygon, t.SupportPolygon)
    state = robot.state()
    held = np.vstack([state.jacobian(f.name) for f in feet])
    v = np.linalg.svd(held)[2][np.linalg.matrix_rank(held) :].T @ np.random.default_rng(0).normal(size=robot.nv - 12)
    J = polygon.jacobian(robot.state())
    ends = [polygon.bounds(robot.state(robot.integrate(robot.home, v, s)))[1].copy() for s in (h, -h)]
    there = np.isfinite(ends[0])
    assert there.sum() >= 4
    assert np.allclose((ends[1][there] - ends[0][there]) / (2 * h), (J @ v)[there], atol=1e-6)
    stack = Stack(Level(t.Posture()), subject_to=[*feet, polygon])
    assert serial.loads(serial.dumps(stack)) == stack


@pytest.mark.parametrize("angle", [0.0, 1e-4, 0.09, 0.11, 1.0, 2.5, 3.1])
def test_a_rotation_vector_has_its_own_rate(robots: dict[str, Any], angle: float) -> None:
    """J and drift of bounds on a rotation match those of the rotation vector at any distance of the reference."""
    robot, h = robots["panda"], 1e-6
    rng = np.random.default_rng(2)
    for task in (t.Orientation(frame="panda_hand"), t.Pose(frame="panda_hand", relative_to="panda_link3")):
        bounded = t.Within(task, lower=-1.0, upper=1.0)
        q, v = robot.integrate(robot.home, rng.uniform(-0.5, 0.5, robot.nv), 1.0), rng.normal(size=robot.nv)
        axis = rng.normal(size=3)
        turned = pin.exp3(-angle * axis / np.linalg.norm(axis))
        held = np.array(task.value(robot.state(q)))
        held[:3, :3] = turned @ held[:3, :3]
        assert np.linalg.norm(task.error(robot.state(q), held)[-3:]) == pytest.approx(angle, abs=1e-9)
        J, drift = bounded.jacobian(robot.state(q, v), held), bounded.drift(robot.state(q, v), held)
        ends = [task.error(robot.state(robot.integrate(q, v, s)), held) for s in (h, -h)]
        assert np.allclose((ends[0] - ends[1]) / (2 * h), J @ v, atol=1e-7 * (1 + np.abs(J @ v).max()))
        rates = [bounded.jacobian(robot.state(robot.integrate(q, v, s), v), held) @ v for s in (1e-5, -1e-5)]
        assert np.allclose((rates[0] - rates[1]) / 2e-5, drift, atol=1e-6 * (1.0 + np.abs(drift).max()))


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_rotation_stays_in_its_box(robots: dict[str, Any], kind: str) -> None:
    robot = robots["panda"]
    turn = t.Orientation(frame="panda_hand", name="turn")
    box = t.Within(t.Orientation(frame="panda_hand"), lower=(-0.3, -0.1, -0.2), upper=(0.3, 0.1, 0.2), name="box")
    start = robot.state().rotation("panda_hand")
    goal = turn.at(pin.exp3(np.array([0.8, 0.5, -0.6])) @ start)
    posture = Level(t.Posture(law=P(1.0) if kind == "velocity" else PD(20.0)))
    stack = Stack(Level(turn), posture, subject_to=[box, t.JointLimits()])
    e, _, _ = run(robot, stack, kind, [goal], 1000, lambda s: box.task.error(s, start))
    assert np.abs(e).max(axis=0) == pytest.approx([0.3, 0.1, 0.2], abs=2e-3)
    assert (np.abs(e).max(axis=0) < [0.3001, 0.1001, 0.2001]).all()


def test_a_momentum_stays_under_its_limit(robots: dict[str, Any]) -> None:
    robot = robots["talos"]
    hand = t.Position(frame=frame_of(robot), relative_to="base_link", name="hand")
    limit = t.Within(t.Momentum(linear="xyz", angular=""), lower=-2.0, upper=2.0, name="limit", rate=50.0)
    start = hand.value(robot.state())
    for formulation in (hqp.Velocity(law=P(2.0)), hqp.Acceleration(law=PD(200.0))):
        session = hqp.Controller(Stack(Level(hand), subject_to=[limit]), formulation, deadline=math.inf).session(
            robot, DT
        )
        q, v, most = robot.home, np.zeros(robot.nv), 0.0
        for _ in range(200):
            q, v = session.step(robot.state(q, v), hand.at(start + [0.3, 0.2, 0.3])).advance()
            most = max(most, float(np.abs(robot.state(q, v).momentum_map()[0][:3] @ v).max()))
        assert 1.9 < most < 2.1  # measured one step later, with the map of the next configuration


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: t.Within(3.0, upper=1.0), "task"),
        (lambda: t.Within(t.OmniWheelContact(wheel="w"), upper=1.0), "task"),
        (lambda: t.Within(t.LowAcceleration(), upper=1.0), "task"),
        (lambda: t.Cone(t.Com(), angle=0.3), "AlignAxis"),
        (lambda: t.Cone(t.AlignAxis(frame="hand"), angle=0.0), "angle"),
        (lambda: t.Cone(t.LookAt(frame="hand"), angle=2.0), "angle"),
        (lambda: t.Cone(t.LookAt(frame="hand"), angle=0.3).at([1.0, 0.0, 0.0], velocity=[1.0]), "velocity"),
        (lambda: t.Within(t.Com(), upper=1.0).at([0.0, 0.0, 0.0], velocity=[1.0]), "velocity"),
        (lambda: t.Within(t.Com()), "bounds"),
        (lambda: t.Within(t.Com(), upper="high"), "upper"),
        (lambda: t.Within(t.Com(), lower=math.nan), "lower"),
        (lambda: t.Within(t.Com(), upper=1.0, rate=0.0), "rate"),
        (lambda: t.Within(t.Com(), upper=1.0, recovery=-1.0), "recovery"),
        (lambda: t.Within(t.Com(), upper=1.0, acceleration=0.0), "acceleration"),
        (lambda: t.SupportPolygon(points=(("l", 0, 0, 0), ("l", 1, 0, 0))), "points"),
        (lambda: t.SupportPolygon(points=((0, 0, 0, 0),) * 3), "points"),
        (lambda: t.SupportPolygon(polygon=((0, 0), (1, 1), (2, 2))), "one line"),
        (lambda: t.SupportPolygon(polygon=((0, 0), (1, math.nan), (2, 2))), "polygon"),
        (lambda: t.SupportPolygon(polygon=((0, 0), (1, 0), (0, 1)), sole=(-1, 1, -1, 1)), "one of"),
        (lambda: t.SupportPolygon(sole=(1, -1, -1, 1)), "rectangle"),
        (lambda: t.SupportPolygon(margin=-0.1), "margin"),
        (lambda: t.AlignAxis(frame="hand", axis=(0.0, 0.0, 0.0)), "axis"),
        (lambda: t.LookAt(frame="", axis=(0.0, 0.0, 1.0)), "frame"),
        (lambda: t.LookAt(frame="hand", axis=(0.0, 1.0)), "axis"),
        (lambda: t.AlignAxis(frame="hand").at([0.0, 0.0, 0.0]), "zero vector"),
        (lambda: t.LookAt(frame="hand").at([0.0, 0.0]), "point"),
        (lambda: t.Distance(frame="hand", other="hand"), "other"),
        (lambda: t.Weld(frame="hand"), "relative_to"),
        (lambda: t.Weld(frame="hand", relative_to="hand"), "a frame other"),
        (lambda: t.Manipulability(frame="hand", linear="", angular=""), "axes"),
        (lambda: t.Manipulability(frame="hand", linear="xx"), "axes"),
        (lambda: t.Damping(kinetic_energy=1), "kinetic_energy"),
        (lambda: t.Within(t.Position(frame="a"), lower=1.0, upper=0.0), "at most upper"),
        (lambda: t.Within(t.Position(frame="a"), lower=0.5, upper=(1.0, 0.0, 1.0)), "at most upper"),
        (lambda: t.SupportPolygon(polygon=[]), "polygon"),
        (lambda: t.SupportPolygon(points=np.zeros((0, 4))), "points"),
        (lambda: t.BaseVelocityLimits(linear=0.0), "linear"),
    ],
)
def test_what_is_refused(make: Any, what: str) -> None:
    with pytest.raises(DeclarationError, match=what):
        make()


@pytest.mark.parametrize(
    ("element", "what"),
    [
        (t.Within(t.Position(frame="panda_handd"), upper=1.0), "panda_hand"),
        (t.Within(t.Position(frame="panda_hand"), upper=(1.0, 2.0)), "3 numbers"),
        (t.Within(t.LookAt(frame="panda_hand"), lower=1.0), "Cone"),
        (t.Within(t.AlignAxis(frame="panda_hand"), lower=1.0), "Cone"),
        (t.Distance(frame="panda_hand", other="nowhere"), "nowhere"),
        (t.LookAt(frame="nowhere"), "nowhere"),
        (t.Weld(frame="panda_hand", relative_to="nowhere"), "nowhere"),
        (t.Manipulability(frame="panda_link3"), "at most 3"),
        (t.SupportPolygon(), "points"),
        (t.SupportPolygon(contacts="l_sole"), "l_sole"),
    ],
)
def test_what_a_session_refuses(robots: dict[str, Any], element: Any, what: str) -> None:
    with pytest.raises(HqpError, match=what):
        hqp.Controller(Stack(Level(element))).session(robots["panda"], DT)
    assert issubclass(FrameNotFound, HqpError)


def test_a_face_of_unknown_size_is_named(robots: dict[str, Any]) -> None:
    robot = robots["talos"]
    with pytest.raises(DeclarationError, match="sole of left_sole"):
        hqp.Controller(Stack(Level(t.SupportPolygon()), subject_to=contacts(robot))).session(robot, DT)


def test_an_edge_has_no_sole(robots: dict[str, Any]) -> None:
    edge = t.EdgeContact(frame="left_sole_link", axis="y")
    with pytest.raises(DeclarationError, match="sole of left_sole_link has no size"):
        t.SupportPolygon(sole=(-0.1, 0.1, -0.05, 0.05)).among([edge])


@dataclass(frozen=True, kw_only=True)
class Labelled(t.Position):
    """User task with a field called task."""

    task: Any = "carry"

    def drift(self, state: Any) -> Any:
        return super().drift(state)


@dataclass(frozen=True, kw_only=True)
class Height(Task):
    """Task without a drift."""

    frame: str

    def rows(self, robot: Any) -> int:
        return 1

    def value(self, state: Any) -> Any:
        return state.position(self.frame)[2:]

    def jacobian(self, state: Any) -> Any:
        return state.jacobian(self.frame)[2:3]


def test_a_missing_drift_is_told_before_the_loop(robots: dict[str, Any]) -> None:
    """Raise for the task inside a Within, and ignore other fields called task."""
    robot = robots["panda"]
    bounded = t.Within(Height(frame="panda_hand"), lower=0.2)
    hqp.Controller(Stack(Level(bounded))).session(robot, DT).step(robot.state())
    with pytest.raises(DeclarationError, match="drift"):
        hqp.Controller(Stack(Level(bounded)), hqp.Acceleration()).session(robot, DT)
    labelled = Labelled(frame="panda_hand", task=Height(frame="panda_hand"))
    for element in (labelled, dataclasses.replace(labelled, task="carry")):
        hqp.Controller(Stack(Level(element)), hqp.Acceleration()).session(robot, DT).step(robot.state())


@pytest.mark.parametrize("kind", FORMULATIONS)
def test_a_polygon_given_for_a_tick_is_one_declared(robots: dict[str, Any], kind: str) -> None:
    """The centre of mass stays in the polygon of the tick, with the command of a stack that declares it."""
    robot = robots["g1"]
    com, corners = robot.state().com()[:2], np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    task = t.Com(name="com", law=P(2.0) if kind == "velocity" else PD(20.0))
    wide = t.SupportPolygon(polygon=tuple(map(tuple, (com + 0.3 * corners).tolist())), name="polygon")
    small = com + [0.0, 0.01] + 0.02 * corners

    def started(bound: t.SupportPolygon) -> Any:
        stack = Stack(Level(task), Level(t.Posture()), subject_to=[*contacts(robot), bound])
        return hqp.Controller(stack, FORMULATIONS[kind], deadline=math.inf).session(robot, DT)

    given = started(wide)
    declared = started(t.SupportPolygon(polygon=tuple(map(tuple, small.tolist())), name="polygon"))
    q, v, goal = robot.home, np.zeros(robot.nv), task.at(robot.state().com() + [0.1, 0.0, 0.0])
    for _ in range(400):
        state = robot.state(q, v)
        one, other = given.step(state, goal, wide.at(small)), declared.step(state, goal)
        assert np.array_equal(one.command, other.command)
        q, v = one.advance()
    assert robot.state(q).com()[0] == pytest.approx(com[0] + 0.02, abs=2e-3)
    with pytest.raises(DeclarationError, match="polygon"):
        wide.at(small[:3])
    with pytest.raises(DeclarationError, match="polygon"):
        t.SupportPolygon(sole=(-0.1, 0.1, -0.1, 0.1)).at(small)
