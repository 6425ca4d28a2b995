"""Still pictures of the docs: one for each element, one for each tutorial."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import hqp
from hqp.arrays import Mat, Vec
from hqp.viewer.meshes import hull

from .studio import BLUE, GREEN, ORANGE, RED, Studio, caption

FIGURES = Path(__file__).parents[1] / "figures"
SMALL, WIDE = (460, 460), (960, 460)
SEEN_THROUGH = 0.5
"""Opacity of the robot, so that marks inside it are visible."""
CLEAR = 0.55
"""Opacity of a foot whose sole is the subject."""

READY = np.array([0.3, -1.4, 1.5, -1.2, -1.3, 0.2])
FORWARD, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
SIDE = np.array([0.0, 0.3, 0.0])
"""From a joint in the trunk to a place beside it, where its angle is seen [m]."""
SOFT = (0.36, 0.4, 0.46)
SOLE = np.array(
    [[0.1, 0.05, 0.0], [0.1, -0.05, 0.0], [-0.1, -0.05, 0.0], [-0.1, 0.05, 0.0]]
)


@cache
def studio(name: str, size: tuple[int, int] = SMALL) -> Studio:
    """A robot's studio, made once."""
    return Studio(hqp.robots.load(name), size)


def aim(
    s: Studio,
    look: Vec,
    distance: float,
    azimuth: float = 150.0,
    elevation: float = -14.0,
) -> None:
    """Turn the camera."""
    s.camera.lookat, s.camera.distance, s.camera.azimuth, s.camera.elevation = (
        look,
        distance,
        azimuth,
        elevation,
    )


def arm() -> tuple[Studio, Vec, Any]:
    """UR5, ready."""
    s = studio("ur5")
    q = s.robot.integrate(s.robot.home, READY, 1.0)
    aim(s, np.array([0.25, 0.05, 0.4]), 1.35, 140.0)
    return s, q, s.robot.state(q)


def position() -> Image.Image:
    s, q, state = arm()
    here = state.position("tool0")
    goal = here + [0.2, 0.15, 0.1]
    aim(s, np.array([0.4, 0.12, 0.42]), 1.6, 140.0)
    s.ball(here, BLUE, 0.02)
    s.ball(goal, ORANGE, 0.03)
    s.arrow(here, goal, ORANGE)
    return s.shoot(q, SEEN_THROUGH)


def orientation() -> Image.Image:
    s, q, state = arm()
    here, R = state.position("tool0"), state.rotation("tool0")
    s.axes(here, R, 0.22)
    return s.shoot(q, SEEN_THROUGH)


def pose() -> Image.Image:
    s, q, state = arm()
    here, R = state.position("tool0"), state.rotation("tool0")
    goal = here + [0.25, 0.1, 0.1]
    aim(s, np.array([0.42, 0.1, 0.42]), 1.7, 140.0)
    s.axes(here, R, 0.15)
    s.axes(goal, np.eye(3), 0.15)
    s.line(here, goal, ORANGE)
    return s.shoot(q, SEEN_THROUGH)


def posture() -> Image.Image:
    s, q, _state = arm()
    for body, (*_, (p, R)) in list(enumerate(s.robot.bodies))[1:]:
        del body
        s.arrow(np.array(p), np.array(p) + 0.2 * np.array(R)[:, 2], BLUE, 0.012)
    return s.shoot(q, SEEN_THROUGH)


def talos(azimuth: float = 150.0) -> tuple[Studio, Vec, Any]:
    s = studio("talos")
    aim(s, np.array([0.0, 0.0, 0.85]), 2.9, azimuth)
    return s, s.robot.home, s.robot.state(s.robot.home)


def feet(s: Studio, state: Any, color: Any = GREEN) -> Mat:
    """Soles as outlines; their corners."""
    corners = []
    for sole in s.robot.landmarks["soles"]:
        own = SOLE @ state.rotation(sole).T + state.position(sole) + [0.0, 0.0, 0.006]
        s.outline(own, color)
        corners.append(own)
    return np.vstack(corners)


def com() -> Image.Image:
    s, q, state = talos()
    aim(s, np.array([0.1, 0.0, 0.8]), 2.3, 140.0)
    centre = state.com()
    ground = np.array([*centre[:2], 0.01])
    corners = feet(s, state, BLUE)
    edge = hull(corners[:, :2])
    s.outline(np.column_stack((edge, np.full(len(edge), 0.008))), GREEN, 0.009)
    s.line(centre, ground, BLUE)
    s.ball(ground, BLUE, 0.03)
    s.ball(centre + [0.35, 0.0, 0.0], BLUE, 0.04)
    return s.shoot(q, 0.3)


def _legs(elevation: float = -20.0) -> tuple[Studio, Vec, Any]:
    s, q, state = talos()
    aim(s, np.array([0.02, 0.0, 0.06]), 0.8, 128.0, elevation)
    return s, q, state


def _feet_shot(s: Studio, q: Vec) -> Image.Image:
    """The feet, and the rest of the robot faintly."""
    soles = s.robot.landmarks["soles"]
    return s.shoot(
        q, CLEAR, frozenset(s.robot.body(s.robot.frame(sole)) for sole in soles)
    )


def fixed_contact() -> Image.Image:
    s, q, state = _legs()
    feet(s, state)
    for sole in s.robot.landmarks["soles"]:
        s.axes(state.position(sole) + [0.0, 0.0, 0.01], state.rotation(sole), 0.16)
    return _feet_shot(s, q)


def point_contact() -> Image.Image:
    s, q, state = _legs()
    for sole in s.robot.landmarks["soles"]:
        s.ball(
            state.position(sole) + state.rotation(sole) @ [0.12, 0.0, 0.0], GREEN, 0.02
        )
    return _feet_shot(s, q)


def edge_contact() -> Image.Image:
    s, q, state = _legs()
    for sole in s.robot.landmarks["soles"]:
        ends = np.array([[0.11, 0.06, 0.0], [0.11, -0.06, 0.0]]) @ state.rotation(
            sole
        ).T + state.position(sole)
        s.line(ends[0], ends[1], GREEN, 0.012)
    return _feet_shot(s, q)


def friction_cone() -> Image.Image:
    s, q, state = _legs(-10.0)
    for sole in s.robot.landmarks["soles"]:
        p, h, mu = state.position(sole), 0.2, 0.5
        rim = [
            p + [h * mu * np.cos(a), h * mu * np.sin(a), h]
            for a in np.linspace(0.0, 2.0 * np.pi, 17)[:-1]
        ]
        for corner in rim:
            s.line(p, corner, BLUE, 0.003)
        s.outline(np.array(rim), BLUE, 0.005)
        s.arrow(p, p + [0.05, 0.02, 0.22], RED, 0.01)
    return _feet_shot(s, q)


def unilateral_contact() -> Image.Image:
    s, q, state = _legs(-10.0)
    for sole in s.robot.landmarks["soles"]:
        p = state.position(sole)
        s.arrow(p, p + [0.0, 0.0, 0.28], RED, 0.012)
    return _feet_shot(s, q)


def center_of_pressure() -> Image.Image:
    s, q, state = _legs(-28.0)
    feet(s, state)
    for sole, offset in zip(
        s.robot.landmarks["soles"],
        ([0.05, 0.01, 0.0], [-0.02, -0.02, 0.0]),
        strict=True,
    ):
        p = state.position(sole) + offset
        s.ball(p + [0.0, 0.0, 0.012], RED, 0.014)
        s.arrow(p, p + [0.0, 0.0, 0.22], RED, 0.01)
    return _feet_shot(s, q)


def joint_limits() -> Image.Image:
    s, q, state = arm()
    lower, upper = q.copy(), q.copy()
    p, axis, start = (
        state.position("forearm_link"),
        state.rotation("forearm_link")[:, 1],
        state.position("wrist_1_link"),
    )
    reach = start - p
    points = [_turned(reach, axis, angle) + p for angle in np.linspace(-0.7, 0.7, 15)]
    for a, b in itertools.pairwise(points):
        s.line(a, b, BLUE, 0.006)
    for end in (points[0], points[-1]):
        s.line(p, end, RED, 0.008)
    del lower, upper
    return s.shoot(q, SEEN_THROUGH)


def torque_limits() -> Image.Image:
    s, q, state = arm()
    efforts = s.robot.effort_limit
    for joint, (*_, (p, R)) in enumerate(s.robot.bodies[1:]):
        length = 0.05 + 0.25 * float(efforts[joint] / np.max(efforts))
        s.arrow(np.array(p), np.array(p) + length * np.array(R)[:, 2], RED, 0.018)
        s.arrow(np.array(p), np.array(p) - length * np.array(R)[:, 2], RED, 0.018)
    del state
    return s.shoot(q, SEEN_THROUGH)


def _turned(v: Vec, axis: Vec, angle: float) -> Vec:
    return np.asarray(
        v * np.cos(angle)
        + np.cross(axis, v) * np.sin(angle)
        + axis * (axis @ v) * (1.0 - np.cos(angle))
    )


def _dreamer() -> tuple[Studio, Vec, Any]:
    s = studio("dreamer")
    return s, s.robot.home, s.robot.state(s.robot.home)


def wheel_contact() -> Image.Image:
    s, q, state = _dreamer()
    aim(s, np.array([0.0, 0.0, 0.15]), 1.3, 130.0, -25.0)
    for frame in s.robot.wheels:
        p, R = state.position(frame), state.rotation(frame)
        wheel = s.robot.wheels[frame]
        axle = R @ np.array(wheel.axle)
        contact = p - [0.0, 0.0, wheel.radius]
        s.arrow(p, p + 0.22 * axle, BLUE, 0.014)
        s.arrow(
            contact + [0, 0, 0.01],
            contact + 0.25 * np.cross(axle, [0.0, 0.0, 1.0]) + [0, 0, 0.01],
            GREEN,
            0.016,
        )
    return s.shoot(q, SEEN_THROUGH)


def joint_coupling() -> Image.Image:
    """Dreamer bent at its hip: the thorax turns with it, each joint by the same angle."""
    s, q, _ = _dreamer()
    aim(s, np.array([0.05, 0.0, 0.95]), 1.75, 90.0, -6.0)
    hip, thorax = (
        int(s.robot.joints(name)[0]) for name in ("torso_hip", "torso_thorax")
    )
    bent = np.zeros(s.robot.nv)
    bent[[hip, thorax]] = 0.6
    q = s.robot.integrate(q, bent, 1.0)
    s.robot.state(q).kinematics()
    for joint in ("torso_hip", "torso_thorax"):
        p = np.array(s.robot.bodies[s.robot.model.getJointId(joint)][-1][0])
        turned = [
            p + 0.27 * (np.cos(a) * UP + np.sin(a) * FORWARD) + SIDE
            for a in np.linspace(0.0, 0.6, 9)
        ]
        for one, two in itertools.pairwise(turned):
            s.line(one, two, ORANGE, 0.012)
        s.line(p + SIDE, turned[0], SOFT, 0.006)
        s.line(p + SIDE, turned[-1], ORANGE, 0.006)
        s.ball(p + SIDE, ORANGE, 0.025)
    return caption(
        s.shoot(q, SEEN_THROUGH), "One motor, two joints", "thorax = hip", ORANGE
    )


def collision_avoidance() -> Image.Image:
    """UR5 above a box: its capsules, and the shortest way from them to the box."""
    s, q, state = arm()
    robot = s.robot
    middle, half = np.array([0.42, 0.3, 0.14]), np.array([0.12, 0.1, 0.14])
    s.box(middle, half, ORANGE, 0.85)
    ways, capsules = [], robot.capsules
    state.kinematics()
    for capsule in capsules:
        p, R = (np.array(x) for x in robot.bodies[capsule.body][-1])
        a, b = p + R @ np.array(capsule.a), p + R @ np.array(capsule.b)
        s.capsule(a, b, BLUE, capsule.radius, 0.35)
        for share in np.linspace(0.0, 1.0, 200):
            on_axis = a + share * (b - a)
            on_box = np.clip(on_axis, middle - half, middle + half)
            gap = float(np.linalg.norm(on_box - on_axis))
            surface = on_axis + capsule.radius / gap * (on_box - on_axis)
            ways.append((gap - capsule.radius, tuple(surface), tuple(on_box)))
    gap, start, end = min(ways)
    s.line(np.array(start), np.array(end), RED, 0.012)
    for place in (start, end):
        s.ball(np.array(place), RED, 0.018)
    text = f"nearest pair: {100.0 * gap:.0f} cm"
    return caption(
        s.shoot(q, SEEN_THROUGH), "Capsules keep apart from a box", text, RED
    )


def tutorial_arm() -> Image.Image:
    from hqp import Level, P, Stack
    from hqp.tasks import JointLimits, Orientation, Position, Posture

    s = studio("ur5", WIDE)
    robot = s.robot
    place = Position(frame="tool0", name="place", law=P(4.0, max_velocity=0.4))
    stack = Stack(
        Level(place), Level(Orientation(frame="tool0", name="turn")), Level(Posture(law=P(0.5))),
        subject_to=[JointLimits()],
    )  # fmt: skip
    session = hqp.Controller(stack).session(robot, 0.008)
    q, v = robot.integrate(robot.home, READY, 1.0), np.zeros(robot.nv)
    goal = robot.state(q).position("tool0") + [0.15, 0.2, -0.1]
    way = [robot.state(q).position("tool0").copy()]
    for k in range(130):
        q, v = session.step(robot.state(q, v), place.at(goal)).advance()
        if k % 5 == 0:
            way.append(robot.state(q).position("tool0").copy())
    aim(s, np.array([0.25, 0.05, 0.36]), 1.05, 140.0)
    for a, b in itertools.pairwise(way):
        s.line(a, b, BLUE, 0.006)
    state = robot.state(q)
    s.axes(state.position("tool0"), state.rotation("tool0"), 0.14)
    s.ball(goal, ORANGE, 0.025, 0.8)
    return s.shoot(q, SEEN_THROUGH)


def tutorial_g1() -> Image.Image:
    from hqp import Level, P, Stack
    from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture

    s = studio("g1", WIDE)
    robot = s.robot
    contacts = [FixedContact(frame=sole) for sole in robot.landmarks["soles"]]
    left, right = (
        Position(frame=f"{side}_wrist_yaw_link", name=side, law=P(6.0))
        for side in ("left", "right")
    )
    stack = Stack(
        Level(*contacts, Com(axes="xy", law=P(3.0)), name="balance"), Level(left, right, name="hands"),
        Level(Orientation(frame="pelvis", law=P(2.0))), Level(Posture(law=P(1.0))), subject_to=[JointLimits()],
    )  # fmt: skip
    session = hqp.Controller(stack).session(robot, 0.005)
    q, v = robot.home, np.zeros(robot.nv)
    goals = [
        robot.state(q).position(t.frame) + d
        for t, d in ((left, [0.1, 0.05, 0.25]), (right, [0.75, 0.0, 0.3]))
    ]
    for _ in range(700):
        q, v = session.step(
            robot.state(q, v), left.at(goals[0]), right.at(goals[1])
        ).advance()
    aim(s, np.array([0.15, 0.0, 0.7]), 1.75, 125.0)
    state = robot.state(q)
    for task, goal, color in ((left, goals[0], GREEN), (right, goals[1], ORANGE)):
        s.ball(goal, color, 0.035)
        s.line(state.position(task.frame), goal, color)
    return s.shoot(q, SEEN_THROUGH)


def tutorial_talos() -> Image.Image:
    from hqp import PD, Level, Stack
    from hqp.tasks import (
        Com,
        FixedContact,
        FrictionCone,
        JointLimits,
        Position,
        Posture,
        TorqueLimits,
    )

    s = studio("talos", WIDE)
    robot = s.robot
    soles = robot.landmarks["soles"]
    hand = Position(
        frame=robot.landmarks["palms"][1],
        name="hand",
        law=PD(60.0, 15.0, max_velocity=0.4),
    )
    stack = Stack(
        Level(Com(law=PD(60.0, 15.0))), Level(hand), Level(Posture(law=PD(20.0, 9.0))),
        subject_to=[*(FixedContact(frame=f) for f in soles), *(FrictionCone(contact=f, mu=0.6) for f in soles),
                    TorqueLimits(), JointLimits()],
    )  # fmt: skip
    session = hqp.Controller(stack, hqp.Torque(contact_law=PD(0.0, 40.0))).session(
        robot, 0.002
    )
    q, v = robot.home, np.zeros(robot.nv)
    goal = robot.state(q).position(hand.frame) + [0.25, 0.0, 0.25]
    for _ in range(600):
        tick = session.step(robot.state(q, v), hand.at(goal))
        q, v = tick.advance()
    forces = session.program.contact_forces(tick.solution.x, world=True)  # type: ignore[attr-defined,union-attr]
    aim(s, np.array([0.2, 0.0, 0.85]), 2.3, 225.0)
    state = robot.state(q)
    s.ball(goal, ORANGE, 0.035)
    s.line(state.position(hand.frame), goal, ORANGE)
    for name, force in forces.items():
        p = state.position(name)
        s.arrow(p, p + 0.001 * force[:3], RED, 0.03)
    return s.shoot(q, 0.15)


ELEMENTS: dict[str, Callable[[], Image.Image]] = {
    f.__name__: f
    for f in (
        position, orientation, pose, posture, com, fixed_contact, point_contact, edge_contact, friction_cone,
        unilateral_contact, center_of_pressure, joint_limits, torque_limits, wheel_contact, joint_coupling,
        collision_avoidance,
    )
}  # fmt: skip
"""Pictures ``figures/element_NAME.webp``."""

TUTORIALS: dict[str, Callable[[], Image.Image]] = {
    f.__name__: f for f in (tutorial_arm, tutorial_g1, tutorial_talos)
}
"""Pictures ``figures/NAME.webp``."""


def save(names: set[str]) -> list[Path]:
    """Make pictures by name, all if there is no name."""
    made = []
    every = {f"element_{name}": make for name, make in ELEMENTS.items()} | TUTORIALS
    for name, make in every.items():
        if not names or name in names:
            path = FIGURES / f"{name}.webp"
            make().save(path, quality=82, method=6)
            made.append(path)
    return made
