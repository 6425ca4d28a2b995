"""Every task and constraint against finite differences, on a floating and a fixed base, native and readable."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hqp.robots
import hqp.tasks as t
from hqp import Level, Stack, serial, shapes
from hqp.arrays import Mat, Vec
from hqp.declare.element import REGISTRY, Element, Task
from hqp.declare.robot import Robot, State
from hqp.tasks.collision_scene import scene

# frames and joints of each robot for the placeholders of an example
NAMES = {
    "cbi": {"f": "r_palm", "o": "pelvis", "a": "R_SAA", "b": "B_TR", "c": "L_KFE"},
    "panda": {"f": "panda_hand", "o": "panda_link2", "a": "panda_joint2", "b": "panda_joint1", "c": "panda_joint5"},
}


def examples(n: dict[str, str]) -> dict[str, list[Element]]:
    """Examples by class name of every class with motion rows."""
    f, o, a, b, c = n["f"], n["o"], n["a"], n["b"], n["c"]
    return {
        "Position": [
            t.Position(frame=f),
            t.Position(frame=f, axes="zx", offset=(0.1, -0.2, 0.3)),
            t.Position(frame=f, relative_to=o),
            t.Position(frame=f, relative_to=o, axes="y", offset=(0.1, -0.2, 0.3), weight=3.0),
            t.Position(frame=f, relative_to=o, heading=True),
            t.Position(frame=f, relative_to=o, heading=True, axes="yz", offset=(0.1, -0.2, 0.3)),
        ],
        "Impedance": [
            t.Impedance(frame=f),
            t.Impedance(frame=f, axes="zx", stiffness=(300.0, 0.0), damping=(30.0, 50.0), offset=(0.1, -0.2, 0.3)),
        ],
        "Admittance": [t.Admittance(frame=f, damping=80.0), t.Admittance(frame=f, damping=80.0, relative_to=o)],
        "Orientation": [
            t.Orientation(frame=f),
            t.Orientation(frame=f, relative_to=o),
            t.Orientation(frame=f, axes=("roll", "pitch", "yaw")),
            t.Orientation(frame=f, axes="roll"),
            t.Orientation(frame=f, axes=("yaw", "pitch"), relative_to=o),
        ],
        "Pose": [t.Pose(frame=f), t.Pose(frame=f, relative_to=o)],
        "Com": [
            t.Com(),
            t.Com(axes="xy", weight=2.0),
            t.Com(axes="zx"),
            t.Com(subtree=a),
            t.Com(relative_to=o),
            t.Com(axes="xy", subtree=a, relative_to=f),
            t.Com(axes="yx", subtree=a, relative_to=o, heading=True),
        ],
        "Posture": [t.Posture(), t.Posture(joints=[c, a]), t.Posture(joints=b)],
        "FixedContact": [t.FixedContact(frame=f)],
        "PointContact": [t.PointContact(frame=f)],
        "EdgeContact": [t.EdgeContact(frame=f, axis="y"), t.EdgeContact(frame=f, axis=(1.0, -2.0, 0.5))],
        "JointCoupling": [t.JointCoupling({a: 1.0, b: -1.0}), t.JointCoupling({c: 2.0, a: 0.5}, offset=0.3)],
        "OmniWheelContact": [t.OmniWheelContact(wheel=f, radius=0.1, axle=(1.0, 0.0, 0.0))],
        "WheelContact": [t.WheelContact(wheel=f, radius=0.2, axle=(0.5, -1.0, 2.0))],
        "CollisionAvoidance": [
            t.CollisionAvoidance(pairs=((f, o),), influence=2.0),
            t.CollisionAvoidance(
                pairs=((f, "table"), (f, "ball"), (f, "bar"), (f, "floor")),
                influence=3.0,
                weight=2.0,
                world=(
                    shapes.box("table", (0.6, 1.0, 0.05), (0.8, 0.1, 0.3), (0.1, 0.2, 0.3)),
                    shapes.sphere("ball", 0.1, (0.5, 0.5, 1.2)),
                    shapes.capsule("bar", 0.05, 0.5, (0.4, -0.7, 0.6), (0.3, 0.4, 0.0)),
                    shapes.half_space("floor", (0.0, 0.0, -0.5), (0.1, 0.0, 0.0)),
                ),
            ),
        ],
        "JointLimits": [t.JointLimits(), t.JointLimits(joints=[a, c], acceleration=20.0)],
        "AlignAxis": [t.AlignAxis(frame=f), t.AlignAxis(frame=f, axis=(1.0, -2.0, 0.5), weight=2.0)],
        "LookAt": [t.LookAt(frame=f, axis=(0.0, 0.0, 1.0)), t.LookAt(frame=f, axis=(1.0, -2.0, 0.5))],
        "Distance": [t.Distance(frame=f, other=o)],
        "Weld": [t.Weld(frame=f, relative_to=o)],
        "Hinge": [
            t.Hinge(frame=f, relative_to=o, axis="y"),
            t.Hinge(frame=o, relative_to=f, axis=(1.0, -2.0, 0.5), weight=2.0),
        ],
        "Ball": [t.Ball(frame=f, relative_to=o), t.Ball(frame=o, relative_to=f, weight=2.0)],
        "Manipulability": [
            t.Manipulability(frame=f),
            t.Manipulability(frame=f, linear="zx", angular=""),
            t.Manipulability(frame=f, linear="", angular="yx"),
        ],
        "HoldingTorque": [t.HoldingTorque(), t.HoldingTorque(joints=[b, a], weight=2.0)],
        "JointVelocity": [t.JointVelocity(), t.JointVelocity(joints=[c, a])],
        "LowAcceleration": [t.LowAcceleration()],
        "Damping": [t.Damping(), t.Damping(kinetic_energy=True, name="energy")],
        "Momentum": [t.Momentum(), t.Momentum(linear="z", angular="yx", weight=0.5), t.Momentum(linear="")],
        "Frozen": [t.Frozen(joints=[c, a]), t.Frozen(joints=b, rate=3.0, acceleration=0.5)],
        "PrescribedMotion": [
            t.PrescribedMotion(joints=[c, a], base=False),
            t.PrescribedMotion(joints=b, weight=2.0),
        ],
        "BaseVelocityLimits": [t.BaseVelocityLimits(linear=0.5, angular=2.0)],
        "FrameVelocityLimits": [
            t.FrameVelocityLimits(frame=f),
            t.FrameVelocityLimits(frame=f, linear=0.5, angular=1.0, rate=50.0),
            t.FrameVelocityLimits(frame=f, linear=math.inf, angular=1.0),
        ],
        "Within": [
            t.Within(t.Position(frame=f), upper=0.3),
            t.Within(t.Position(frame=f, axes="zx", relative_to=o), lower=(-0.2, 0.1), upper=(0.5, math.inf)),
            t.Within(t.Com(axes="yx"), lower=-0.1, upper=0.1, rate=3.0, recovery=0.2, weight=2.0),
            t.Within(t.Distance(frame=f, other=o), lower=0.4),
            t.Within(t.Orientation(frame=f, axes=("pitch", "roll")), lower=-0.3),
            t.Within(t.Orientation(frame=f, relative_to=o), lower=-0.3, upper=0.3),
            t.Within(t.Pose(frame=f), lower=-0.3, upper=(0.1, 0.2, 0.3, 0.4, 0.5, math.inf), weight=2.0),
            t.Within(t.JointCoupling({a: 1.0, b: -1.0}, offset=0.3), upper=0.1),
            t.Within(t.Posture(joints=[c, a]), lower=(-0.5, -0.2), upper=0.4),
            t.Within(t.Manipulability(frame=f), lower=0.02),
            t.Within(t.HoldingTorque(), lower=-0.3, upper=0.3),
            t.Within(t.Momentum(), lower=-1.0, upper=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        ],
        "Cone": [
            t.Cone(t.AlignAxis(frame=f), angle=0.4),
            t.Cone(t.AlignAxis(frame=f, axis=(1.0, -2.0, 0.5)), angle=1.5),
            t.Cone(t.LookAt(frame=f, axis=(0.0, 0.0, 1.0)), angle=0.3, weight=2.0),
        ],
        "Balance": [
            t.Balance(points=((f, -0.1, -0.05, 0.0), (f, 0.1, -0.05, 0.0), (o, 0.1, 0.05, 0.0), (o, -0.1, 0.05, 0.0))),
            t.Balance(points=((f, 0.0, 0.0, 0.1), (o, 0.2, 0.0, 0.0), (o, 0.0, 0.3, 0.0)), height=0.8, weight=2.0),
        ],
        "SupportPolygon": [
            t.SupportPolygon(polygon=((0.1, 0.0), (0.1, 0.1), (0.02, 0.03), (-0.1, 0.05), (0.0, -0.2)), margin=0.01),
        ],
    }


NOWHERE = (
    t.JointVelocity,
    t.LowAcceleration,
    t.Damping,
    t.Momentum,
    t.BaseVelocityLimits,
    t.PrescribedMotion,
    t.FrameVelocityLimits,
)
"""Elements on velocities without an integral: see test_motion.py."""


# Forces and efforts do not depend on the configuration: nothing to differentiate.
CLASSES = sorted(
    name
    for name, cls in REGISTRY.items()
    if cls.__module__.startswith("hqp.tasks") and cls.quantity == "motion" and name != "BallLimits"  # test_balls.py
)
CASES = [
    pytest.param(robot, name, k, id=f"{robot}-{name}-{k}")
    for robot in NAMES
    for name in CLASSES
    for k in range(len(examples(NAMES[robot]).get(name, [None])))
]


@pytest.fixture(scope="module")
def robots() -> dict[str, Robot]:
    if "panda" not in hqp.robots.names():
        pytest.skip("needs example-robot-data")
    return {name: hqp.robots.load(name) for name in NAMES}


def followed(element: Element, state: State) -> Callable[[State], Vec]:
    """Function with derivative J v at ``state`` and value zero there."""
    if isinstance(element, t.JointLimits):
        picked, start = element.selection(state.robot), state.angles.copy()
        return lambda s: (s.angles - start)[picked]
    if isinstance(element, (t.OmniWheelContact, t.WheelContact)):
        return contact_point(element, state)
    if isinstance(element, t.CollisionAvoidance):
        return distances(element, state)
    if isinstance(element, (t.Within, t.Cone, t.Frozen)):
        hold = element.hold(state).value
        start = element.bounds(state, hold)
        side = 0 if np.isfinite(start[0]).any() else 1
        with np.errstate(invalid="ignore"):
            there = np.isfinite(start[side])
            return lambda s: np.where(there, np.nan_to_num(start[side] - element.bounds(s, hold)[side]), 0.0)
    if isinstance(element, t.SupportPolygon):
        normals = element.edges(state)[0]
        com = state.com()[:2].copy()
        return lambda s: normals @ (s.com()[:2] - com)
    assert isinstance(element, Task)
    if element.demands:
        start = element.value(state).copy()
        return lambda s: element.value(s) - start
    if isinstance(element, t.JointCoupling):
        element = dataclasses.replace(element, offset=float(element.value(state)[0]))  # zero error
    hold = element.hold(state).value
    return lambda s: element.error(s, hold)


def distances(element: t.CollisionAvoidance, state: State) -> Callable[[State], Vec]:
    """Change of distance of the pairs with rows at ``state``; zero for free rows."""
    near, own, poses = element.near(state), scene(element, state.robot), element.poses()

    def measure(s: State) -> Vec:
        s.kinematics()
        found = np.zeros(len(near))
        for k, n in enumerate(near):
            if n is not None:
                i, j = own.pair(n.pair)
                ends = own.placed(i), own.placed(j) if j < own.links else None
                found[k] = own.measure(n.pair, poses, *ends)[0] - n.distance
        return found

    return measure


def contact_point(element: Any, state: State) -> Callable[[State], Vec]:
    """Displacement of the wheel's material contact point on flat ground, along the directions of the rows."""
    radius, axle = element.geometry(state.robot)
    p, R = state.position(element.wheel), state.rotation(element.wheel)
    delta = np.array([0.0, 0.0, -radius])
    rolling = np.cross([0.0, 0.0, 1.0], R @ axle)
    rolling /= np.linalg.norm(rolling)
    along = np.array([rolling, np.cross(rolling, [0.0, 0.0, 1.0]), [0.0, 0.0, 1.0]])
    along = along if isinstance(element, t.WheelContact) else along[[0, 2]]
    return lambda s: along @ (s.position(element.wheel) + s.rotation(element.wheel) @ R.T @ delta - p - delta)


@pytest.mark.parametrize(("robot_name", "name", "k"), CASES)
def test_derivatives(robots: dict[str, Any], robot_name: str, name: str, k: int, written: Callable[..., Any]) -> None:
    robot = robots[robot_name]
    table = examples(NAMES[robot_name])
    assert name in table, f"{name} has no example here: a task that nobody has differentiated"
    element = table[name][k]
    if isinstance(element, t.BaseVelocityLimits) and not robot.floating:
        pytest.skip("no free base")
    rng = np.random.default_rng(7)
    for _ in range(3):
        q, q_other, v = robot.random_configuration(rng), robot.random_configuration(rng), rng.normal(size=robot.nv)
        target = element.hold(robot.state(q if element.steered else q_other))
        steer = (target.value,) if element.steered and target.value is not None else ()
        state = robot.state(q, v)
        J = written(element, state, target).J
        if isinstance(element, (Task, t.Within, t.Cone, t.SupportPolygon, t.FrameVelocityLimits)):
            _check_drift(robot, element, q, v, element.drift(state, *steer).copy(), steer)
        if not isinstance(getattr(element, "task", element), NOWHERE):
            _check_jacobian(robot, element, q, J)


def _check_jacobian(robot: Any, element: Element, q: Vec, J: Mat, h: float = 1e-6) -> None:
    e = followed(element, robot.state(q))
    assert np.abs(e(robot.state(q))).max() < 1e-12
    columns = []
    for unit in np.eye(robot.nv):
        ahead, behind = (e(robot.state(robot.integrate(q, unit, s))) for s in (h, -h))
        columns.append((ahead - behind) / (2.0 * h))
    assert np.abs(np.column_stack(columns) - J).max() < 1e-7


def _check_drift(
    robot: Any, element: Any, q: Vec, v: Vec, drift: Vec, steer: tuple[Any, ...] = (), h: float = 1e-5
) -> None:
    ahead, behind = (element.jacobian(robot.state(robot.integrate(q, v, s), v), *steer) @ v for s in (h, -h))
    rate = (ahead - behind) / (2.0 * h)
    assert np.abs(rate - drift).max() < 1e-6 * max(1.0, np.abs(drift).max())


def test_examples_survive_a_file() -> None:
    """Write each example in its own stack to TOML and read an equal one."""
    for elements in examples(NAMES["cbi"]).values():
        for element in elements:
            stack = Stack(Level(element))
            assert serial.loads(serial.dumps(stack)) == stack
