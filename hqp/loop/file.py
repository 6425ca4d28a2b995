"""The file of a plan: a line that says what it is, and JSON (docs/plan_file.md)."""

from __future__ import annotations

import hmac
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hqp
from hqp.errors import DeclarationError
from hqp.loop.arrays import plain
from hqp.loop.document import document

if TYPE_CHECKING:
    from hqp.declare.stack import Stack
    from hqp.loop.session import Session
    from hqp.sequence import Sequence

FORMAT = 1
"""Changes with what a file means."""


def text(
    session: Session,
    sequence: Sequence | None = None,
    key: bytes | None = None,
    stacks: Mapping[str, Stack] | None = None,
) -> bytes:
    """The whole file of a session: the same bytes for the same declarations; signed with a key."""
    secret = key_bytes(key)
    tree, scratch = document(session, sequence, stacks)
    found, buffers = plain(tree, scratch)
    body = json.dumps({**found, "buffers": buffers}, separators=(",", ":"), allow_nan=False).encode()
    head = f"hqp plan, format {FORMAT}, version {hqp.__version__}, size {len(body)}, hash {fnv1a(body):016x}"
    signature = f", hmac {hmac.digest(secret, body, 'sha256').hex()}" if secret else ""
    return f"{head}{signature}\n".encode() + body


def key_bytes(key: bytes | None) -> bytes:
    """The key of a site, empty for None; raises DeclarationError for anything but some bytes."""
    if key is not None and (not isinstance(key, bytes) or not key):
        kind = "empty" if key == b"" else type(key).__name__
        raise DeclarationError("plan", "bad key", value=kind, allowed="bytes, at least one, or None")
    return key or b""


def write(
    session: Session,
    path: str | os.PathLike[str],
    sequence: Sequence | None = None,
    key: bytes | None = None,
    stacks: Mapping[str, Stack] | None = None,
) -> None:
    """Write the file of a session, all of it or nothing."""
    target = Path(path)
    beside = target.with_name(f".{target.name}.{os.getpid()}")
    beside.write_bytes(text(session, sequence, key, stacks))
    os.replace(beside, target)


def fnv1a(data: bytes) -> int:
    """The FNV-1a hash of 64 bits: tells a file that was changed or damaged, not one that was forged."""
    found = 0xCBF29CE484222325
    for byte in data:
        found = (found ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return found


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The tree of a file, to look at."""
    content: dict[str, Any] = json.loads(Path(path).read_bytes().split(b"\n", 1)[1])
    return content
