"""Files of a synthetic person are read correctly with any names, rotations, scales and times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hqp.errors import DeclarationError
from hqp.motion import Motion, read_motion
from hqp.motion.joints import parts_of
from hqp.motion.person import joints_of, remarks, up_axis

from .files import RATES, SCHEMES, UPS, laid, mirrored, renamed, strolling, write_turning_bvh
from .people import NAMES, PARENTS, stand, write_bvh, write_npz


def _written(path: Path, kind: str, motion: Motion, rng: np.random.Generator) -> Path:
    return write_turning_bvh(path / "clip.bvh", motion, rng) if kind == "bvh" else write_npz(path / "clip.npz", motion)


def _alike(read: Motion, motion: Motion, scale: float) -> None:
    """Compare two motions up to a turn about the vertical: heights, and horizontal places up to a proper rotation."""
    one, two = read.positions / scale, motion.positions
    np.testing.assert_allclose(one[..., 2], two[..., 2], atol=1e-5)
    flat, other = (x[..., :2].reshape(-1, 2) for x in (one, two))
    c, s = (flat * other).sum(), (flat[:, 0] * other[:, 1] - flat[:, 1] * other[:, 0]).sum()
    turn = np.array([[c, -s], [s, c]]) / np.hypot(c, s)
    np.testing.assert_allclose(flat @ turn.T, other, atol=1e-5)


@pytest.mark.parametrize("kind", ["bvh", "npz"])
@pytest.mark.parametrize("up", UPS)
def test_axes_names_units_and_headings(tmp_path: Path, kind: str, up: str) -> None:
    rng = np.random.default_rng([len(up), ord(up[-1]), len(kind), ord(kind[0])])
    for scheme in SCHEMES:
        whole, scale = strolling(rng), float(rng.choice([1.0, 100.0, 39.37]))
        motion, parts = renamed(whole, scheme)
        file = laid(Motion(motion.names, scale * motion.positions, motion.fps, motion.parents), up)
        for axis in ("auto", up):
            read = read_motion(_written(tmp_path, kind, file, rng), up=axis)
            assert read.names == motion.names
            assert parts_of(read.names) == parts
            _alike(read, motion, scale)
            assert remarks(joints_of(read, parts)) == ()
        assert bool(read_motion(tmp_path / f"clip.{kind}").notes) == (up != {"bvh": "y", "npz": "z"}[kind])


@pytest.mark.parametrize("up", UPS)
def test_the_axis_of_one_who_walks_beside_the_zero_of_the_file(up: str) -> None:
    """A foot that rests at the zero of a horizontal axis, before all other joints, stands on no floor there."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        whole = strolling(rng)
        places, ahead = whole.positions.copy(), whole.positions[-1, 0] - whole.positions[0, 0]
        for k in (0, 1):
            way = -np.sign(ahead[k])
            places[..., k] -= way * np.median((way * places[..., k]).min(axis=1))
        file = laid(Motion(NAMES, places, whole.fps, PARENTS), up)
        joints = joints_of(file, parts_of(NAMES))
        assert {usual: up_axis(file, joints, usual) for usual in ("y", "z")} == {"y": up, "z": up}


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("digits", [5, 6, 7, 16])
def test_rates_are_exact(tmp_path: Path, fps: float, digits: int) -> None:
    motion = Motion(NAMES, stand(0.1).positions, fps, PARENTS)
    read = read_motion(write_turning_bvh(tmp_path / "clip.bvh", motion, np.random.default_rng(0), digits), up="z")
    assert read.fps == pytest.approx(fps, rel=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_who_is_mirrored_lies_or_is_upside_down(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion, parts = renamed(strolling(rng), list(SCHEMES)[seed % len(SCHEMES)])
    assert remarks(joints_of(motion, parts)) == ()
    assert "mirrored" in " ".join(remarks(joints_of(mirrored(motion), parts)))
    assert "upside down in 45 of 45" in " ".join(remarks(joints_of(laid(motion, "-z"), parts)))
    assert "lies in 45 of 45" in " ".join(remarks(joints_of(laid(motion, UPS[:2][seed % 2]), parts)))
    swapped = {f"{s}_{limb}": name for part, name in parts.items() for s, limb in [_other(part)]}
    arms = {part: (swapped if "shoulder" in part or "elbow" in part else parts)[part] for part in parts}
    assert "exchanged" in " ".join(remarks(joints_of(motion, arms)))


def _other(part: str) -> tuple[str, str]:
    side, limb = part.split("_")
    return {"left": "right", "right": "left"}[side], limb


@pytest.mark.parametrize("seed", range(4))
def test_second_parts_of_a_limb_in_any_order(seed: int) -> None:
    """Joints along a bone, numbered behind its name, are not the bone's joint: ``thigh.L.001``."""
    rng = np.random.default_rng(seed)
    for scheme in SCHEMES:
        motion, parts = renamed(stand(0.1), scheme)
        more = [f"{name}{end}" for name in parts.values() for end in (".001", "_2") if not name[-1].isdigit()]
        assert parts_of([str(name) for name in rng.permutation([*motion.names, *more])]) == parts


@pytest.mark.parametrize("kind", ["bvh", "npz"])
def test_one_who_lies_on_the_floor_of_the_file_stays_lying(tmp_path: Path, kind: str) -> None:
    """Lying along any axis of the floor, the lowest joint on it: the file's usual axis is up."""
    usual = {"bvh": "y", "npz": "z"}[kind]
    for k, direction in enumerate(up for up in UPS if up[-1] != "z"):
        flat = laid(stand(0.2), direction)
        places = flat.positions - [0.0, 0.0, flat.positions[..., 2].min() - 0.03]
        motion = Motion(flat.names, places, flat.fps, flat.parents)
        read = read_motion(_written(tmp_path, kind, laid(motion, usual), np.random.default_rng(k)))
        assert read.notes == ()
        _alike(read, motion, 1.0)
        assert "lies" in " ".join(remarks(joints_of(read, parts_of(read.names))))


@pytest.mark.parametrize("kind", ["bvh", "npz"])
def test_damaged_files_end_in_one_sentence(tmp_path: Path, kind: str) -> None:
    rng = np.random.default_rng(3)
    path = _written(tmp_path, kind, stand(0.1), rng)
    whole, refused = path.read_bytes(), []
    for _ in range(120):
        damaged = bytearray(whole[: rng.integers(len(whole))] if rng.integers(2) else whole)
        for at in rng.integers(max(1, len(damaged)), size=rng.integers(1, 6)):
            damaged[at : at + 1] = rng.bytes(1)
        path.write_bytes(damaged)
        try:
            read_motion(path)
        except DeclarationError as error:
            refused.append(str(error))
    assert len(refused) > 60
    assert not any("\n" in error for error in refused)


@pytest.mark.parametrize("word", ["nan", "inf", "-1e999"])
def test_a_number_that_is_none_is_named_by_its_frame(tmp_path: Path, word: str) -> None:
    """In the middle of a drawn file."""
    rng = np.random.default_rng(len(word))
    path = write_bvh(tmp_path / "clip.bvh", stand(0.4))
    lines = path.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    frame = int(rng.integers(1, len(lines) - first))
    words = lines[first + frame].split()
    words[rng.integers(len(words))] = word
    lines[first + frame] = " ".join(words)
    path.write_text("\n".join(lines))
    with pytest.raises(DeclarationError, match=f"frame {frame} has a number that is not finite"):
        read_motion(path)


@pytest.mark.parametrize("seed", range(12))
def test_spellings_of_a_file(tmp_path: Path, seed: int) -> None:
    """Any ends of lines, encodings, decimal marks, cases and spaces about the keywords of the motion."""
    rng = np.random.default_rng(seed)
    path = write_turning_bvh(tmp_path / "clip.bvh", stand(0.1), rng)
    text, whole = path.read_text(), read_motion(path)
    for word in ("MOTION", "Frames:", "Frame Time:"):
        other = [word.upper(), word.lower(), word.replace(":", " :"), f"  {word}\t"][rng.integers(4)]
        text = text.replace(f"\n{word}", f"\n{other}")
    if rng.integers(2):
        text = text.replace(".", ",")
    text = text.replace("\n", str(rng.choice(["\n", "\r\n", "\r", "\n\n"])))
    path.write_bytes(text.encode(str(rng.choice(["utf-8", "utf-8-sig", "utf-16"]))))
    read = read_motion(path)
    assert (read.names, read.fps) == (whole.names, whole.fps)
    np.testing.assert_array_equal(read.positions, whole.positions)


@pytest.mark.parametrize("seed", range(12))
def test_types_of_arrays(tmp_path: Path, seed: int) -> None:
    """Names as bytes or text, the rate as a number, an array of one or text."""
    rng, motion = np.random.default_rng(seed), stand(0.1)
    names: Any = np.array(motion.names)
    names = names.astype(["S", "U", "U40"][rng.integers(3)])
    rate: Any = [30, np.float32(30.0), np.array([30.0]), np.array([[30]]), "30"][rng.integers(5)]
    np.savez(tmp_path / "clip.npz", positions=motion.positions, names=names, fps=rate)
    read = read_motion(tmp_path / "clip.npz")
    assert (read.names, read.fps) == (motion.names, 30.0)


def test_arrays_of_objects_are_left_out(tmp_path: Path) -> None:
    """Beside the motion they do no harm; in place of a part of it that part is missing."""
    motion, strange = stand(0.1), np.array([None, "x"], dtype=object)
    parts: dict[str, Any] = {"positions": motion.positions, "names": np.array(motion.names), "fps": 30.0}
    np.savez(tmp_path / "clip.npz", notes=strange, **parts)
    assert read_motion(tmp_path / "clip.npz").names == motion.names
    for part in parts:
        np.savez(tmp_path / "clip.npz", **{**parts, part: strange})
        with pytest.raises(DeclarationError, match=f"lacks {part}"):
            read_motion(tmp_path / "clip.npz")


@pytest.mark.parametrize("seed", range(16))
def test_limbs_without_length_end_in_one_sentence(tmp_path: Path, seed: int) -> None:
    """Two joints of a drawn limb are at one place, all of them, or beyond any size, in drawn units."""
    rng, motion = np.random.default_rng(seed), stand(0.2)
    places = motion.positions * 10.0 ** rng.integers(-6, 6)
    side, limb = str(rng.choice(["Left", "Right"])), int(rng.integers(6))
    chains = (("UpLeg", "Leg"), ("Leg", "Foot"), ("Arm", "ForeArm"), ("ForeArm", "Hand"))
    if limb < 4:
        one, other = (motion.names.index(side + name) for name in chains[limb])
        places[:, one] = places[:, other]
    elif limb == 4:
        places *= 0.0
    else:
        places *= 1e300
    with pytest.raises(DeclarationError) as found:
        read_motion(write_npz(tmp_path / "clip.npz", Motion(motion.names, places, motion.fps, motion.parents)))
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("fps", [1e-9, 0.03, 1e6, 1e300])
def test_rates_of_no_motion_are_refused(fps: float) -> None:
    with pytest.raises(DeclarationError, match="frames per second"):
        Motion(NAMES, stand(0.1).positions, fps, PARENTS)


def test_names_of_chains_ends(tmp_path: Path) -> None:
    """A foot whose toe is the end of its chain, as in Blender's files: ``foot.L`` and its end site."""
    motion, parts = renamed(stand(0.1), "blender")
    kept = [k for k, name in enumerate(motion.names) if not name.startswith("toe")]
    parents = tuple(kept.index(motion.parents[k]) if motion.parents[k] >= 0 else -1 for k in kept)
    short = Motion(tuple(motion.names[k] for k in kept), motion.positions[:, kept], motion.fps, parents)
    text = write_turning_bvh(tmp_path / "clip.bvh", short, np.random.default_rng(0)).read_text()
    (tmp_path / "clip.bvh").write_text(text.replace("OFFSET 0 0 0", "OFFSET 0 0.1 0"))
    found = parts_of(read_motion(tmp_path / "clip.bvh", up="z").names)
    assert found == {**parts, "left_toe": "foot.LEnd", "right_toe": "foot.REnd"}
