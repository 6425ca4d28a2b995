"""Motions from files, and the mapping of joints to parts of a person."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hqp.errors import DeclarationError
from hqp.motion import Motion, read_motion, retarget
from hqp.motion.command import add_arguments
from hqp.motion.joints import parts_of
from hqp.motion.skeleton_map import find_map
from hqp.motion.smplx import NAMES as SMPLX

from .people import stand, walk, write_bvh, write_npz
from .robots import robot as catalogued

LAFAN = [
    "Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToe", "RightUpLeg", "RightLeg", "RightFoot", "RightToe", "Spine",
    "LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "RightShoulder", "RightArm", "RightForeArm", "RightHand",
]  # fmt: skip


def test_npz_comes_back(tmp_path: Path) -> None:
    motion = walk()
    read = read_motion(write_npz(tmp_path / "walk.npz", motion))
    assert read.names == motion.names
    assert read.fps == motion.fps
    np.testing.assert_array_equal(read.positions, motion.positions)


@pytest.mark.parametrize("fps", [30.0, 120.0])
def test_bvh_with_position_channels_in_every_joint(tmp_path: Path, fps: float) -> None:
    motion = walk(0.5, fps=fps)
    read = read_motion(write_bvh(tmp_path / "walk.bvh", motion))
    assert read.fps == fps
    np.testing.assert_allclose(read.positions, 100.0 * motion.positions, atol=1e-3)


def test_joints_of_a_bvh_turn(tmp_path: Path) -> None:
    from hqp.motion.bvh import read_bvh

    path = tmp_path / "arm.bvh"
    path.write_text(
        "HIERARCHY\nROOT A\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
        " JOINT B\n {\n  OFFSET 1 0 0\n  CHANNELS 3 Zrotation Xrotation Yrotation\n"
        "  End Site\n  {\n   OFFSET 1 0 0\n  }\n"
        " }\n}\nMOTION\nFrames: 2\nFrame Time: 0.0333333\n0 0 0 0 0 0 0 0 0\n0 2 0 90 0 0 0 90 0\n"
    )
    read = read_bvh(path)
    assert read.names == ("A", "B", "BEnd")
    np.testing.assert_allclose(read.positions[0], [[0, 0, 0], [1, 0, 0], [2, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(read.positions[1], [[0, 2, 0], [0, 3, 0], [0, 4, 0]], atol=1e-6)


def test_up_is_told_by_the_person(tmp_path: Path) -> None:
    motion = walk(0.5)
    turned = Motion(motion.names, motion.positions[..., [0, 2, 1]] * [1, 1, -1], motion.fps, motion.parents)
    read = read_motion(write_npz(tmp_path / "y.npz", turned))
    np.testing.assert_allclose(read.positions, motion.positions)
    kept = read_motion(write_npz(tmp_path / "z.npz", turned), up="z")
    np.testing.assert_allclose(kept.positions, turned.positions)


def test_parameters_of_a_body_model(tmp_path: Path) -> None:
    """A model with its joints as vertices, in a row, each half a metre above its parent."""
    count, rng = len(SMPLX), np.random.default_rng(0)
    rests = rng.normal(size=(count, 3))
    parents = [0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19]
    np.savez(
        tmp_path / "model.npz", J_regressor=np.eye(count), v_template=rests, shapedirs=np.zeros((count, 3, 10)),
        kintree_table=np.array([parents, range(count)]),
    )  # fmt: skip
    poses = np.zeros((2, 3 * count))
    poses[1, :3] = [0.0, 0.0, np.pi / 2]
    trans = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    np.savez(tmp_path / "motion.npz", poses=poses, trans=trans, betas=np.zeros(10), mocap_frame_rate=60.0)
    read = read_motion(tmp_path / "motion.npz", up="z", body_model=tmp_path / "model.npz")
    np.testing.assert_allclose(read.positions[0], rests, atol=1e-12)
    turned = (rests - rests[0]) @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + rests[0] + trans[1]
    np.testing.assert_allclose(read.positions[1], turned, atol=1e-12)
    with pytest.raises(DeclarationError, match="body model"):
        read_motion(tmp_path / "motion.npz")


@pytest.mark.parametrize(
    ("names", "part", "joint"),
    [
        (LAFAN, "left_shoulder", "LeftArm"),
        (LAFAN, "right_toe", "RightToe"),
        ([f"mixamorig:{n}" for n in LAFAN], "left_knee", "mixamorig:LeftLeg"),
        (SMPLX, "left_toe", "left_foot"),
        (SMPLX, "right_hand", "right_wrist"),
        ([f"L_{n}" for n in ("Hip", "Knee", "Ankle", "Foot", "Shoulder", "Elbow", "Wrist")]
         + [f"R_{n}" for n in ("Hip", "Knee", "Ankle", "Foot", "Shoulder", "Elbow", "Wrist")], "left_toe", "L_Foot"),
        ([f"{n}{s}" for s in (".l", ".r") for n in ("thigh", "shin", "foot", "toe", "upper_arm", "forearm", "hand")],
         "right_knee", "shin.r"),
        *(([f"{s}_{n}" for s in sides for n in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")],
           f"{side}_knee", f"{s}_knee")
          for sides in (("lf", "rt"), ("lft", "rgt")) for side, s in zip(("left", "right"), sides, strict=True)),
        ([f"NPC {s} {n} [{s}{n[:3]}]" for s in "LR"
          for n in ("Thigh", "Calf", "Foot", "Toe0", "Clavicle", "UpperArm", "Forearm", "Hand")],
         "right_hip", "NPC R Thigh [RThi]"),
    ],
)  # fmt: skip
def test_names_of_parts(names: list[str], part: str, joint: str) -> None:
    assert parts_of(names)[part] == joint


def test_what_is_wrong_is_told(tmp_path: Path) -> None:
    motion = stand(0.2)
    with pytest.raises(DeclarationError, match="left_hand, right_hand"):
        parts_of([n for n in motion.names if "Hand" not in n])
    assert parts_of([*motion.names, "odd"], {"left_hand": "odd"})["left_hand"] == "odd"
    with pytest.raises(DeclarationError, match="no joint for left_hand"):
        parts_of(motion.names, {"left_hand": "odd"})
    broken = motion.positions.copy()
    broken[3, 2, 1] = np.nan
    with pytest.raises(DeclarationError, match="LeftLeg is not finite in frame 3"):
        Motion(motion.names, broken, 30.0)
    with pytest.raises(DeclarationError, match=r"duplicate joint name \(given \['odd'\]\)"):
        Motion(["odd", "odd", *motion.names[2:]], motion.positions, 30.0)
    with pytest.raises(DeclarationError, match="unknown file type"):
        read_motion(tmp_path / "walk.fbx")
    (tmp_path / "empty.npz").write_bytes(b"")
    with pytest.raises(DeclarationError, match="no npz"):
        read_motion(tmp_path / "empty.npz")
    np.savez(tmp_path / "half.npz", positions=motion.positions)
    with pytest.raises(DeclarationError, match="lacks names, fps"):
        read_motion(tmp_path / "half.npz")


@pytest.mark.parametrize("words", [["--up", "-y"], ["--up=-y"], ["--up", "x"], []])
def test_the_axis_of_the_command(words: list[str]) -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    told = parser.parse_args(["clip.bvh", "--robot", "g1", *words, "--no-collision"])
    assert told.up == (words[-1].removeprefix("--up=") if words else "auto")
    assert told.no_collision


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Motion(None, stand(0.1).positions, 30.0),  # type: ignore[arg-type]
        lambda: Motion("LeftFoot", stand(0.1).positions, 30.0),  # type: ignore[arg-type]
        lambda: replace(stand(0.1), fps=None),
        lambda: replace(stand(0.1), fps="30"),
        lambda: replace(stand(0.1), fps=float("nan")),
        lambda: replace(stand(0.1), parents=("a",) * 15),
        lambda: replace(stand(0.1), parents=(0.5,) * 15),
        lambda: replace(stand(0.1), parents=3),
        lambda: replace(stand(0.1), box=3),
        lambda: stand(0.1).at_rate(float("nan")),
        lambda: stand(0.1).at_rate(0.0),
        lambda: read_motion(3),  # type: ignore[arg-type]
        lambda: parts_of(stand(0.1).names, ["left_hip"]),  # type: ignore[arg-type]
        lambda: find_map(3, catalogued("g1")),  # type: ignore[arg-type]
        lambda: retarget(stand(0.1), None),  # type: ignore[arg-type]
        lambda: retarget(stand(0.1), catalogued("g1"), fps="30"),  # type: ignore[arg-type]
        lambda: retarget(stand(0.1), catalogued("g1"), map=3),  # type: ignore[arg-type]
    ],
)
def test_values_of_another_kind_end_in_a_sentence(wrong: Callable[[], object]) -> None:
    with pytest.raises(DeclarationError) as found:
        wrong()
    assert "\n" not in str(found.value)
