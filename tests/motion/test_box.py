"""A box in both hands: the robot's hands keep their places on it, in any unit, heading and file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hqp.errors import DeclarationError
from hqp.motion import Box, Motion, Retargeted, read_motion, retarget
from hqp.motion.skeleton_map import find_map
from tests.motion.people import lift, stand, write_npz

from .robots import robot as catalogued


def on_box(found: Retargeted) -> dict[str, Any]:
    """Places of the hands in the box's axes ``(T, 3)``, by Pinocchio's kinematics."""
    assert found.box is not None
    frames = find_map(None, found.robot)
    places: dict[str, list[Any]] = {"left": [], "right": []}
    for q in found.q:
        state = found.robot.state(q)
        for side, rows in places.items():
            frame, offset = frames.frames[f"{side}_hand"], np.array(frames.offset(f"{side}_hand"))
            rows.append(state.position(frame) + state.rotation(frame) @ offset)
    return {side: found.box.within(np.array(rows)) for side, rows in places.items()}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "slip"),
    [
        ("g1", 3e-3),
        pytest.param("talos", 3e-3, marks=pytest.mark.slow),
        pytest.param("cbi", 4e-2, marks=pytest.mark.slow),
    ],
)
def test_hands_stay_on_a_box_of_its_own_size(name: str, slip: float) -> None:
    motion = lift(3.0, turn=0.4)
    found = retarget(motion, catalogued(name), collision=False)
    assert found.box is not None
    assert motion.box is not None
    np.testing.assert_allclose(found.box.size, motion.box.size, rtol=1e-12)
    held = slice(int(0.35 * len(found)), None)
    for side, places in on_box(found).items():
        assert np.ptp(places[held], axis=0).max() < slip
        assert abs(places[held, 1].mean()) == pytest.approx(0.13, abs=5e-3), f"{side} hand beside its face"
    low = found.box.lowest()
    assert low.argmin() < held.start
    assert low[-1] - low[0] > 0.2


@pytest.mark.slow
def test_unit_and_heading_do_not_matter() -> None:
    robot, motion = catalogued("g1"), lift(2.0)
    assert motion.box is not None
    plain = retarget(motion, robot)
    assert plain.box is not None
    big = Box(100.0 * motion.box.positions, motion.box.quaternions, 100.0 * motion.box.size)
    centimetres = retarget(replace(motion, positions=100.0 * motion.positions, box=big), robot)
    assert centimetres.box is not None
    np.testing.assert_allclose(centimetres.box.positions, plain.box.positions, atol=1e-9)
    np.testing.assert_allclose(centimetres.q, plain.q, atol=1e-6)
    c, s = np.cos(2.5), np.sin(2.5)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = retarget(replace(motion, positions=motion.positions @ R.T, box=motion.box.turned(R)), robot)
    assert turned.box is not None
    np.testing.assert_allclose(turned.box.positions, plain.box.positions @ R.T, atol=1e-4)
    for side, places in on_box(turned).items():
        np.testing.assert_allclose(places, on_box(plain)[side], atol=2e-3)


@pytest.mark.parametrize("up", ["z", "y", "-x"])
def test_files_have_the_box(tmp_path: Path, up: str) -> None:
    """Read as written, also if another axis of the file is up; the result's file has the box, too."""
    motion = lift(1.0, turn=0.3)
    assert motion.box is not None
    axes, signs = {"z": ([0, 1, 2], [1, 1, 1]), "y": ([0, 2, 1], [1, 1, -1]), "-x": ([2, 0, 1], [-1, 1, -1])}[up]
    R = np.eye(3)[axes] * np.array(signs)[:, None]
    R[2] *= np.linalg.det(R)
    other = replace(motion, positions=motion.positions @ R.T, box=motion.box.turned(R))
    read = read_motion(write_npz(tmp_path / "lift.npz", other), up=up)
    assert read.box is not None
    hands = [i for i, name in enumerate(read.names) if name.endswith("Hand")]
    for hand in hands:  # the hands' places in the box do not depend on the file's axes
        np.testing.assert_allclose(
            read.box.within(read.positions[:, hand]), motion.box.within(motion.positions[:, hand]), atol=1e-9
        )
    if up == "z":
        found = retarget(read, catalogued("g1"))
        assert found.box is not None
        with np.load(found.save(tmp_path / "robot.npz")) as file:
            np.testing.assert_array_equal(file["box_positions"], found.box.positions)


def test_rates_and_parts_keep_the_box() -> None:
    motion = lift(1.0, turn=0.8)
    assert motion.box is not None
    fine = motion.at_rate(90.0)
    assert fine.box is not None
    assert len(fine.box) == len(fine)
    np.testing.assert_allclose(fine.box.positions[::3], motion.box.positions[: len(fine.box.positions[::3])], atol=1e-9)
    part = motion.part(5, 12)
    assert part.box is not None
    np.testing.assert_array_equal(part.box.quaternions, motion.box.quaternions[5:12])


@pytest.mark.long
def test_a_box_that_nobody_holds_stays_in_place() -> None:
    motion = stand(0.3)
    still = Box([[1.5, 0.0, 0.1]] * len(motion), [[0.0, 0.0, 0.0, 1.0]] * len(motion), [0.2, 0.2, 0.2])
    found = retarget(replace(motion, box=still), catalogued("g1"))
    assert found.box is not None
    assert np.ptp(found.box.positions, axis=0).max() == 0.0
    np.testing.assert_allclose(found.box.lowest(), 0.0, atol=1e-12)
    np.testing.assert_array_equal(found.q, retarget(motion, catalogued("g1")).q)


def test_errors_name_the_part(tmp_path: Path) -> None:
    motion = lift(1.0)
    assert motion.box is not None
    with pytest.raises(DeclarationError, match="frames of the box"):
        replace(motion, box=motion.box.frames(slice(0, 3)))
    with pytest.raises(DeclarationError, match="size"):
        replace(motion.box, size=[0.1, -0.1, 0.1])
    with pytest.raises(DeclarationError, match="length zero"):
        replace(motion.box, quaternions=0.0 * motion.box.quaternions)
    with pytest.raises(DeclarationError, match="finite"):
        replace(motion.box, positions=np.nan * motion.box.positions)
    with pytest.raises(DeclarationError, match="not numeric"):
        replace(motion.box, size="large")
    path = tmp_path / "part.npz"
    np.savez(path, positions=motion.positions, names=np.array(motion.names), fps=30.0, box_size=[0.1, 0.1, 0.1])
    with pytest.raises(DeclarationError, match="the box lacks box_positions"):
        read_motion(path)


@pytest.mark.long
def test_a_motion_without_a_box_has_none() -> None:
    motion: Motion = stand(1.0)
    assert retarget(motion, catalogued("g1")).box is None
