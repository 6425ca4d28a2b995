"""A humanoid outside the catalogue: the walker finds its feet by their shapes."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.__main__ import main
from hqp.errors import DeclarationError, ModelError, ModelWarning
from hqp.robots.soles import feet, sole, standing_axes
from hqp.walking import Walker
from hqp.walking.course import Course
from hqp.walking.feet import feet_of


@pytest.mark.long
@pytest.mark.parametrize("name", ["talos", "g1", "romeo", "icub"])
def test_feet_are_those_of_the_catalogue(name: str) -> None:
    """Left and right, at any heading of the base, with a level frame and a sole."""
    known = hqp.robots.load(name)
    links = [known.model.frames[known.frame(s)].parentJoint for s in known.landmarks["soles"]]
    for yaw in (0.0, 2.0, np.pi):
        robot = hqp.robots.load(known.source, floating=True)
        home = robot.home.copy()
        home[3:7] = 0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw)
        robot.set_home(home)
        robot, soles = feet(robot)
        assert [robot.model.names[robot.model.frames[robot.frame(s)].parentJoint] for s in soles] == [
            known.model.names[joint] for joint in links
        ]
        for frame in soles:
            assert robot.state(robot.home).rotation(frame)[2, 2] > 0.99
            assert len(sole(robot, frame)) >= 3


@pytest.mark.parametrize("name", ["g1", "cbi", "romeo"])
def test_exchanged_soles_are_told(name: str) -> None:
    """Exchanged ones are taken, with a warning; both soles of one leg are no biped."""
    robot = hqp.robots.load(name)
    left, right = robot.landmarks["soles"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        feet_of(robot, (left, right))
    with pytest.warns(ModelWarning, match=f"face back with {right} as the left sole"):
        assert feet_of(robot, (right, left))[0].frame == right
    with pytest.raises(DeclarationError, match="and not the other sole"):
        feet_of(robot, (left, left))
    joint = robot.body(robot.frame(left))
    with pytest.raises(ModelError, match="joints of one leg"):
        standing_axes(robot, joint, joint)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_bent_knees_do_not_turn_a_robot_on_point_feet(seed: int) -> None:
    """A ball below a knee that is bent forwards or backwards does not show which way is ahead."""
    robot, rng = hqp.robots.load("bolt", floating=True), np.random.default_rng(seed)
    angles, bend = robot.state(robot.home).angles.copy(), rng.uniform(-1.2, 1.2)
    for side in ("FL", "FR"):
        hip, knee = robot.joints([f"{side}_HFE", f"{side}_KFE"])
        angles[hip], angles[knee] = -0.5 * bend, bend
    robot.set_home(robot.configuration(angles))
    robot, soles = feet(robot)
    assert [frame[:2] for frame in soles] == ["FL", "FR"]


@pytest.mark.long
@pytest.mark.parametrize("name", ["icub", *(pytest.param(n, marks=pytest.mark.slow) for n in ("talos", "g1", "romeo"))])
def test_links_do_not_push_each_other_apart_at_the_start(name: str) -> None:
    """Load files whose home has straight legs; convex hulls of iCub's thigh and chest overlap as it is lowered."""
    robot, soles = feet(hqp.robots.load(hqp.robots.load(name).source, floating=True, rotors=True))
    course = Course(Walker(robot, soles=soles))
    model, begun = course.plant.model, course.plant.com()
    for _ in range(200):
        course.step()
        assert (model.geom_bodyid[course.plant.data.contact.geom] == 0).any(axis=1).all()
    assert np.linalg.norm(course.plant.com() - begun) < 5e-3


@pytest.mark.long
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("free", [(True, True), (True, False), (False, True)])
def test_knees_without_limits_do_not_show_which_way_is_ahead(free: tuple[bool, bool]) -> None:
    """A lower, an upper limit or both are missing: numpy warned of inf - inf in place of a walk."""
    robot = hqp.robots.load("g1")
    for side in ("left", "right"):
        column = int(robot.joints([f"{side}_knee_joint"])[0])
        robot.lower[column], robot.upper[column] = np.where(free, (-np.inf, np.inf), (-0.1, 2.8))
    frames = robot.landmarks["soles"]
    found = [robot.model.frames[robot.frame(frame)].parentJoint for frame in feet(robot)[1]]
    assert found == [robot.model.frames[robot.frame(frame)].parentJoint for frame in frames]


def test_a_robot_whose_base_is_below_its_links_has_no_feet() -> None:
    """Baxter's pedestal stands on the floor; its lowest other links are its shoulders."""
    with pytest.raises(ModelError, match="base is below"):
        feet(hqp.robots.load("baxter", floating=True))


@pytest.mark.parametrize("name", ["go2", "ur5"])
def test_what_has_no_two_feet_is_refused(name: str) -> None:
    robot = hqp.robots.load(hqp.robots.load(name).source, floating=True)
    with pytest.raises(ModelError, match="name the soles"):
        feet(robot)


@pytest.mark.slow
def test_it_walks_from_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a URDF under another name: no entry of the catalogue helps."""
    pytest.importorskip("mujoco")
    source = Path(hqp.robots.load("talos").source)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(next(p for p in source.parents if p.name == "share")))
    own = tmp_path / "somebody.urdf"
    shutil.copy(source, own)
    assert main(["walk", "--robot", str(own), "--seconds", "3"]) == 0
    assert "soles of" in capsys.readouterr().out


@pytest.mark.parametrize("loads", [(), (300.0,), (300.0, 300.0, 0.0), ((300.0, 300.0),)])
def test_loads_are_one_for_each_foot(loads: Any) -> None:
    """A plant that watches no foot measures none: the error names the remedy."""
    walker = Walker(hqp.robots.load("talos", rotors=True))
    state = walker.robot.state(walker.start)
    with pytest.raises(DeclarationError, match=r"walker: loads .*watched=\[foot.frame for foot in walker.feet\]"):
        walker.step(state, loads)
    assert walker.step(state, (300.0, 300.0)).status.solved
