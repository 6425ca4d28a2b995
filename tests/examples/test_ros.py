"""The ROS 2 examples against stand-ins with the same signatures: ROS 2 itself is on no package index."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import serial
from tests.scenes.stacks import scene

ROOT = Path(__file__).parents[2]


class Node:
    """Stand-in for the node of rclpy, with the methods that the example calls."""

    def __init__(self, name: str) -> None:
        self.taken: dict[str, Any] = {}
        self.timers: list[tuple[float, Any]] = []
        self.sent: list[Any] = []

    def create_subscription(self, kind: Any, topic: str, take: Any, depth: int) -> None:
        self.taken[topic] = take

    def create_publisher(self, kind: Any, topic: str, depth: int) -> Any:
        return SimpleNamespace(publish=self.sent.append)

    def create_timer(self, period: float, call: Any) -> None:
        self.timers.append((period, call))

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=lambda *text, **options: pytest.fail(str(text)))


class Message:
    """Any message: fields by keyword, others made when they are set."""

    def __init__(self, **fields: Any) -> None:
        self.time_from_start = SimpleNamespace(nanosec=0)
        vars(self).update(fields)


def node_module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The example, imported beside stand-ins."""
    parts = {
        "rclpy": {}, "rclpy.node": {"Node": Node}, "sensor_msgs": {}, "sensor_msgs.msg": {"JointState": Message},
        "trajectory_msgs": {}, "trajectory_msgs.msg": {"JointTrajectory": Message, "JointTrajectoryPoint": Message},
    }  # fmt: skip
    for name, fields in parts.items():
        module = ModuleType(name)
        vars(module).update(fields)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("ros2_node", ROOT / "examples" / "ros2_node.py")
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def test_the_node_sends_what_its_session_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Accept any order of the driver's joints."""
    robot = hqp.robots.load("ur5")
    session, _ = scene("ur5")
    stack = tmp_path / "stack.toml"
    stack.write_text(serial.dumps(session.controller.stack))
    node = node_module(monkeypatch).StackNode(str(stack), "ur5")
    ((period, step),) = node.timers
    step()
    assert node.sent == []  # no state so far
    angles = robot.state(robot.home).angles + 0.1
    order = np.random.default_rng(0).permutation(robot.nv)
    names = [robot.joint_names[k] for k in order]
    node.taken["joint_states"](SimpleNamespace(name=names, position=angles[order].tolist()))
    mine = hqp.Controller(serial.load(stack)).session(robot, period)
    q, v = robot.integrate(robot.home, np.full(robot.nv, 0.1), 1.0), np.zeros(robot.nv)
    for _ in range(50):
        step()
        tick = mine.step(robot.state(q, v))
        q, v = tick.advance()
    (point,) = node.sent[-1].points
    assert node.sent[-1].joint_names == list(robot.joint_names)
    np.testing.assert_array_equal(point.velocities, tick.command)
    np.testing.assert_array_equal(point.positions, robot.state(q).angles[robot.actuated])
    assert point.time_from_start.nanosec == round(1e9 * period)


@pytest.mark.long
def test_the_controller_compiles() -> None:
    """``make test-cpp`` links it and compares its loop with Python's."""
    drive = ROOT / "tests" / "examples" / "ros" / "drive.cpp"
    folders = ("-I", drive.parent, "-I", ROOT / "hqp" / "cpp" / "session")
    options = ("-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only")
    told = subprocess.run(["c++", *options, *folders, drive], capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
