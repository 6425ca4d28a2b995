"""URDF or MJCF, by the root element of a file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

from hqp.errors import ModelError

_SKIPPED = re.compile(rb"<!--.*?-->|<\?.*?\?>|<!DOCTYPE[^>]*>", re.DOTALL)
_ELEMENT = re.compile(rb"<\s*([A-Za-z_][\w.:-]*)")
_KINDS: dict[bytes, Literal["urdf", "mjcf"]] = {b"robot": "urdf", b"mujoco": "mjcf"}


def of(path: Path) -> Literal["urdf", "mjcf"]:
    """The kind of a file; raises ModelError if its root element is that of neither."""
    try:
        text = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path} could not be read: {error}") from error
    if text.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = text.decode("utf-16", errors="replace").encode()
    found = _ELEMENT.search(_SKIPPED.sub(b"", text))
    kind = _KINDS.get(found[1]) if found is not None else None
    if kind is None:
        given = "no element" if found is None else f"<{found[1].decode(errors='replace')}>"
        raise ModelError(f"{path}: its root element is {given}; allowed: <robot> (URDF), <mujoco> (MJCF)")
    return kind
