"""The axes of base and sole frames do not matter: ahead is across the line of the hips."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp.motion.suggestion import suggest_map
from hqp.robots.soles import feet
from hqp.walking import Gait, Walker

GAIT = Gait(single=0.4, double=0.1, first=0.4)


def other_frames(robot: Any, quarters: tuple[int, int]) -> tuple[Any, tuple[str, ...]]:
    """The robot with frames of its soles turned about their normals, and their names."""
    names = []
    for frame, quarter in zip(robot.landmarks["soles"], quarters, strict=True):
        turn = pin.SE3(pin.utils.rotate("z", 0.5 * np.pi * quarter), np.zeros(3))
        robot = robot.with_frame(f"{frame}_turned", frame, turn)
        names.append(f"{frame}_turned")
    return robot, tuple(names)


def way(walker: Walker) -> Any:
    """CoM from its start ``(frames, 3)`` [m], ahead, aside and turning."""
    walker.go(0.15, 0.05, 0.2)
    coms = np.array([walker.robot.state(q).com() for q in walker.plan(3.6, fps=25.0).q])
    assert np.linalg.norm(coms[-1] - coms[0]) > 0.05
    return coms - coms[0]


def with_turned_base(source: Path, folder: Path, turn: float) -> Path:
    """A URDF file whose root link has axes turned about the vertical."""
    root = ET.parse(source).getroot()
    children = {joint.find("child").get("link") for joint in root.findall("joint")}  # type: ignore[union-attr]
    (base,) = (link.get("name", "") for link in root.findall("link") if link.get("name") not in children)
    ET.SubElement(root, "link", name="turned_base")
    joint = ET.SubElement(root, "joint", name="turn_of_base", type="fixed")
    ET.SubElement(joint, "origin", xyz="0 0 0", rpy=f"0 0 {turn}")
    ET.SubElement(joint, "parent", link="turned_base")
    ET.SubElement(joint, "child", link=base)
    path = folder / source.name
    ET.ElementTree(root).write(path)
    return path


@pytest.mark.long
@pytest.mark.parametrize("quarters", [(1, 1), (2, 2), (3, 1)])
@pytest.mark.parametrize("name", ["g1", pytest.param("talos", marks=pytest.mark.slow)])
def test_turned_frames_of_soles_walk_the_same_way(name: str, quarters: tuple[int, int]) -> None:
    robot = hqp.robots.load(name, rotors=True)
    turned, soles = other_frames(robot, quarters)
    np.testing.assert_allclose(way(Walker(turned, GAIT, soles=soles)), way(Walker(robot, GAIT)), atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.5, 0.5 * np.pi, np.pi])
def test_a_turned_base_walks_the_same_way(turn: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot faces where its file turns it: the way is turned with it, and left is left."""
    source = Path(str(hqp.robots.load("g1").source))
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(next(p for p in source.parents if p.name == "share")))
    robot = hqp.robots.load(with_turned_base(source, tmp_path, turn), floating=True, rotors=True)
    robot, soles = feet(robot)
    joints = [robot.model.names[robot.body(robot.frame(sole))] for sole in soles]
    assert joints == ["left_ankle_roll_joint", "right_ankle_roll_joint"]
    found = way(Walker(robot, GAIT, soles=soles)) @ pin.utils.rotate("z", turn)
    known = hqp.robots.load(source, floating=True, rotors=True)
    maps = suggest_map(robot).frames, suggest_map(known).frames
    assert {**maps[0], "pelvis": ""} == {**maps[1], "pelvis": ""}
    np.testing.assert_allclose(found, way(Walker(known, GAIT, soles=feet(known)[1])), atol=1e-5)
