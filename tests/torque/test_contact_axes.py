"""Contact forces in the axes of the contact on the ground, for contacts of three, five and six rows."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp
from hqp import PD, Level, Stack
from hqp.declare.element import Constraint
from hqp.tasks import EdgeContact, FixedContact, FrictionCone, PointContact, Posture


@pytest.mark.parametrize("kind", ["point", "edge", "fixed"])
@pytest.mark.parametrize("yaw", [0.0, 0.7, math.pi])
def test_forces_in_contact_axes_are_those_of_the_world_turned(kind: str, yaw: float) -> None:
    robot = hqp.robots.load("talos")
    made = {
        "point": lambda frame: PointContact(frame=frame),
        "edge": lambda frame: EdgeContact(frame=frame, axis="y"),
        "fixed": lambda frame: FixedContact(frame=frame),
    }
    left, right = robot.landmarks["soles"]
    first: Constraint = made[kind](left)
    stack = Stack(Level(Posture(law=PD(20.0))), subject_to=[first, FixedContact(frame=right)])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, 0.002)
    q = robot.home.copy()
    q[3:7] = 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    tick = session.step(robot.state(q))
    program = session.program
    own, world = (program.contact_forces(tick.x, world=w)[first.name] for w in (False, True))  # type: ignore[attr-defined]
    axes = program.contact_axes()[first.name]  # type: ignore[attr-defined]
    assert own.shape == world.shape == ({"point": 3, "edge": 5, "fixed": 6}[kind],)
    np.testing.assert_allclose(axes @ own[:3], world[:3], atol=1e-9)
    np.testing.assert_allclose(axes[:, 0], [math.cos(yaw), math.sin(yaw), 0.0], atol=1e-6)
    moments = axes @ own[3:] if kind == "fixed" else own[3:]
    np.testing.assert_allclose(moments, world[3:], atol=1e-9)


def test_axes_on_request_are_those_of_the_native_rows() -> None:
    """Axes that native code writes for cones, and those that Python computes for contacts without a cone."""
    robot, rng = hqp.robots.load("talos"), np.random.default_rng(0)
    contacts = [FixedContact(frame=frame, name=f"sole_{k}") for k, frame in enumerate(robot.landmarks["soles"])]
    cones = [FrictionCone(contact=contact.name, mu=0.6) for contact in contacts]
    stack = Stack(Level(Posture(law=PD(20.0))), subject_to=[*contacts, *cones])
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf).session(robot, 0.002, stuck=False)
    for _ in range(10):
        turn, normal = rng.uniform(-0.4, 0.4, robot.nv), rng.normal(size=3) * 0.2 + (0.0, 0.0, 1.0)
        turn[5] = rng.uniform(-3.0, 3.0)
        state = robot.state(robot.integrate(robot.home, turn, 1.0))
        normal = normal / np.linalg.norm(normal)
        session.step(state, *(contact.at(normal=normal) for contact in contacts))
        for name, ground in session.program._ground.items():  # type: ignore[attr-defined]
            np.testing.assert_allclose(ground.now, ground.axes, atol=1e-12, err_msg=name)
