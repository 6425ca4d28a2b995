"""Native rigid-body dynamics against Pinocchio: A, b + g, drifts of frames, the centre of mass and the momentum."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.programs.assembly
from hqp import PD, Level, Stack
from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.errors import ModelError
from hqp.programs.assembly import Assembly, kinematics
from hqp.robots import Robot
from hqp.tasks import Com, Momentum, Pose, Position, Posture

pytestmark = pytest.mark.skipif(hqp.programs.assembly.native is None, reason="no native assembly here")

TOLERANCE = 1e-12
"""Tolerance relative to the largest entry."""

KINDS = {
    "free": pin.JointModelFreeFlyer(),
    "ball": pin.JointModelSpherical(),
    "planar": pin.JointModelPlanar(),
    "translation": pin.JointModelTranslation(),
    "slide": pin.JointModelPrismaticUnaligned(np.array([0.0, 0.6, 0.8])),
    "hinge": pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])),
    "continuous": pin.JointModelRUBY(),
    "screw": pin.JointModelHX(0.3),
}


def chain(*joints: Any) -> Robot:
    """The joints in series, with a second branch from the middle, rotors and a special gravity."""
    pin.seed(3)
    model, carriers = pin.Model(), [0]
    model.gravity.linear = np.array([1.0, -2.0, -9.0])
    for k, joint in enumerate(joints):
        place = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.1 * k])), np.array([0.1, 0.2, 0.3]))
        carrier = carriers[1] if k == len(joints) // 2 > 1 else carriers[-1]
        carriers.append(model.addJoint(carrier, joint, place, f"j{k}"))
        model.appendBodyToJoint(carriers[-1], pin.Inertia.Random(), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"f{k}", carriers[-1], 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    model.armature = np.linspace(0.1, 0.2, model.nv)
    model.lowerPositionLimit, model.upperPositionLimit = -np.ones(model.nq), np.ones(model.nq)
    return Robot(model, name="chain")


class Native:
    """Native A, b + g and rows of order 2 with Jacobian and drift only."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.frames = robot, robot.frame_names[1 :: max(1, len(robot.frame_names) // 8)]
        elements: list[Element] = [Com(name="com"), Momentum(name="momentum")]
        elements += [Pose(frame=frame, name=f"frame {k}") for k, frame in enumerate(self.frames)]
        self._rows = Assembly(elements, (), robot, 0.002, {e.name: PD(1.0, 1.0) for e in elements})
        assert not self._rows.written
        self.A: Mat = np.zeros((robot.nv, robot.nv), order="F")
        self.bias = np.zeros(robot.nv)
        native = self._rows.native_rows
        assert native is not None
        terms = {"inertias": robot.inertias, "rotors": robot.rotors.tolist(), "gravity": robot.gravity}
        native.dynamics({**terms, "A": self.A, "bias": self.bias})
        self._native, self._kinematics = native, kinematics(robot)

    def at(self, q: Vec, v: Vec) -> dict[str, Vec]:
        """Native values, with native kinematics if the robot has them."""
        if self._kinematics is None:
            self.robot.state(q, v).kinematics()
        else:
            self._kinematics.update(q)
        self._native.run(q, v, v)
        J, drift = self._rows.J, self._rows.drift
        found = {"A": np.triu(self.A), "b + g": self.bias, "com": J[:3], "com drift": drift[:3]}
        found |= {"momentum": J[3:9], "momentum drift": drift[3:9], "frames": J[9:], "frame drifts": drift[9:]}
        return {name: value.copy() for name, value in found.items()}

    def pinocchios(self, q: Vec, v: Vec) -> dict[str, Vec]:
        """Pinocchio's values."""
        state = self.robot.state(q, v)
        momentum, rate = state.momentum_map()
        found = {"momentum": momentum, "momentum drift": rate}
        found |= {"A": np.triu(state.mass_matrix()), "b + g": state.bias_force().copy()}
        found |= {"com": state.com_jacobian().copy(), "com drift": state.com_drift()}
        found["frames"] = np.vstack([state.jacobian(f) for f in self.frames])
        found["frame drifts"] = np.concatenate([state.drift(f) for f in self.frames])
        return found


def compare(found: dict[str, Vec], expected: dict[str, Vec], tolerance: float = TOLERANCE) -> None:
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        largest = float(np.abs(value).max())
        np.testing.assert_allclose(found[name], value, rtol=0.0, atol=tolerance * largest, err_msg=name)


def agrees(robot: Robot, states: int = 4) -> None:
    native, rng = Native(robot), np.random.default_rng(5)
    for _ in range(states):
        q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
        compare(native.at(q, v), native.pinocchios(q, v))


@pytest.mark.parametrize("name", hqp.robots.names())
def test_every_robot_of_the_catalogue(name: str) -> None:
    agrees(hqp.robots.load(name))


@pytest.mark.parametrize("name", ["cbi", "dreamer"])
def test_with_the_inertia_of_rotors(name: str) -> None:
    robot = hqp.robots.load(name, rotors=True)
    assert robot.rotors.any()
    agrees(robot)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_every_kind_of_joint(kind: Any) -> None:
    """First in a chain and last, on hinges of both branches."""
    agrees(chain(kind, KINDS["hinge"], KINDS["slide"], KINDS["hinge"], kind))


def test_all_kinds_in_one_tree() -> None:
    agrees(chain(*KINDS.values()), 10)


def test_only_screws_leave_kinematics_to_pinocchio() -> None:
    native = {name for name, kind in KINDS.items() if chain(kind).tree_joints is not None}
    assert native == KINDS.keys() - {"screw"}


def test_far_from_the_origin() -> None:
    """A of a floating base does not depend on its position: 10 km away it is equal to rounding at that distance."""
    robot = hqp.robots.load("talos")
    native, rng = Native(robot), np.random.default_rng(7)
    q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
    q[:3] = 0.0
    near = native.at(q, v)["A"]
    q[:3] = 1e4, -1e4, 10.0
    np.testing.assert_allclose(native.at(q, v)["A"], near, rtol=0.0, atol=1e-9 * near.max())


def test_an_axis_that_moves_in_its_body_is_refused() -> None:
    with pytest.raises(ModelError, match="ellipsoid"):
        chain(pin.JointModelEllipsoid(0.1, 0.2, 0.3))


@pytest.mark.parametrize("kind", ["hinge", "continuous", "slide", "screw"])
def test_torque_ticks(kind: str) -> None:
    """Native ticks report the acceleration of forward dynamics; for a screw, with Pinocchio's placements."""
    robot = chain(KINDS[kind], KINDS["hinge"], KINDS["hinge"], KINDS["hinge"])
    hand = Position(frame="f1", law=PD(20.0, 9.0))
    run = hqp.Controller(Stack(Level(hand), Level(Posture())), hqp.Torque(), price=0, deadline=np.inf).session(
        robot, 0.001
    )
    rng = np.random.default_rng(2)
    for _ in range(6):
        q, v = robot.random_configuration(rng, 0.5), 0.1 * rng.normal(size=robot.nv)
        tick = run.step(robot.state(q, v), hand.at(np.array([0.3, 0.2, 0.5])))
        assert tick.status.solved
        qdd = (tick.advance()[1] - v) / run.dt
        moved = pin.aba(robot.model, robot.model.createData(), q, v, tick.command)
        np.testing.assert_allclose(qdd, moved, rtol=0.0, atol=1e-9 * float(np.abs(moved).max()))
