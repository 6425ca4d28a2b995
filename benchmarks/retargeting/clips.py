"""The clips: five climbs and two boxes carried, of holosoma-retargeting 0.1.0 on PyPI (Apache-2.0), and BVH files
of bvhtoolbox 0.1.3 (MIT).  None of them is part of hqp: `pip download --no-deps` and unpack them."""

from __future__ import annotations

import ast
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hqp.motion import Motion, read_motion

CLIMB_RATE = 120.0
"""Frame rate of the climbs, which is not in their files [1/s]."""

BOX_RATE, BOX_NUMBERS, BOX_JOINTS = 30.0, 591, slice(162, 318)
"""Files of the boxes: frames per second, float32 numbers per frame, slice of the joints' places."""


def climbs(wheel: Path) -> Iterator[tuple[str, Motion]]:
    """Names and motions of the climbs in an unpacked wheel."""
    folder = wheel / "holosoma_retargeting"
    names = _names(folder, "MOCAP_DEMO_JOINTS")
    for path in sorted((folder / "demo_data" / "climb").glob("*/*_joint_positions_*.npy")):
        number = path.parent.name.rsplit("_", 1)[-1]
        yield f"climb {number}", Motion(names, np.load(path), CLIMB_RATE)


def boxes(wheel: Path) -> Iterator[tuple[str, Motion]]:
    """Names and motions of the people who lift and carry a box, from the raw bytes of the archives of tensors."""
    folder = wheel / "holosoma_retargeting"
    names = _names(folder, "SMPLH_DEMO_JOINTS")
    for path in sorted((folder / "demo_data" / "OMOMO_new").glob("*.pt")):
        with zipfile.ZipFile(path) as archive:
            held = archive.read(f"{path.stem}/data/0")
        numbers = np.frombuffer(held, "<f4").reshape(-1, BOX_NUMBERS)
        places = numbers[:, BOX_JOINTS].reshape(len(numbers), -1, 3).astype(float)
        yield f"box {path.stem.split('_')[0]}", Motion(names, places, BOX_RATE)


def bvh_files(folder: Path) -> Iterator[tuple[str, Motion]]:
    """Names and motions of the BVH files in a folder."""
    for path in sorted(folder.glob("**/*.bvh")):
        yield path.stem, read_motion(path)


def _names(folder: Path, which: str) -> tuple[str, ...]:
    source = folder / "config_types" / "data_type.py"
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == which:
            return tuple(ast.literal_eval(node.value))
    raise ValueError(f"{source}: no {which}")
