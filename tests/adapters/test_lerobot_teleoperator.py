"""LeRobot's teleoperators lead a robot's hand; its own processors run on hqp's kinematics."""

from __future__ import annotations

import importlib
import inspect
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Controller, Follow, Level, P, Stack, Velocity
from hqp.adapters.lerobot import RobotKinematics
from hqp.adapters.lerobot_teleoperator import TeleoperatorReader
from hqp.errors import DeclarationError
from hqp.estimation.rotations import exponential
from hqp.tasks import JointLimits, Pose, Posture

DT = 0.002
PERIOD = 8
"""Ticks from one action to the next."""

BENT = np.deg2rad([10.0, -80.0, 90.0, -60.0, -70.0, 20.0])

HEAVY = ("torch", "draccus", "serial", "deepdiff", "huggingface_hub", "huggingface_hub.constants")


class Anything(ModuleType):
    """A missing package: every name of it is an empty class."""

    __path__: list[str] = []  # noqa: RUF012

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if name.startswith("HF_"):
            return "nowhere"
        return type(name, (), {"__class_getitem__": classmethod(lambda kind, item: kind)})


class Registry:
    @staticmethod
    def register(*_: Any, **__: Any) -> Any:
        return lambda kind: kind


class Step:
    transition: dict[Any, Any]


@pytest.fixture
def lerobot(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Import LeRobot's own modules without packages that the tests do not use."""
    pytest.importorskip("lerobot")
    before = set(sys.modules)
    processor = Anything("lerobot.processor")
    processor.ProcessorStepRegistry = Registry  # type: ignore[attr-defined]
    processor.RobotActionProcessorStep = Step  # type: ignore[attr-defined]
    keys = type("TransitionKey", (), {"OBSERVATION": "observation", "COMPLEMENTARY_DATA": "complementary_data"})
    processor.TransitionKey = keys  # type: ignore[attr-defined]
    missing = {name: Anything(name) for name in HEAVY if name not in sys.modules}
    for name, module in {**missing, "lerobot.processor": processor}.items():
        monkeypatch.setitem(sys.modules, name, module)
    for name in ("lerobot.motors", "lerobot.motors.motors_bus", "lerobot.utils.hub"):
        monkeypatch.setitem(sys.modules, name, Anything(name))
    for package in ("robots", "robots.so_follower", "teleoperators", "teleoperators.phone"):
        name = f"lerobot.{package}"
        bare = ModuleType(name)  # their __init__ imports every device
        bare.__path__ = [str(Path(importlib.import_module("lerobot").__path__[0], *package.split(".")))]
        monkeypatch.setitem(sys.modules, name, bare)
    for config in ("lerobot.teleoperators.config", "lerobot.teleoperators.phone.config_phone"):
        monkeypatch.setitem(sys.modules, config, Anything(config))
    phones = sys.modules["lerobot.teleoperators.phone.config_phone"]
    phones.PhoneOS = type("PhoneOS", (), {"IOS": "ios"})  # type: ignore[attr-defined]

    def load(name: str) -> Any:
        return importlib.import_module(f"lerobot.{name}")

    yield load
    for name in set(sys.modules) - before:
        if name.startswith("lerobot."):
            monkeypatch.delitem(sys.modules, name, raising=False)


class Arm:
    """UR5 with a hand behind a Follow, on a simulated clock."""

    def __init__(self, *, clutch: bool, scale: float = 1.0) -> None:
        self.robot = hqp.robots.load("ur5")
        self.hand = Pose(frame="tool0", law=P(20.0), name="hand")
        stack = Stack(Level(self.hand), Level(Posture()), subject_to=[JointLimits()])
        self.session = Controller(stack, Velocity(), deadline=math.inf).session(self.robot, DT)
        self.follow = Follow(self.hand, clutch=clutch, scale=scale)
        self.q, self.v, self.now = BENT, np.zeros(self.robot.nv), 0.0
        self.start = self.pose

    @property
    def pose(self) -> Any:
        return self.hand.value(self.robot.state(self.q))

    def goes(self, ticks: int) -> list[str]:
        notes = []
        for _ in range(ticks):
            self.now += DT
            state = self.robot.state(self.q, self.v)
            tick = self.session.step(state, self.follow.reference(state, self.now))
            self.q, self.v = tick.advance()
            notes += [note.detail for note in tick.notes]
        return notes


def led(arm: Arm, reader: TeleoperatorReader, actions: list[dict[str, Any]]) -> list[str]:
    """Send actions in turn, and run half a second more."""
    notes = []
    for action in actions:
        reader.take(action, received=arm.now)
        notes += arm.goes(PERIOD)
    for _ in range(30):
        reader.take({**actions[-1], **{k: 0.0 for k in actions[-1] if k.startswith("delta_")}}, received=arm.now)
        notes += arm.goes(PERIOD)
    return notes


def phone(position: Any, turn: Any, enabled: bool) -> dict[str, Any]:
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(turn)
    return {"phone.pos": np.array(position), "phone.rot": rotation, "phone.raw_inputs": {}, "phone.enabled": enabled}


def test_a_phone_leads_the_hand_and_its_zero_moves_without_a_jump() -> None:
    arm = Arm(clutch=True)
    reader = TeleoperatorReader(None, arm.follow, rate=0.0)
    ramp = np.concatenate((np.zeros(5), np.linspace(0.0, 0.1, 55)))  # a hand is accepted after three packets
    notes = led(arm, reader, [phone([0.0, x, 0.0], [0.0, 0.0, x], True) for x in ramp])
    assert arm.pose[:3, 3] == pytest.approx(arm.start[:3, 3] + [0.0, 0.1, 0.0], abs=1e-3)
    assert arm.pose[:3, :3] == pytest.approx(exponential(np.array([0.0, 0.0, 0.1])) @ arm.start[:3, :3], abs=2e-3)
    # The button opens, the phone moves back 0.3 m, and its positions begin at zero again when the button closes.
    away = [phone([0.0, 0.1 - 3.0 * x, 0.0], [0.0, 0.0, 0.1], False) for x in ramp]
    held = arm.pose
    notes += led(arm, reader, away)
    assert arm.pose == pytest.approx(held, abs=2e-3)
    notes += led(arm, reader, [phone([0.0, x, 0.0], [0.0, 0.0, 0.1], True) for x in ramp])
    assert arm.pose[:3, 3] == pytest.approx(arm.start[:3, 3] + [0.0, 0.2, 0.0], abs=3e-3)
    assert not [note for note in notes if "can be" in note]
    assert (reader.taken, reader.refused) == (3 * 60 + 3 * 30, 0)


def test_a_leader_arm_leads_by_its_pose_and_by_its_joints() -> None:
    arm = Arm(clutch=False)
    kinematics = RobotKinematics(arm.robot, "tool0")
    names = kinematics.joint_names
    home = np.rad2deg(arm.robot.state(BENT).angles[arm.robot.joints(names)])
    for kind in ("joints", "pose"):
        angles = home + np.linspace(0.0, 10.0, 60)[:, None]
        joints = [{f"{name}.pos": float(x) for name, x in zip(names, row, strict=True)} for row in angles]
        actions: list[dict[str, Any]] = [{**each, "gripper.pos": 20.0} for each in joints]
        if kind == "pose":
            arm = Arm(clutch=False)
            poses = [kinematics.forward_kinematics(row) for row in angles]
            log = arm.robot.log3
            actions = [
                dict(
                    zip(
                        [f"ee.{k}" for k in ("x", "y", "z", "wx", "wy", "wz")],
                        [*T[:3, 3], *log(T[:3, :3])],
                        strict=True,
                    )
                )
                for T in poses
            ]
        reader = TeleoperatorReader(None, arm.follow, kinematics=kinematics, rate=0.0)
        led(arm, reader, actions)
        assert arm.pose == pytest.approx(kinematics.forward_kinematics(angles[-1]), abs=2e-3)
        assert reader.refused == 0
    assert "ee.x" in reader.action


def test_increments_of_a_gamepad_add_up() -> None:
    arm = Arm(clutch=True)
    reader = TeleoperatorReader(None, arm.follow, rate=0.0, step=0.002)
    led(arm, reader, [{"delta_x": 0.0, "delta_y": y, "delta_z": -0.5 * y, "gripper": 1} for y in [0] * 5 + [1] * 50])
    assert arm.pose[:3, 3] == pytest.approx(arm.start[:3, 3] + [0.0, 0.1, -0.05], abs=1e-3)
    assert reader.action["gripper"] == 1


@pytest.mark.parametrize(
    "action",
    [
        {},
        {"phone.pos": None, "phone.rot": None, "phone.enabled": True},
        {"phone.pos": [0.0, 0.0, 0.0], "phone.rot": "turned", "phone.enabled": True},
        {"ee.x": 0.1},
        {"delta_x": np.nan, "delta_y": 0.0, "delta_z": 0.0},
        {"gripper.pos": 3.0},
    ],
)
def test_what_is_no_hand_is_refused_and_counted(action: dict[str, Any]) -> None:
    arm = Arm(clutch=True)
    reader = TeleoperatorReader(None, arm.follow, rate=0.0)
    reader.take(action, received=0.0)
    arm.goes(20)
    assert (reader.taken, reader.refused) == (0, 1)
    assert reader.fault
    assert arm.pose == pytest.approx(arm.start, abs=1e-12)


def test_a_teleoperator_of_theirs_is_read_by_a_thread(lerobot: Any) -> None:
    teleoperator = lerobot("teleoperators.teleoperator").Teleoperator
    calls: list[int] = []

    class Pad(teleoperator):  # type: ignore[misc]
        name = "pad"

        def __init__(self) -> None:  # theirs makes a folder for calibrations
            pass

        def get_action(self) -> dict[str, Any]:
            calls.append(1)
            if len(calls) < 4:
                raise ConnectionError("not yet")
            return {"delta_x": 0.0, "delta_y": 0.0, "delta_z": 1.0}

    Pad.__abstractmethods__ = frozenset()
    assert set(inspect.signature(teleoperator.get_action).parameters) == {"self"}
    arm = Arm(clutch=True)
    with TeleoperatorReader(Pad(), arm.follow, rate=200.0) as reader:
        limit = time.monotonic() + 10.0
        while reader.taken < 5 and time.monotonic() < limit:
            time.sleep(0.01)
    assert reader.refused == 3
    assert reader.taken >= 5
    assert "not yet" in reader.fault
    state = arm.robot.state(arm.q)
    assert arm.follow.reference(state).value is not None


def test_their_processors_run_on_our_kinematics(lerobot: Any) -> None:
    try:
        steps = lerobot("robots.so_follower.robot_kinematic_processor")
        mapped = lerobot("teleoperators.phone.phone_processor").MapPhoneActionToRobotAction(platform="ios")
    except ImportError as error:
        pytest.skip(f"before LeRobot's processors: {error}")
    robot = hqp.robots.load("ur5")
    kinematics = RobotKinematics(robot, "tool0")
    names = kinematics.joint_names
    sizes = dict.fromkeys("xyz", 1.0)
    chain = [
        mapped,
        steps.EEReferenceAndDelta(kinematics=kinematics, end_effector_step_sizes=sizes, motor_names=names),
        steps.EEBoundsAndSafety(end_effector_bounds={"min": [-2.0] * 3, "max": [2.0] * 3}),
        steps.GripperVelocityToJoint(),
        steps.InverseKinematicsEEToJoints(kinematics=kinematics, motor_names=names),
    ]
    degrees = np.rad2deg(robot.state(BENT).angles[robot.joints(names)])
    start = kinematics.forward_kinematics(degrees)
    for x in np.linspace(0.0, 0.05, 20):
        action = phone([0.0, -x, 0.0], [0.0, 0.0, 0.0], True)
        observation = {f"{name}.pos": float(d) for name, d in zip(names, degrees, strict=True)}
        for step in chain:
            step.transition = {"observation": observation, "complementary_data": {}}
            action = step.action(action)
        degrees = np.array([action[f"{name}.pos"] for name in names])
    moved = kinematics.forward_kinematics(degrees)
    assert moved[:3, 3] == pytest.approx(start[:3, 3] + [0.05, 0.0, 0.0], abs=1e-3)


def test_a_rate_and_a_step_are_checked() -> None:
    follow = Arm(clutch=True).follow
    for wrong in ({"rate": -1.0}, {"rate": np.nan}, {"step": 0.0}):
        with pytest.raises(DeclarationError):
            TeleoperatorReader(None, follow, **wrong)
