"""Robots outside the catalogue: soles by their lowest shapes, a report by all shapes of the feet."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.errors import DeclarationError
from hqp.motion import Motion, SkeletonMap, branches, retarget, shortfalls, skeleton_map
from hqp.motion.body import Body
from hqp.motion.skeleton_map import find_map
from hqp.motion.suggestion import suggest_map
from hqp.motion.tracker import LEAN, OFF

from .people import stand

mujoco = pytest.importorskip("mujoco")

TURNS = {
    "up": "1 0 0 0",
    "ahead": "0.7071068 0 0.7071068 0",
    "down": "0 1 0 0",
    "aslant": "0.9238795 0.2296101 0.3061467 0",
}
"""Rotations of the feet's bodies, wxyz; their shapes stay level."""


def _humanoid(path: Path, turn: str, drop: float, arms: tuple[str, str] = ("", "")) -> Path:
    """Two legs of six joints and two arms of four if none are given; the soles are boxes ``drop`` below the ankles."""
    w, x, y, z = (float(word) for word in turn.split())
    back = f"{w} {-x} {-y} {-z}"

    def foot(side: str) -> str:
        at = _turned(back, (0.03, 0.0, -drop + 0.01))
        return (
            f'<body name="{side}_foot" pos="0 0 -.34" quat="{turn}">'
            f'<joint name="{side}_ankle_pitch" axis="{_turned(back, (0, 1, 0))}" range="-.9 .6"/>'
            f'<joint name="{side}_ankle_roll" axis="{_turned(back, (1, 0, 0))}" range="-.3 .3"/>'
            f'<geom type="box" pos="{at}" quat="{back}" size=".11 .045 .01" mass=".8"/></body>'
        )

    def leg(side: str, y: float) -> str:
        joints = (("yaw", "0 0 1", "-.8 .8"), ("roll", "1 0 0", "-.6 .6"), ("pitch", "0 1 0", "-1.8 1"))
        own = "".join(f'<joint name="{side}_hip_{n}" axis="{a}" range="{r}"/>' for n, a, r in joints)
        return (
            f'<body name="{side}_hip" pos="0 {y} 0">{own}<geom type="sphere" size=".05" mass="1.5"/>'
            f'<body name="{side}_shank" pos="0 0 -.36"><joint name="{side}_knee" axis="0 1 0" range="0 2.2"/>'
            f'<geom type="capsule" fromto="0 0 -.05 0 0 -.25" size=".04" mass="3"/>{foot(side)}</body></body>'
        )

    def arm(side: str, y: float) -> str:
        return (
            f'<body name="{side}_arm" pos="0 {y} .42"><joint name="{side}_shoulder_pitch" axis="0 1 0" range="-3 1.5"/>'
            f'<joint name="{side}_shoulder_roll" axis="1 0 0" range="-2.5 2.5"/>'
            f'<geom type="capsule" fromto="0 0 -.05 0 0 -.2" size=".03" mass="1.2"/>'
            f'<body name="{side}_forearm" pos="0 0 -.25"><joint name="{side}_elbow" axis="0 1 0" range="-2.2 0"/>'
            f'<geom type="capsule" fromto="0 0 -.05 0 0 -.18" size=".03" mass=".8"/>'
            f'<body name="{side}_hand" pos="0 0 -.24"><joint name="{side}_wrist" axis="1 0 0" range="-.8 .8"/>'
            f'<geom type="sphere" size=".03" mass=".3"/></body></body></body>'
        )

    path.write_text(
        '<mujoco><compiler angle="radian" autolimits="true"/><worldbody>'
        f'<body name="trunk" pos="0 0 {0.70 + drop}"><freejoint/>'
        '<geom type="box" pos="0 0 .22" size=".08 .1 .18" mass="14"/>'
        f"{leg('left', 0.1)}{leg('right', -0.1)}"
        f"{arms[0] or arm('left', 0.2)}{arms[1] or arm('right', -0.2)}</body></worldbody></mujoco>"
    )
    return path


def _arm(side: str, rng: np.random.Generator, *, hangs: bool, wrist: bool) -> str:
    """An arm that hangs or points aside: pitch and roll of the shoulder, a turn of the upper arm, elbow, and a wrist or
    a forearm whose link has no joint behind the elbow.
    """
    sign = 1.0 if side == "left" else -1.0
    way = np.array([0.0, 0.0, -1.0] if hangs else [0.0, sign, 0.0])
    upper, fore, out = rng.uniform(0.15, 0.3), rng.uniform(0.15, 0.3), sign * rng.uniform(0.03, 0.08)
    turns, bends = f"{way[0]} {way[1]} {way[2]}", "0 1 0" if hangs else "0 0 1"

    def link(name: str, place: Any, axis: str, reach: float, inner: str = "") -> str:
        x, y, z = (0.8 * reach * way).tolist()
        return (
            f'<body name="{side}_{name}" pos="{" ".join(map(str, place))}"><joint name="{side}_{name}_joint" '
            f'axis="{axis}" range="-1 1"/><geom type="capsule" fromto="0 0 0 {x} {y} {z}" size=".02" mass=".3"/>'
            f"{inner}</body>"
        )

    hand = link("hand", fore * way, bends, 0.12) if wrist else ""
    turned = rng.uniform(0.2, 0.6) * upper
    lower = link("forearm", (upper - turned) * way, bends, fore, hand)
    roll = link("roll", (0.0, out, 0.0), "1 0 0", turned, link("turn", turned * way, turns, upper - turned, lower))
    return link("pitch", (0.0, 0.2 * sign, 0.42), "0 1 0", 0.03, roll)


def _turned(quat: str, vector: tuple[float, ...]) -> str:
    found = np.zeros(3)
    mujoco.mju_rotVecQuat(found, np.array(vector, dtype=float), np.array([float(word) for word in quat.split()]))
    return " ".join(f"{x:.6f}" for x in found)


def _lowest(path: Path, q: Any) -> float:
    """Lowest point of any shape by MuJoCo, over all frames [m]."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, least = mujoco.MjData(model), np.inf
    for row in q:
        data.qpos[:] = [*row[:3], row[6], *row[3:6], *row[7:]]
        mujoco.mj_kinematics(model, data)
        for k in range(model.ngeom):
            R, size = data.geom_xmat[k].reshape(3, 3), model.geom_size[k]
            kind = model.geom_type[k]
            half = size @ np.abs(R[2]) if kind == mujoco.mjtGeom.mjGEOM_BOX else size[0]
            half += size[1] * abs(R[2, 2]) if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
            least = min(least, float(data.geom_xpos[k, 2] - half))
    return least


@pytest.mark.long
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("drop", [0.03, 0.08])
def test_soles_are_at_the_lowest_shapes(tmp_path: Path, turn: str, drop: float) -> None:
    path = _humanoid(tmp_path / "somebody.xml", TURNS[turn], drop)
    robot = hqp.robots.load(path)
    found = suggest_map(robot)
    body = Body.of(robot, found)
    for side, y in (("left", 0.1), ("right", -0.1)):
        np.testing.assert_allclose(body.places[f"{side}_sole"], [0.03, y, 0.0], atol=1e-4)
        np.testing.assert_allclose(body.toes[side], [0.11, 0.0, 0.0], atol=1e-4)
        assert [round(x, 6) for x in found.offsets[f"{side}_sole"]] == [
            *found.offsets[f"{side}_sole"]
        ]  # um in its file


@pytest.mark.parametrize("seed", range(4))
def test_arms_with_and_without_wrists(tmp_path: Path, seed: int) -> None:
    rng, hangs, wrist = np.random.default_rng(seed), seed % 2 == 0, seed % 4 < 2
    left, right = (_arm(side, np.random.default_rng(seed), hangs=hangs, wrist=wrist) for side in ("left", "right"))
    robot = hqp.robots.load(_humanoid(tmp_path / "somebody.xml", TURNS["up"], rng.uniform(0.03, 0.08), (left, right)))
    found = suggest_map(robot)
    body = Body.of(robot, found)
    for side in ("left", "right"):
        links = [found.frames[f"{side}_{part}"] for part in ("shoulder", "elbow", "hand")]
        assert links == [f"{side}_{link}" for link in ("roll", "forearm", "hand" if wrist else "forearm")]
        rng = np.random.default_rng(seed)
        upper, fore = rng.uniform(0.15, 0.3), rng.uniform(0.15, 0.3)
        assert body.length("shoulder", "elbow") == pytest.approx(upper, abs=1e-3)
        assert body.length("elbow", "hand") == pytest.approx(fore if wrist else 0.8 * fore, abs=1e-2)


@pytest.mark.parametrize("seed", range(6))
def test_a_robot_that_does_not_stand_at_home_has_no_map(tmp_path: Path, seed: int) -> None:
    """Lying on any side or upside down, as models whose y axis is up do."""
    rng = np.random.default_rng(seed)
    robot = hqp.robots.load(_humanoid(tmp_path / "somebody.xml", TURNS["up"], 0.05))
    angle, tilt = rng.uniform(-np.pi, np.pi), rng.uniform(1.5, np.pi)
    home = robot.home.copy()
    home[3:7] = [*(np.sin(0.5 * tilt) * np.array([np.cos(angle), np.sin(angle), 0.0])), np.cos(0.5 * tilt)]
    robot.set_home(home)
    with pytest.raises(DeclarationError, match="suggest-map"):
        suggest_map(robot)


@pytest.mark.slow
def test_nothing_is_below_the_floor(tmp_path: Path) -> None:
    path = _humanoid(tmp_path / "somebody.xml", TURNS["ahead"], 0.08)
    robot = hqp.robots.load(path)
    done = retarget(stand(0.4), robot, map=suggest_map(robot), collision=False)
    assert _lowest(path, done.q) > -2e-3
    assert done.measures.penetration.max() == pytest.approx(max(0.0, -_lowest(path, done.q)), abs=1e-3)


@pytest.mark.slow
def test_the_report_is_about_shapes_not_the_map(tmp_path: Path) -> None:
    """The soles of the map are 50 mm too high: the shapes are below the floor, and the report has their depth."""
    path = _humanoid(tmp_path / "somebody.xml", TURNS["up"], 0.08)
    robot = hqp.robots.load(path)
    found = suggest_map(robot)
    high = SkeletonMap(found.frames, dict.fromkeys(found.offsets, (0.03, 0.0, -0.03)))
    done = retarget(stand(0.4), robot, map=high, collision=False)
    deep = -_lowest(path, done.q)
    assert deep > 0.04
    assert done.measures.penetration.max() == pytest.approx(deep, abs=1e-3)


def test_a_start_that_leans_is_worse_than_hands_a_little_off() -> None:
    reached: Any = SimpleNamespace
    levels = {"stance": 0.0, "hands": 0.0, "soles": 0.0, "trunk": 0.0}
    leaning = reached(residuals={**levels, "trunk": 1.3 * LEAN})
    off = reached(residuals={**levels, "hands": 0.3 * OFF})
    assert branches._worse(leaning, off)
    assert not branches._worse(off, leaning)
    assert not branches._enough(leaning)
    assert branches._enough(reached(residuals={**levels, "trunk": 0.1 * LEAN}))
    for level in ("soles", "trunk"):  # another heading may have the body upright
        assert not branches._enough(reached(residuals={**levels, level: 0.8 * LEAN}))


@pytest.mark.long
def test_a_leaning_trunk_is_a_shortfall(monkeypatch: pytest.MonkeyPatch) -> None:
    """A person bends sideways by 80 degrees; the robot's waist cannot."""
    motion = stand(0.4)
    places = motion.positions.copy()
    upper = [k for k, name in enumerate(motion.names) if "Arm" in name or "Hand" in name]
    c, s = np.cos(1.4), np.sin(1.4)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    hips = places[:, :1]
    places[:, upper] = hips + (places[:, upper] - hips) @ turn.T
    monkeypatch.setitem(shortfalls.LIMITS, "torso", 0.3)
    found = retarget(Motion(motion.names, places, motion.fps, motion.parents), "g1", collision=False)
    assert any(each.part == "torso" and "degrees" in str(each) for each in found.shortfalls)


def test_no_map_for_an_arm() -> None:
    with pytest.raises(DeclarationError, match="base is fixed"):
        suggest_map(hqp.robots.load("ur5"))


@pytest.mark.parametrize("fingers", [1, 2, 5])
def test_hands_are_where_fingers_part(tmp_path: Path, fingers: int) -> None:
    """A hand of several fingers is its palm, one of a single finger its end."""

    def arm(side: str) -> str:
        ends = "".join(
            f'<body name="{side}_finger_{k}" pos="{0.02 * k} 0 -.09"><joint name="{side}_finger_{k}" axis="0 1 0" '
            'range="-1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.04" size=".008" mass=".02"/></body>'
            for k in range(fingers)
        )
        whole = _arm(side, np.random.default_rng(fingers), hangs=True, wrist=True)
        at = whole.index("</body>", whole.index(f"{side}_hand"))
        return whole[:at] + ends + whole[at:]

    robot = hqp.robots.load(_humanoid(tmp_path / "somebody.xml", TURNS["up"], 0.05, (arm("left"), arm("right"))))
    found = suggest_map(robot)
    assert found.frames["left_hand"] == ("left_hand" if fingers > 1 else "left_finger_0")
    assert found.frames["right_elbow"] == "right_forearm"


@pytest.mark.parametrize("kept", ["trunk", "foot"])
def test_robots_with_shapes_on_few_links(tmp_path: Path, kept: str) -> None:
    """If no two links may touch by accident, there is no self-collision to avoid or to report."""
    path = _humanoid(tmp_path / "somebody.xml", TURNS["up"], 0.05)
    bodies = re.split(r"(?=<body )", path.read_text())
    silent = [
        b if kept in b.split(">")[0] else b.replace("<geom ", '<geom contype="0" conaffinity="0" ') for b in bodies
    ]
    path.write_text("".join(silent))
    robot = hqp.robots.load(path)
    done = retarget(stand(0.1), robot, map=suggest_map(robot))
    assert done.measures.summary()["hand_p99"] < OFF


def test_a_link_with_shapes_below_the_soles_at_home_does_not_lift_the_robot(tmp_path: Path) -> None:
    """A ball of 1 m around the trunk, as a placeholder of a base: the robot stands upright on its soles."""
    path = _humanoid(tmp_path / "somebody.xml", TURNS["up"], 0.05)
    path.write_text(
        path.read_text().replace('size=".08 .1 .18" mass="14"/>', 'size=".08 .1 .18" mass="14"/><geom size="1"/>')
    )
    robot = hqp.robots.load(path)
    done = retarget(stand(0.1), robot, map=suggest_map(robot))
    assert done.q[:, 2].max() < 0.76
    assert done.measures.summary()["trunk_p99"] < 0.5


def test_a_robot_with_four_legs_has_no_map(tmp_path: Path) -> None:
    path = _humanoid(tmp_path / "somebody.xml", TURNS["up"], 0.05)
    legs = re.split(r'(?=<body name="(?:left|right)_(?:hip|arm)")', path.read_text())
    hind = "".join(
        re.sub(r'"(left|right)_', r'"hind_\1_', leg).replace('pos="0 ', 'pos="-.4 ', 1)
        for leg in legs
        if "_hip" in leg[:20]
    )
    path.write_text(legs[0] + hind + "".join(legs[1:]))
    with pytest.raises(DeclarationError, match="more than two legs"):
        suggest_map(hqp.robots.load(path))


@pytest.mark.parametrize("low", [0.004, 0.05])
def test_shipped_maps_stand_on_the_shapes_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, low: float
) -> None:
    robot = hqp.robots.load(_humanoid(tmp_path / "somebody.xml", TURNS["aslant"], 0.08))
    own = suggest_map(robot)
    frame = own.frames["left_sole"]
    up = robot.state(robot.home).rotation(frame)[2]
    moved = {part: tuple((np.array(at) + low * up).tolist()) for part, at in own.offsets.items() if "sole" in part}
    monkeypatch.setattr(skeleton_map, "shipped", lambda: {"other": SkeletonMap(own.frames, moved)})
    found = find_map(None, robot)
    for part in moved:
        np.testing.assert_allclose(found.offsets[part], own.offsets[part], atol=2e-6)


@pytest.mark.slow
def test_every_robot_of_the_catalogue_has_a_map_or_a_reason() -> None:
    refused = []
    for name in hqp.robots.names():
        robot = hqp.robots.load(name)
        try:
            suggest_map(robot).check(robot)
        except DeclarationError as error:
            refused.append(str(error))
    assert len(refused) > 10
    assert not any("\n" in error for error in refused)
