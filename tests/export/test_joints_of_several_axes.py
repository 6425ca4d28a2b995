"""Robots on joints of several axes: files and batches of stacks with JointLimits have the session's commands."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import PD, Level, P, Stack
from hqp.export.loaded import LoadedSession
from hqp.loop.file import text
from hqp.solvers.lexicographic import kernel
from hqp.tasks import JointLimits, Position, Posture

pytestmark = pytest.mark.skipif(not kernel(), reason="no native kernel here")
BASES = {
    "planar": pin.JointModelPlanar,
    "ball": pin.JointModelSpherical,
    "translation": pin.JointModelTranslation,
    "Euler angles": pin.JointModelSphericalZYX,
}


def drawn(base: str, seed: int) -> Any:
    """A base of several axes that bears drawn hinges and slides with limits."""
    rng, model, carrier = np.random.default_rng(seed), pin.Model(), 0
    for i in range(6):
        own = (
            BASES[base] if i == 0 else (pin.JointModelRX, pin.JointModelRZ, pin.JointModelPY, pin.JointModelRUBY)[i % 4]
        )
        place = pin.SE3(pin.exp3(rng.normal(size=3)), 0.3 * rng.normal(size=3))
        carrier = model.addJoint(carrier, own(), place, f"joint {i}")
        model.appendBodyToJoint(
            carrier, pin.Inertia(2.0, 0.1 * rng.normal(size=3), 0.02 * np.eye(3)), pin.SE3.Identity()
        )
        joint = model.joints[carrier]
        model.velocityLimit[joint.idx_v : joint.idx_v + joint.nv] = rng.uniform(0.5, 2.0)
        model.effortLimit[joint.idx_v : joint.idx_v + joint.nv] = 200.0
        if joint.nq == 1:
            model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q] = -rng.random(), rng.random()
    model.addFrame(pin.Frame("hand", carrier, 0, pin.SE3(np.eye(3), rng.normal(size=3)), pin.FrameType.OP_FRAME))
    return hqp.robots.load(model)


@pytest.mark.parametrize("formulation", [hqp.Velocity, hqp.Acceleration])
@pytest.mark.parametrize("base", BASES)
def test_a_file_and_a_batch_have_the_commands_of_the_session(base: str, formulation: Any) -> None:
    """The hand's goal is out of reach: limits of speed, acceleration and position act."""
    for seed in range(3):
        robot = drawn(base, seed)
        law = P(5.0) if formulation is hqp.Velocity else PD(25.0, 10.0)
        hand, named = Position(frame="hand", law=law), Posture(joints=robot.joint_names, law=law)
        stack = Stack(Level(hand), Level(named), subject_to=[JointLimits()])
        session = hqp.Controller(stack, formulation(), deadline=np.inf).session(robot, 0.01)
        file, batch = LoadedSession(text(session)), hqp.Batch(session.controller, robot, 2, session.dt, threads=1)
        q, v, goal = robot.home.copy(), np.zeros(robot.nv), np.array([3.0, 2.0, 1.0])
        for i in range(60):
            tick = session.step(robot.state(q, v), hand.at(goal))
            if i == 0:
                for element, value in session.hold_values.items():
                    if element in file.names:
                        file.hold(element, value)
            np.testing.assert_array_equal(file.step(q, v, {hand.name: goal}).x, tick.x)
            many = batch.step(np.array([q, q]), np.array([v, v]), {hand.name: np.array([goal, goal])})
            np.testing.assert_allclose(many.x, [tick.x, tick.x], rtol=0.0, atol=1e-9 * (1.0 + np.abs(tick.x).max()))
            q, v = tick.advance()
            assert np.all(np.abs(v) <= robot.velocity_limit + 1e-9)
