"""Motions from files: BVH, joint positions, parameters of SMPL-X."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hqp.errors import DeclarationError
from hqp.kinds import file_path

from .box import FIELDS, Box
from .bvh import read_bvh
from .clip import Motion
from .joints import parts_of
from .person import joints_of, up_axis
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
    stores them, for which ``body_model`` is the model's own file (.npz).  A ``Box`` that the hands carry belongs to the
    first: box_positions ``(T, 3)``, box_quaternions ``(T, 4)`` xyzw, box_size ``(3,)``.  up: x, y, z, -x, -y or
    -z, the file's axis that is up; auto finds it from the person.  human: joints by part of the person, if their names
    do not match (see ``SkeletonMap``).  Raises DeclarationError for a file of another kind, and for a damaged or
    incomplete one.
    """
    path = file_path("motion", path)
    kind = path.suffix.lower()
    if kind not in USUAL:
        raise DeclarationError("motion", "unknown file type", value=str(path), allowed=", ".join(USUAL))
    motion = read_bvh(path) if kind == ".bvh" else _read_npz(path, body_model)
    if up != "auto":
        return motion.turned(up)
    usual = USUAL[kind]
    found = up_axis(motion, joints_of(motion, parts_of(motion.names, human)), usual)
    turned = motion.turned(found)
    if found == usual:
        return turned
    return replace(turned, notes=(*turned.notes, f"the person stands along the file's axis {found}, taken as up"))


def _read_npz(path: Path, body_model: str | Path | None) -> Motion:
    data = _arrays(path)
    if has_parameters(data):
        return from_parameters(data, body_model)
    missing = [key for key in ("positions", "names", "fps") if key not in data]
    if missing:
        allowed = "positions (T, J, 3), names (J,), fps; or trans, poses, betas of SMPL-X"
        raise DeclarationError("motion", f"{path.name} lacks {', '.join(missing)}", allowed=allowed)
    try:
        names = tuple(str(np.char.decode(name, "utf-8") if name.dtype.kind == "S" else name) for name in data["names"])
        parents = tuple(int(p) for p in data["parents"]) if "parents" in data else ()
        fps = float(np.asarray(data["fps"]).item())
    except (TypeError, ValueError) as error:
        allowed = "names (J,), parents (J,), fps one number"
        raise DeclarationError("motion", f"{path.name}: {error}", allowed=allowed) from error
    return Motion(names, data["positions"], fps, parents, box=_box(data))


def _box(data: Mapping[str, Any]) -> Box | None:
    """The box of a file, None without; raises DeclarationError if a part of it is missing."""
    keys = [f"box_{name}" for name in FIELDS]
    missing = [key for key in keys if key not in data]
    if len(missing) == len(keys):
        return None
    if missing:
        raise DeclarationError("motion", f"the box lacks {', '.join(missing)}", allowed=", ".join(keys))
    return Box(*(data[key] for key in keys))


def _arrays(path: Path) -> dict[str, Any]:
    """All arrays of an npz file but those of objects; raises DeclarationError for a damaged file."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {key: array for key in file.files if (array := _array(file, key)) is not None}
    except Exception as error:  # zipfile, zlib and NumPy raise errors of a dozen types for damaged bytes
        raise DeclarationError("motion", f"no npz file: {error}", value=str(path)) from error


def _array(file: Any, key: str) -> Any:
    """An array of an npz file, None for one of objects."""
    try:
        return file[key]
    except ValueError as error:
        if "allow_pickle" in str(error):
            return None
        raise
