"""Motions from BVH files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hqp.errors import DeclarationError, HqpError

from .clip import Motion

END = "End"
"""Behind the name of a joint: the end of a chain."""


def read_bvh(path: str | Path) -> Motion:
    """Joint positions of a BVH file in its own axes and unit; ends of chains are joints, ``HeadEnd``.

    Raises HqpError without bvhio, DeclarationError for an invalid file.
    """
    try:
        import bvhio  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise HqpError("BVH files need bvhio: pip install 'hqp[motion]'") from error
    try:
        told = bvhio.readAsBvh(str(path))
    except (OSError, SyntaxError, ValueError, IndexError, UnboundLocalError) as error:
        raise DeclarationError("motion", f"no BVH file: {error}", value=str(path)) from error
    names: list[str] = []
    parents: list[int] = []
    places: list[Any] = []

    def add(name: str, parent: int, position: Any) -> None:
        while name in names:
            name += "_"
        names.append(name)
        parents.append(parent)
        places.append(position)

    def walk(joint: Any, parent: int, position: Any, rotation: Any) -> None:
        from scipy.spatial.transform import Rotation

        local = np.array([key.Position.to_list() for key in joint.Keyframes])
        wxyz = np.array([key.Rotation.to_list() for key in joint.Keyframes])
        turn = Rotation.from_quat(wxyz[:, [1, 2, 3, 0]])
        here, turned = position + rotation.apply(local), rotation * turn
        add(joint.Name, parent, here)
        index = len(names) - 1
        end = np.array(joint.EndSite.to_list())
        for child in joint.Children:
            walk(child, index, here, turned)
        if not joint.Children and end.any():
            add(joint.Name + END, index, here + turned.apply(end))

    from scipy.spatial.transform import Rotation

    if told.FrameCount < 2:
        raise DeclarationError("motion", f"{told.FrameCount} frames", value=str(path), allowed="at least 2")
    walk(told.Root, -1, np.zeros((told.FrameCount, 3)), Rotation.identity(told.FrameCount))
    return Motion(tuple(names), np.stack(places, axis=1), _rate(told.FrameTime), tuple(parents))


def _rate(period: float) -> float:
    """Frames a second; files write 1/120 as 0.008333."""
    if not period > 0.0:
        raise DeclarationError("motion", "frame time", value=period, unit="s", allowed="above 0")
    rate = 1.0 / period
    return float(round(rate)) if abs(rate - round(rate)) < 2e-3 * rate else rate
