"""Files of numbers in the user's cache folder, for results that take seconds: each with a checksum."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from functools import cache
from pathlib import Path
from typing import Any


def folder(part: str) -> Path:
    """``hqp/<part>`` in XDG_CACHE_HOME or in the platform's folder of caches; it can be deleted at any time.

    Raises RuntimeError if the user has no home.
    """
    given = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(given):
        base = Path(given)
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        base = Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
    return base / "hqp" / part


def read(path: Path) -> Any:
    """Content of a file; None if it is missing, or not as it was written."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return data["content"] if data["sha256"] == _checksum(path, data["content"]) else None
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None


def write(path: Path, content: Any) -> None:
    """Write a file beside it, then rename it: another program reads all of it or nothing.  Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_text(json.dumps({"sha256": _checksum(path, content), "content": content}), encoding="utf-8")
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


@cache
def sources() -> bytes:
    """Digest of the package's Python files: other code may find other results."""
    digest, root = hashlib.sha256(), Path(__file__).parent
    for path in source_files():
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.digest()


def source_files() -> list[Path]:
    """Python files of the package; folders may be links."""
    walk = os.walk(Path(__file__).parent, followlinks=True)
    return sorted(Path(folder, name) for folder, _, names in walk for name in names if name.endswith(".py"))


def _checksum(path: Path, content: Any) -> str:
    """Checksum of the content and of the inputs that it belongs to, which are in the file's name."""
    return hashlib.sha256(f"{path.name}\n{json.dumps(content)}".encode()).hexdigest()
