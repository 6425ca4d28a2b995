"""Motions from parameters of SMPL-X (or SMPL, SMPL-H), through a body model that the user has.

The model's licence forbids to ship it: https://smpl-x.is.tue.mpg.de
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError

from .clip import Motion

NAMES = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
"""The first joints of every model of the family."""

RATES = ("mocap_frame_rate", "mocap_framerate", "fps")


def has_parameters(data: Mapping[str, Any]) -> bool:
    """Return true if a file holds parameters of a body model."""
    return "trans" in data and ("poses" in data or ("root_orient" in data and "pose_body" in data))


def from_parameters(data: Mapping[str, Any], model: str | Path | None) -> Motion:
    """Joint positions from parameters as AMASS and its users store them, z up.

    data: trans ``(T, 3)`` [m], poses ``(T, 3 k)``, k >= 22 (or root_orient ``(T, 3)`` and pose_body ``(T, 63)``),
    rotation vectors [rad], betas, and the frame rate.  model: the body model's file,.npz.  Raises DeclarationError for
    a missing model or a misfit.
    """
    if model is None:
        allowed = "body_model=PATH, --body-model PATH: SMPLX_NEUTRAL.npz, from https://smpl-x.is.tue.mpg.de"
        raise DeclarationError("motion", "parameters of SMPL-X need the body model", allowed=allowed)
    rests, parents = _skeleton(Path(model), np.ravel(data["betas"]) if "betas" in data else np.zeros(0))
    try:
        pose = data["poses"] if "poses" in data else np.hstack((data["root_orient"], data["pose_body"]))
        pose, trans = np.asarray(pose, dtype=np.float64), np.asarray(data["trans"], dtype=np.float64)
        rate = next((float(np.asarray(data[key]).item()) for key in RATES if key in data), None)
    except (TypeError, ValueError) as error:
        allowed = "numbers: poses (T, 66 or more), trans (T, 3), one frame rate"
        raise DeclarationError("motion", f"parameters of SMPL-X: {error}", allowed=allowed) from error
    count = len(NAMES)
    if pose.ndim != 2 or pose.shape[1] < 3 * count or trans.shape != (len(pose), 3):
        what = f"poses {pose.shape}, trans {trans.shape}"
        raise DeclarationError("motion", what, allowed=f"(T, {3 * count} or more) and (T, 3)")
    if rate is None:
        raise DeclarationError("motion", "no frame rate", allowed=" or ".join(RATES))
    return Motion(NAMES, _placed(rests, parents, pose[:, : 3 * count], trans), rate, parents)


def _skeleton(path: Path, betas: Vec) -> tuple[Mat, tuple[int, ...]]:
    """Joints of the person at rest ``(22, 3)`` and their parents."""
    try:
        with np.load(path, allow_pickle=False) as model:
            regressor, mean = np.asarray(model["J_regressor"]), np.asarray(model["v_template"])
            directions, tree = np.asarray(model["shapedirs"]), np.asarray(model["kintree_table"])
    except (OSError, EOFError, ValueError, KeyError) as error:
        allowed = "an .npz with J_regressor, v_template, shapedirs, kintree_table"
        raise DeclarationError("motion", f"no body model: {error}", value=str(path), allowed=allowed) from error
    used = min(betas.size, directions.shape[2])
    rests = regressor @ (mean + directions[:, :, :used] @ betas[:used])
    parents = tuple(-1 if i == 0 else int(tree[0, i]) for i in range(len(NAMES)))
    return rests[: len(NAMES)], parents


def _placed(rests: Mat, parents: tuple[int, ...], pose: Mat, trans: Mat) -> Mat:
    from scipy.spatial.transform import Rotation

    turns: list[Any] = []
    places: list[Mat] = []
    for i, parent in enumerate(parents):
        local = Rotation.from_rotvec(pose[:, 3 * i : 3 * i + 3])
        if parent < 0:
            turns.append(local)
            places.append(rests[i] + trans)
        else:
            turns.append(turns[parent] * local)
            places.append(places[parent] + turns[parent].apply(rests[i] - rests[parent]))
    return np.stack(places, axis=1)
