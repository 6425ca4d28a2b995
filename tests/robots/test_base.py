"""Floating or fixed base: by file, by argument, with a warning for a robot that nothing supports."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
from hqp import Level, Stack
from hqp.__main__ import main
from hqp.commands.arguments import read_robot
from hqp.errors import ConfigurationNotFound, DeclarationError, ModelWarning
from hqp.tasks import Com, Damping, FixedContact, JointLimits, Momentum, Pose, Position, Posture

TOOL = Pose(frame="tool0", name="tool")


def source(name: str) -> Path:
    path = hqp.robots.load(name).source
    assert path is not None
    return path


def test_a_urdf_file_has_a_fixed_base_unless_a_free_one_is_asked_for() -> None:
    path = source("ur5")
    fixed, free = hqp.robots.load(path), hqp.robots.load(path, floating=True)
    assert (fixed.floating, fixed.nv) == (False, 6)
    assert (free.floating, free.nv) == (True, 12)
    assert hqp.robots.load(str(source("g1")), floating=None).nv == 29


@pytest.mark.parametrize("name", ["baxter", "ur5_robot", "ur3_gripper", "z1", "so100", "talos_left_arm", "TwoDofs"])
def test_arms_of_the_catalogue_stand_on_a_fixed_base(name: str) -> None:
    assert not hqp.robots.load(name).floating


@pytest.mark.parametrize("name", ["cbi", "talos", "go1", "human", "pr2", "quadruped", "iris", "tiago_no_hand"])
def test_legged_wheeled_and_flying_robots_of_the_catalogue_have_a_free_base(name: str) -> None:
    assert hqp.robots.load(name).floating


@pytest.mark.parametrize("name", ["cbi", "dreamer", "talos", "go2"])
def test_a_robot_of_the_catalogue_can_be_fixed(name: str) -> None:
    fixed, free = hqp.robots.load(name, floating=False), hqp.robots.load(name)
    assert fixed.nv == free.nv - 6
    assert fixed.joint_names == free.joint_names
    np.testing.assert_allclose(fixed.state().angles, free.state().angles[6:])


def test_the_base_of_a_pinocchio_model_is_what_it_is() -> None:
    model = pin.buildModelFromUrdf(str(source("ur5")))
    assert not hqp.robots.load(model, floating=False).floating
    with pytest.raises(DeclarationError, match="a free joint at the root"):
        hqp.robots.load(model, floating=True)


@pytest.mark.parametrize(("flag", "floating"), [((), False), (("--floating",), True), (("--fixed",), False)])
@pytest.mark.parametrize("command", ["view", "bench", "compare", "capsules"])
def test_every_command_that_reads_a_robot_takes_its_base(
    command: str, flag: tuple[str, ...], floating: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Read(Exception):
        pass

    def read(arguments: Any) -> None:
        assert read_robot(arguments).floating is floating
        raise Read

    monkeypatch.setattr("hqp.__main__.read_robot", read)
    monkeypatch.setattr("hqp.commands.arguments.read_robot", read)
    monkeypatch.setattr("hqp.serial.load", lambda path: None)
    robot = str(source("ur5"))
    with pytest.raises(Read):
        main([command, robot, *flag] if command == "capsules" else [command, "stack.toml", "--robot", robot, *flag])


def parsed(robot: str, home: str) -> argparse.Namespace:
    return argparse.Namespace(robot=robot, floating=None, home=home)


def test_a_command_begins_where_home_says() -> None:
    angles = (0.3, -1.4, 1.5, -1.2, -1.3, 0.2)
    ur5 = read_robot(parsed("ur5", ",".join(map(str, angles))))
    np.testing.assert_allclose(ur5.state().angles, angles)
    g1 = hqp.robots.load("g1")
    bent = g1.state().angles[g1.actuated] + 0.01
    found = read_robot(parsed("g1", ",".join(map(str, bent))))
    np.testing.assert_allclose(found.state().angles[g1.actuated], bent)
    np.testing.assert_array_equal(found.home[:7], g1.home[:7])
    assert np.any(read_robot(parsed("talos", "half_sitting")).home)
    with pytest.raises(DeclarationError, match=r"--home: 2 numbers .*6 numbers, for shoulder_pan_joint, "):
        read_robot(parsed("ur5", "1,2"))
    with pytest.raises(ConfigurationNotFound, match="'stnd'"):
        read_robot(parsed("ur5", "stnd"))


def told(robot: Any, *levels: Level, subject_to: Any = ()) -> list[str]:
    """Warnings of a session's start; its first tick has them as notes."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        controller = hqp.Controller(Stack(*levels, subject_to=subject_to), deadline=float("inf"))
        session = controller.session(robot, dt=0.002)
    texts = [str(w.message) for w in caught if issubclass(w.category, ModelWarning)]
    first = session.step(robot.state())
    assert [note.detail for note in first.notes if note.element == "base"] == texts
    assert first.status is hqp.Status.OPTIMAL
    assert not session.step(robot.state(*first.advance())).notes
    return texts


@pytest.mark.parametrize("below", [(), (Level(Posture()),), (Level(Damping()),), (Level(Com()),)])
def test_a_floating_base_that_nothing_holds_is_told(below: tuple[Level, ...]) -> None:
    (text,) = told(hqp.robots.load("ur5", floating=True), Level(TOOL), *below, subject_to=[JointLimits()])
    assert text.startswith("no contact and no task holds the floating base of ur5: tool")
    assert "floating=False" in text
    assert "--fixed" in text


HELD: dict[str, tuple[str, list[Level], list[Any]]] = {
    "fixed": ("ur5", [Level(TOOL)], []),
    "task on the base": ("ur5 free", [Level(TOOL), Level(Pose(frame="base_link"))], []),
    "momentum": ("ur5 free", [Level(TOOL)], [Momentum()]),
    "contact": ("g1", [Level(Position(frame="left_wrist_yaw_link"))], [FixedContact(frame="left_sole")]),
    "contact in a level": ("g1", [Level(FixedContact(frame="left_sole")), Level(Com())], []),
    "nothing pulls": ("g1", [Level(Posture())], [JointLimits()]),
    "relative": ("g1", [Level(Position(frame="left_wrist_yaw_link", relative_to="pelvis"))], []),
}


@pytest.mark.parametrize("case", HELD)
def test_a_base_that_is_held_or_not_pulled_is_not_told(case: str) -> None:
    name, levels, subject_to = HELD[case]
    robot = hqp.robots.load(name.split()[0], floating=True if name.endswith("free") else None)
    assert told(robot, *levels, subject_to=subject_to) == []
