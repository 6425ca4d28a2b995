"""Composite, Euler-angle and universal joints of a pinocchio.Model as chains of simple joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp.collision_library import coal
from hqp.robots import Robot
from hqp.tasks import Damping, Manipulability, Momentum, Position, Posture


def composite(*joints: Any) -> Any:
    """One composite joint; later joints are displaced from earlier ones."""
    found = pin.JointModelComposite()
    for k, joint in enumerate(joints):
        turn = pin.exp3(np.array([0.3, -0.2, 0.1]) * k)
        found.addJoint(joint, pin.SE3(turn, np.array([0.1, 0.0, 0.05]) * k))
    return found


BASES = {
    "mobile": composite(pin.JointModelPX(), pin.JointModelPY(), pin.JointModelRZ()),
    "ball on rails": composite(pin.JointModelTranslation(), pin.JointModelSpherical()),
    "continuous": composite(pin.JointModelPX(), pin.JointModelRUBZ()),
    "nested": composite(pin.JointModelPX(), composite(pin.JointModelRY(), pin.JointModelPZ())),
    "Euler angles": pin.JointModelSphericalZYX(),
    "universal": pin.JointModelUniversal(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8])),
}


def arm(base: Any) -> Any:
    """Two hinges on the joint, with a frame and limits on each."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 1.0, -9.0])
    carrier = 0
    for name, joint in (("base", base), ("a", pin.JointModelRY()), ("b", pin.JointModelRZ())):
        carrier = model.addJoint(carrier, joint, pin.SE3(np.eye(3), np.array([0.1, 0.05, 0.3])), name)
        model.appendBodyToJoint(carrier, pin.Inertia.Random(), pin.SE3.Identity())
        at = pin.SE3(np.eye(3), np.array([0.2, 0.1, 0.3]))
        model.addFrame(pin.Frame(f"{name} tip", carrier, 0, at, pin.FrameType.OP_FRAME))
    model.upperPositionLimit = np.linspace(1.0, 2.0, model.nq)
    model.lowerPositionLimit = -model.upperPositionLimit
    model.armature = np.linspace(0.1, 0.2, model.nv)
    return model


@pytest.mark.parametrize("base", BASES.values(), ids=BASES)
def test_it_is_the_same_robot(base: Any) -> None:
    """Compare frames, M, Coriolis and gravity forces at random states, steps of q, and limits."""
    given = arm(base)
    shapes = pin.GeometryModel()
    shapes.addGeometryObject(
        pin.GeometryObject(
            name="ball",
            parent_joint=given.njoints - 1,
            placement=pin.SE3.Identity(),
            collision_geometry=coal.Sphere(0.1),
        )
    )
    robot, rng = Robot(given, name="arm", geometry=shapes), np.random.default_rng(1)
    data = given.createData()
    assert (robot.nq, robot.nv) == (given.nq, given.nv)
    np.testing.assert_array_equal(robot.model.upperPositionLimit, given.upperPositionLimit)
    np.testing.assert_array_equal(robot.rotors, given.armature)
    assert robot.joints("base").tolist() == list(range(given.joints[1].nv))
    assert robot.model.names[robot.geometry.geometryObjects[0].parentJoint] == "b"
    for _ in range(5):
        step, v = rng.uniform(-1.0, 1.0, given.nv), rng.normal(size=given.nv)
        q = pin.integrate(given, pin.neutral(given), step)
        np.testing.assert_allclose(robot.integrate(pin.neutral(given), step, 1.0), q, atol=1e-12)
        pin.framesForwardKinematics(given, data, q)
        pin.crba(given, data, q)
        M = np.triu(data.M) + np.triu(data.M, 1).T
        state = robot.state(q, v)
        np.testing.assert_allclose(state.mass_matrix(), M, atol=1e-10)
        np.testing.assert_allclose(state.bias_force(), pin.nonLinearEffects(given, data, q, v), atol=1e-10)
        for frame in ("base tip", "a tip", "b tip"):
            placed = data.oMf[given.getFrameId(frame)]
            np.testing.assert_allclose(state.position(frame), placed.translation, atol=1e-12)
            np.testing.assert_allclose(state.rotation(frame), placed.rotation, atol=1e-12)


@pytest.mark.parametrize("base", BASES.values(), ids=BASES)
def test_drifts_count_how_axes_move_in_their_body(base: Any) -> None:
    robot = Robot(arm(base), name="arm")
    for element in (
        Position(frame="b tip"),
        Posture(),
        Momentum(),
        Damping(kinetic_energy=True),
        Manipulability(frame="b tip", linear="xyz", angular=""),
    ):
        found = hqp.check(element, robot)
        assert not found.faults, (element.name, found.faults)


def test_a_model_of_plain_joints_is_taken_as_it_is() -> None:
    model = arm(pin.JointModelFreeFlyer())
    assert Robot(model, name="arm").model is model
