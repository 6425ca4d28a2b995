"""`hqp robots FILE` reports each joint with its limits, assumptions, and omissions."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hqp.robots
from hqp.__main__ import main
from hqp.robots.report import report

from .test_obstacles import Scene
from .test_urdf_faults import Drawn


def sections(text: str) -> dict[str, str]:
    found = {}
    for block in text.split("\n\n")[1:]:
        title, _, rest = block.partition("\n")
        found[title] = rest
    return found


@pytest.mark.parametrize("seed", range(5))
def test_a_urdf_is_reported(seed: int, tmp_path: Path, capsys: Any) -> None:
    drawn = Drawn(seed)
    extra = ['<transmission name="t"/>', "<gazebo/>", "<gazebo/>", "<ros2_control/>"]
    drawn.lines[-1:-1] = extra[: 1 + seed % 4]
    low = float(drawn.rng.uniform(-3, -1))
    at = drawn.find("<limit")
    drawn.lines[at] = f'<limit lower="{low}" upper="1" effort="0" velocity="2"/>'
    path = drawn.write(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the report prints warnings once
        assert main(["robots", str(path)]) == 0
    told = capsys.readouterr().out
    parts = sections(told)
    assert str(path) in told.splitlines()[0]
    assert list(parts) == ["Read", "Assumed", "Left out"]
    robot = quiet(path)
    for name in robot.joint_names:
        (row,) = [line for line in parts["Read"].splitlines() if line.split()[:1] == [name]]
        assert f"{robot.lower[robot.joints(name)[0]]:.4g}" in row
    joint = drawn.element(at).split("'")[1]
    assert f"no effort limit: {joint}" in parts["Assumed"]
    assert "gravity [0, 0, -9.81]" in parts["Assumed"]
    assert "<transmission>" in parts["Left out"]
    assert ("2 <gazebo>" in parts["Left out"]) == (seed % 4 >= 2)
    assert "damping" in parts["Left out"]


@pytest.mark.parametrize("seed", range(5))
def test_a_scene_is_reported(seed: int, tmp_path: Path, capsys: Any) -> None:
    drawn = Scene(seed, tmp_path)
    path = drawn.whole()
    assert main(["robots", str(path)]) == 0
    parts = sections(capsys.readouterr().out)
    for name in drawn.free:
        assert name in parts["Read"]
        assert name in parts["Left out"]
    assert "coupling: left_right" in parts["Read"]
    assert "tendons" not in parts["Left out"]  # its only tendon is fixed


@pytest.mark.parametrize("name", ["panda", "cbi", "go2"])
def test_robots_of_the_catalogue_are_reported(name: str, capsys: Any) -> None:
    assert main(["robots", name]) == 0
    told = capsys.readouterr().out
    robot = hqp.robots.load(name)
    assert all(joint in told for joint in robot.joint_names)
    assert f"{robot.mass:.4g} kg" in told


def test_without_a_file_the_names_are_listed(capsys: Any) -> None:
    assert main(["robots"]) == 0
    assert capsys.readouterr().out.split() == list(hqp.robots.names())


@pytest.mark.parametrize("losses", [(0.0, 0.0), (0.2, 0.0), (0.0, 0.3), (0.1, 0.4)])
def test_damping_and_friction_are_noted_whatever_the_format(losses: tuple[float, float], tmp_path: Path) -> None:
    damping, friction = losses
    drawn = Drawn(3)
    drawn.lines = [line.replace('damping=".1"', f'damping="{damping}" friction="{friction}"') for line in drawn.lines]
    body = f'<body name="a"><joint name="j1" damping="{damping}" frictionloss="{friction}"/><geom size=".1"/></body>'
    simulated = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    for robot in (hqp.robots.load(drawn.write(tmp_path)), hqp.robots.load(simulated)):
        notes = " ".join(robot.notes)
        assert ("damping" in notes) == (damping > 0.0)
        assert ("friction" in notes) == (friction > 0.0)
        assert "j1" in notes or not any(losses)
        np.testing.assert_array_equal(robot.state().bias_force(), robot.state(robot.home, 0 * robot.home).bias_force())
        assert "left" not in report(robot).split("\n")[0]


def quiet(path: Path) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return hqp.robots.load(path)


@pytest.mark.parametrize("count", range(1, 4))
def test_parts_that_the_robot_lacks_are_counted(count: int) -> None:
    parts = "".join(f'<camera name="c{k}"/><light name="l{k}"/><site name="s{k}"/>' for k in range(count))
    sensors = "".join(f'<accelerometer site="s{k}"/>' for k in range(count))
    body = f'<body><joint/><geom size=".1"/>{parts}</body>'
    text = f"<mujoco><worldbody>{body}</worldbody><sensor>{sensors}</sensor></mujoco>"
    found = sections(report(hqp.robots.load(mujoco.MjModel.from_xml_string(text))))["Left out"]
    for name in ("cameras", "lights", "sensors"):
        assert f"{count} {name}" in found
