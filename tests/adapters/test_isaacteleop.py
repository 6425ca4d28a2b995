"""A stack as a node of IsaacTeleop's graph, behind its own sources and limiters."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("isaacteleop.retargeting_engine.interface", exc_type=ImportError)
from isaacteleop.retargeting_engine.interface import (
    ComputeContext,
    ExecutionEvents,
    ExecutionState,
    GraphTime,
    OptionalTensorGroup,
    TensorGroup,
)
from isaacteleop.retargeting_engine.tensor_types import ControllerInput, ControllerInputIndex

import hqp
from hqp import PD, Controller, Follow, Level, P, Stack, Velocity
from hqp.adapters.isaacteleop import TARGETS, StackRetargeter
from hqp.errors import DeclarationError
from hqp.tasks import JointLimits, Pose, Posture

BENT = np.deg2rad([10.0, -80.0, 90.0, -60.0, -70.0, 20.0])
RATE = 72.0


class Arm:
    """UR5's hand as a node, with frames at 72 Hz."""

    def __init__(self) -> None:
        self.robot = hqp.robots.load("ur5")
        self.hand = Pose(frame="tool0", law=P(20.0), name="hand")
        stack = Stack(Level(self.hand), Level(Posture()), subject_to=[JointLimits()])
        controller = Controller(stack, Velocity(), deadline=math.inf)
        follows = {"right": Follow(self.hand, clutch=True)}
        self.node = StackRetargeter("hqp", controller, self.robot, follows, start=BENT)
        self.frame = 0
        self.start = self.pose(BENT)

    def pose(self, q: Any) -> Any:
        return self.hand.value(self.robot.state(np.asarray(q, dtype=np.float64)))

    def context(self, *, reset: bool = False, state: ExecutionState = ExecutionState.RUNNING) -> ComputeContext:
        self.frame += 1
        now = 10**12 + round(self.frame * 1e9 / RATE)
        return ComputeContext(GraphTime(now, now), ExecutionEvents(reset, state))

    def run(self, shift: Any, **about: Any) -> Any:
        """A frame with the hand's pose as float32 in their layout, absent for None; the targets of the joints."""
        spec = self.node.input_spec()["right"]
        group = OptionalTensorGroup(spec)
        if shift is not None:
            group[0] = np.array([*shift, 0.0, 0.0, 0.0, 1.0], dtype=np.float32)
        found = self.node({"right": group}, self.context(**about))[TARGETS]
        return np.array([found[i] for i in range(len(found))])


def test_the_hand_goes_where_the_operators_does() -> None:
    arm = Arm()
    for y in [0.0] * 5 + list(np.linspace(0.0, 0.1, 60)) + [0.1] * 40:
        q = arm.run([0.0, y, 0.0])
    assert arm.pose(q)[:3, 3] == pytest.approx(arm.start[:3, 3] + [0.0, 0.1, 0.0], abs=1e-3)
    assert arm.pose(q)[:3, :3] == pytest.approx(arm.start[:3, :3], abs=1e-3)


def test_absent_poses_and_nan_hold_and_a_pause_opens_the_clutch() -> None:
    arm = Arm()
    for _ in range(20):
        q = arm.run([0.3, 0.0, 0.0])
    assert q == pytest.approx(BENT, abs=1e-5)
    for shift in ([np.nan] * 3, None):
        for _ in range(30):
            q = arm.run(shift)
    assert q == pytest.approx(BENT, abs=1e-5)
    assert arm.node.tick is not None
    assert any("held" in note.detail for note in arm.node.tick.notes)
    for x in np.linspace(0.3, 0.5, 100):
        q = arm.run([x, 0.0, 0.0], state=ExecutionState.PAUSED)
    assert q == pytest.approx(BENT, abs=1e-5)
    for x in np.linspace(0.5, 0.45, 60):
        q = arm.run([x, 0.0, 0.0])
    assert arm.pose(q)[0, 3] == pytest.approx(arm.start[0, 3] - 0.05, abs=4e-3)


def test_a_reset_begins_anew() -> None:
    arm = Arm()
    for y in [0.0] * 5 + list(np.linspace(0.0, 0.1, 60)) + [0.1] * 40:
        q = arm.run([0.0, y, 0.0])
    assert np.abs(q - BENT).max() > 0.05
    assert arm.run([0.0, 0.1, 0.0], reset=True) == pytest.approx(BENT, abs=1e-12)
    for _ in range(30):
        q = arm.run([0.0, 0.1, 0.0])
    assert q == pytest.approx(BENT, abs=1e-4)


def test_it_connects_to_their_sources_and_limiters() -> None:
    try:
        from isaacteleop.retargeters.controller_pose import ControllerPoseSource
        from isaacteleop.retargeters.rate_limiter import JointRateLimiter
    except ImportError as error:
        pytest.skip(f"before their sources of poses: {error}")
    arm = Arm()
    source = ControllerPoseSource("right_pose", input_device="controller_right")
    joints = arm.node.connect({"right": source.output("ee_pose")})
    limiter = JointRateLimiter("limiter", joint_names=list(arm.robot.joint_names))
    graph = limiter.connect({"joint_targets": joints.output(TARGETS)})
    I = ControllerInputIndex  # noqa: E741
    for y in [0.0] * 5 + list(np.linspace(0.0, 0.1, 60)) + [0.1] * 60:
        controller = TensorGroup(ControllerInput())
        for i, each in enumerate(ControllerInput().types):
            controller[i] = (
                False
                if "is_valid" in each.name
                else 0.0
                if not hasattr(each, "shape")
                else np.zeros(each.shape, dtype=np.float32)
            )
        controller[I.GRIP_POSITION] = np.array([0.0, y, 0.0], dtype=np.float32)
        controller[I.GRIP_ORIENTATION] = np.array([0.0, 0.0, 0.0, 1.0], dtype=np.float32)
        controller[I.GRIP_IS_VALID] = True
        found = graph.execute_pipeline({"right_pose": {"controller_right": controller}}, arm.context())["joint_targets"]
    q = [found[i] for i in range(len(found))]
    assert arm.pose(q)[:3, 3] == pytest.approx(arm.start[:3, 3] + [0.0, 0.1, 0.0], abs=2e-3)


def test_torques_are_refused() -> None:
    hand = Pose(frame="tool0", law=PD(100.0, 20.0), name="hand")
    controller = Controller(Stack(Level(hand), Level(Posture(law=PD(100.0, 20.0)))), hqp.Torque())
    with pytest.raises(DeclarationError, match="torques"):
        StackRetargeter("hqp", controller, hqp.robots.load("ur5"), {"right": Follow(hand)})
