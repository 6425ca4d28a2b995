"""Skeleton maps: shipped and suggested ones, and errors of others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hqp.errors import DeclarationError, FrameNotFound
from hqp.motion.body import Body
from hqp.motion.skeleton_map import SkeletonMap, find_map, parse, shipped
from hqp.motion.suggestion import suggest_map

from .robots import robot as catalogued


@pytest.mark.long
@pytest.mark.parametrize("name", ["g1", "talos", "cbi", "icub"])
def test_a_shipped_map_fits_and_a_suggested_one_is_much_the_same(name: str) -> None:
    robot = catalogued(name)
    found = find_map(None, robot)
    assert found == shipped()[name]
    body, suggested = Body.of(robot, found), Body.of(robot, suggest_map(robot))
    assert suggested.leg == pytest.approx(body.leg, rel=0.2)
    arm = [b.length("shoulder", "elbow") + b.length("elbow", "hand") for b in (body, suggested)]
    assert arm[1] == pytest.approx(arm[0], rel=0.45)
    for side in ("left", "right"):
        for part in ("knee", "sole", "hand"):
            assert suggested.places[f"{side}_{part}"][1] * body.places[f"{side}_{part}"][1] > 0.0
        np.testing.assert_allclose(body.places[f"{side}_sole"][2], 0.0, atol=2e-3)
        assert body.toes[side][0] > 0.02


def test_a_map_comes_back_from_its_file() -> None:
    found = SkeletonMap(shipped()["g1"].frames, {"left_hand": (0.1, 0.0, -0.2)}, {"left_hip": "Thigh L"})
    assert parse(found.toml()) == found


def test_h1_is_shipped() -> None:
    assert shipped()["h1"].frames["left_ankle"] == "left_ankle_link"


def test_what_is_wrong_is_told() -> None:
    robot, frames = catalogued("g1"), dict(shipped()["g1"].frames)
    with pytest.raises(DeclarationError, match="no frame for left_hip"):
        SkeletonMap({k: v for k, v in frames.items() if k != "left_hip"})
    with pytest.raises(DeclarationError, match="unknown part"):
        SkeletonMap({**frames, "left_hips": "pelvis"})
    with pytest.raises(DeclarationError, match="offset of left_hand"):
        SkeletonMap(frames, {"left_hand": (0.0, 1.0)})  # type: ignore[dict-item]
    with pytest.raises(FrameNotFound, match="left_hip_roll_link"):
        find_map(SkeletonMap({**frames, "left_hip": "left_hip_rol_link"}), robot)
    with pytest.raises(DeclarationError, match="no shipped map fits"):
        find_map(None, catalogued("romeo"))
    with pytest.raises(DeclarationError, match="base is fixed"):
        find_map("g1", catalogued("ur5"))
    with pytest.raises(DeclarationError, match="at one place"):
        Body.of(robot, SkeletonMap({**frames, "left_knee": frames["left_hip"]}))
    with pytest.raises(DeclarationError, match="no TOML"):
        parse("frames =")


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["g1", "cbi"])
def test_heading_and_ankles_of_the_home_do_not_matter(name: str, seed: int) -> None:
    """A home may face anywhere, with tilted feet: soles have their whole length and are level in targets."""
    robot, rng = catalogued(name), np.random.default_rng(seed)
    found = find_map(None, robot)
    body, suggested = Body.of(robot, found), suggest_map(robot)
    step, column = np.zeros(robot.nv), robot.joint_names.index
    for side in ("left", "right"):
        foot = robot.body(robot.frame(found.frames[f"{side}_sole"]))
        step[[6 + column(robot.model.names[j]) for j in (foot, foot - 1)]] = rng.uniform(-0.1, 0.1, 2)
    step[5] = rng.uniform(-np.pi, np.pi)
    robot.set_home(robot.integrate(robot.home, step, 1.0))
    other, again = Body.of(robot, found), suggest_map(robot)
    for part in ("toes", "heels", "corners", "levers"):
        for side in ("left", "right"):
            np.testing.assert_allclose(getattr(other, part)[side], getattr(body, part)[side], atol=3e-3)
    for part in ("left_sole", "right_sole", "torso", "left_hand"):
        np.testing.assert_allclose(other.axes[part], body.axes[part], atol=0.02)
    assert again.frames == suggested.frames
    for part, offset in suggested.offsets.items():
        np.testing.assert_allclose(again.offsets[part], offset, atol=3e-3)


def test_a_file_of_bytes_is_no_map(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(DeclarationError, match="cannot be read"):
        find_map(tmp_path / "map.toml", catalogued("g1"))
