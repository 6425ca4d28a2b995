"""The clips: five climbs of the PyPI wheel holosoma-retargeting 0.1.0 (Apache-2.0), and BVH files of bvhtoolbox 0.1.3
(MIT).  None of them is part of hqp: `pip download --no-deps` and unpack them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hqp.motion import Motion, read_motion

CLIMB_RATE = 120.0
"""Of the climbs, whose files do not say [1/s]."""


def climbs(wheel: Path) -> Iterator[tuple[str, Motion]]:
    """Names and motions of the climbs in an unpacked wheel."""
    folder = wheel / "holosoma_retargeting"
    names = _names(folder / "config_types" / "data_type.py")
    for path in sorted((folder / "demo_data" / "climb").glob("*/*_joint_positions_*.npy")):
        number = path.parent.name.rsplit("_", 1)[-1]
        yield f"climb {number}", Motion(names, np.load(path), CLIMB_RATE)


def bvh_files(folder: Path) -> Iterator[tuple[str, Motion]]:
    """Names and motions of the BVH files in a folder."""
    for path in sorted(folder.glob("**/*.bvh")):
        yield path.stem, read_motion(path)


def _names(source: Path) -> tuple[str, ...]:
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "MOCAP_DEMO_JOINTS":
            return tuple(ast.literal_eval(node.value))
    raise ValueError(f"{source}: no MOCAP_DEMO_JOINTS")
