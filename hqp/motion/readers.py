"""Motions from files: BVH, joint positions, parameters of SMPL-X."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hqp.errors import DeclarationError

from .bvh import read_bvh
from .clip import Motion
from .joints import middle, parts_of
from .smplx import from_parameters, has_parameters

USUAL = {".bvh": "y", ".npz": "z"}
"""Up axis of a file type, unless the person in the file shows another."""


def read_motion(
    path: str | Path,
    *,
    up: str = "auto",
    body_model: str | Path | None = None,
    human: Mapping[str, str] | None = None,
) -> Motion:
    """The motion in a file, z up.

    ``.bvh``; ``.npz`` with positions ``(T, J, 3)``, names ``(J,)`` and fps, or with parameters of SMPL-X as AMASS
    stores them, for which ``body_model`` is the model's own file (.npz).  up: y or z if the person does not show the
    file's axes.  human: joints by part of the person, if their names do not match (see ``SkeletonMap``).  Raises
    DeclarationError for a file of another kind, or one that lacks something.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in USUAL:
        raise DeclarationError("motion", "unknown file type", value=str(path), allowed=", ".join(USUAL))
    motion = read_bvh(path) if kind == ".bvh" else _read_npz(path, body_model)
    parts = parts_of(motion.names, human)
    return motion.upright(up, USUAL[kind], middle(motion, parts, "hip"), middle(motion, parts, "ankle"))


def _read_npz(path: Path, body_model: str | Path | None) -> Motion:
    try:
        with np.load(path, allow_pickle=False) as file:
            told: dict[str, Any] = {key: file[key] for key in file.files if file[key].dtype != object}
    except (OSError, EOFError, ValueError) as error:
        raise DeclarationError("motion", f"no npz file: {error}", value=str(path)) from error
    if has_parameters(told):
        return from_parameters(told, body_model)
    missing = [key for key in ("positions", "names", "fps") if key not in told]
    if missing:
        allowed = "positions (T, J, 3), names (J,), fps; or trans, poses, betas of SMPL-X"
        raise DeclarationError("motion", f"{path.name} lacks {', '.join(missing)}", allowed=allowed)
    names = tuple(str(name) for name in told["names"])
    parents = tuple(int(p) for p in told["parents"]) if "parents" in told else ()
    return Motion(names, told["positions"], float(told["fps"]), parents)
