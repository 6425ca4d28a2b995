"""SRDF files of a URDF: named poses, disabled pairs, errors and warnings."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hqp
import hqp.robots
from hqp.errors import ConfigurationNotFound, DeclarationError, ModelError, ModelWarning
from hqp.shapes import LinkCapsule
from hqp.tasks import CollisionAvoidance
from hqp.tasks.collision_pairs import candidates

LINKS = 7
LINK = """<link name="l{0}"><inertial><mass value="1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.05 0.05 0.1"/></geometry></collision></link>"""
JOINT = """<joint name="j{1}" type="{2}"><parent link="l{0}"/><child link="l{1}"/>
<origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1.5" velocity="2" effort="30"/></joint>"""
STATES = """<group name="arm"><chain base_link="l0" tip_link="l6"/></group>
<group_state name="ready" group="arm"><joint name="j1" value="0.5"/><joint name="j3" value="-0.7"/></group_state>
<group_state name="turned" group="arm"><joint name="j6" value="2"/></group_state>"""
PAIRS = """<disable_collisions link1="l1" link2="l5" reason="Never"/><disable_collisions link1="l6" link2="l2"/>"""


def write(folder: Path, text: str | None, name: str = "arm.srdf") -> Path:
    """Chain of six joints, the last one continuous, and an SRDF with the given text."""
    path = folder / "arm.urdf"
    joints = [JOINT.format(i, i + 1, "revolute" if i + 2 < LINKS else "continuous") for i in range(LINKS - 1)]
    path.write_text(f'<robot name="arm">{"".join([*map(LINK.format, range(LINKS)), *joints])}</robot>')
    if text is not None:
        (folder / name).write_text(f'<robot name="arm">{text}</robot>')
    return path


def kept_apart(robot: Any) -> set[frozenset[str]]:
    """Pairs of links with a row, of capsules around all moving links."""
    own = [LinkCapsule(f"l{k}", k, (0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 0.03) for k in range(1, LINKS)]
    capsules, pairs, *_ = candidates(CollisionAvoidance(), robot.with_capsules(own), (), "auto", 0.01)
    return {frozenset(capsules[k].name for k in pair) for pair in pairs}


def test_group_states_are_configurations(tmp_path: Path) -> None:
    robot = hqp.robots.load(write(tmp_path, STATES + PAIRS))
    np.testing.assert_array_equal(robot.configuration("ready"), [0.5, 0.0, -0.7, 0.0, 0.0, 1.0, 0.0])
    np.testing.assert_allclose(robot.configuration("turned")[5:], [np.cos(2.0), np.sin(2.0)])
    np.testing.assert_array_equal(robot.home, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    assert "configurations: ready, turned" in str(robot)
    with pytest.raises(ConfigurationNotFound, match=r"'redy'.*ready"):
        robot.configuration("redy")
    free = hqp.robots.load(tmp_path / "arm.urdf", floating=True)
    np.testing.assert_array_equal(free.configuration("ready")[7:], robot.configuration("ready"))


def test_disabled_pairs_are_those_that_pinocchio_removes(tmp_path: Path) -> None:
    path = write(tmp_path, STATES + PAIRS)
    robot = hqp.robots.load(path)
    model, geometry = robot.model, robot.geometry
    geometry.addAllCollisionPairs()
    pin.removeCollisionPairs(model, geometry, str(path.with_suffix(".srdf")))
    left = [(geometry.geometryObjects[p.first], geometry.geometryObjects[p.second]) for p in geometry.collisionPairs]
    bodies = [(a.parentJoint, b.parentJoint) for a, b in left]
    enabled = {frozenset((f"l{a}", f"l{b}")) for a, b in bodies}
    found = kept_apart(robot)
    assert found <= enabled
    (tmp_path / "arm.srdf").unlink()
    every = kept_apart(hqp.robots.load(path))
    assert found == every & enabled
    assert every - found == {frozenset(("l1", "l5")), frozenset(("l2", "l6"))}
    assert kept_apart(robot.copy()) == found


def test_an_srdf_elsewhere_comes_before_the_one_beside(tmp_path: Path) -> None:
    path = write(tmp_path, STATES)
    other = write(tmp_path, PAIRS, "other.srdf").with_name("other.srdf")
    robot = hqp.robots.load(path, srdf=other)
    assert not robot.configurations
    assert len(robot.disabled_pairs) == 2


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            '<group_state name="a"><joint name="j1" value="x"/></group_state>',
            r"'a', joint 'j1': value='x' is not a number",
        ),
        ('<group_state name="a"><joint name="j1" value="nan"/></group_state>', r"value='nan' is not a number"),
        ('<group_state name="a"><joint name="j6" value="1 0"/></group_state>', r"'j6': value='1 0'"),
        ('<group_state name="a"><joint name="j1"/></group_state>', r"'j1': value='None'"),
        ('<group_state><joint name="j1" value="1"/></group_state>', r"arm.srdf, line 1: <group_state> has no name"),
        ("<group_state", r"arm.srdf"),
        ('<Group_State name="a"/>', r"arm.srdf, line 1: <Group_State> is unknown; allowed: <group_state>"),
        ('<disable_collisions link1="base"/>', r"arm.srdf, line 1: <disable_collisions> has no link2"),
    ],
    ids=["word", "nan", "two", "none", "nameless", "broken", "case", "half a pair"],
)
def test_refused_by_name(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(ModelError, match=told):
        hqp.robots.load(write(tmp_path, text))


def test_what_is_passed_over_is_warned_of(tmp_path: Path) -> None:
    more = '<group_state name="ready" group="hand"><joint name="finger" value="1"/></group_state>'
    with pytest.warns(ModelWarning) as told:
        robot = hqp.robots.load(write(tmp_path, STATES + more))
    twice, unknown = (str(w.message) for w in told)
    assert "2 group states 'ready', using the first" in twice
    assert "unknown or fixed joints: finger" in unknown
    assert robot.configuration("ready")[0] == 0.5


def test_an_srdf_goes_with_a_urdf(tmp_path: Path) -> None:
    path = write(tmp_path, None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not hqp.robots.load(path).configurations
    with pytest.raises(ModelError, match=r"no such file: .*arm\.srdf"):
        hqp.robots.load(path, srdf=path.with_suffix(".srdf"))
    for source in ("panda", "arm.xml", pin.Model()):
        with pytest.raises(DeclarationError, match="needs a URDF"):
            hqp.robots.load(source, srdf="arm.srdf")
