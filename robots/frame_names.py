"""Frames of a model by name: a link, site or added frame comes before a joint of the same name."""

from __future__ import annotations

from typing import Any

import pinocchio as pin

_JOINTS = (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)


def frames(model: Any) -> dict[str, int]:
    """Index of the frame of each name."""
    ranked = sorted(range(len(model.frames)), key=lambda i: (model.frames[i].type not in _JOINTS, -i))
    return {model.frames[i].name: i for i in ranked}


def clashes(model: Any, known: dict[str, int]) -> list[str]:
    """Names that a joint shares with a link or site that it does not carry."""
    places: dict[str, tuple[int, Any]] = {name: (i, None) for i, name in enumerate(model.names[1:], 1)}
    fixed = [frame for frame in model.frames if frame.type == pin.FrameType.FIXED_JOINT]
    places |= {frame.name: (frame.parentJoint, frame.placement) for frame in fixed}
    found = []
    for name, (joint, placement) in places.items():
        frame = model.frames[known[name]] if name in known else None
        if frame is None or frame.type in _JOINTS:
            continue
        if frame.parentJoint != joint or (placement is not None and not frame.placement.isApprox(placement, 1e-9)):
            found.append(name)
    return found
