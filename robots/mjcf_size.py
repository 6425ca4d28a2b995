"""The number of bodies of an MJCF, counted before MuJoCo makes them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from hqp.errors import ModelError

BODIES = 3000
"""Most bodies of an MJCF: MuJoCo's reader takes 3 s for 3000 that are replicated, and more than ten times that for
10 000."""


def check_bodies(path: Path) -> None:
    """Raise ModelError if an MJCF has too many bodies, replicated and included ones counted."""
    found = _bodies(path, path.parent, frozenset())
    if found > BODIES:
        raise ModelError(
            f"{path}: has {found} bodies with those that <replicate> makes, allowed at most {BODIES}: lower its count"
        )


def _bodies(path: Path, folder: Path, above: frozenset[Path]) -> int:
    """Bodies of a file; 0 if it cannot be read, which MuJoCo explains."""
    try:
        root = ET.parse(path).getroot()
    except (OSError, ET.ParseError, ValueError, LookupError):
        return 0
    found, left = 0, [(root, 1)]
    while left:
        element, times = left.pop()
        if element.tag == "include" and element.get("file"):
            included = folder / str(element.get("file"))
            if included not in above:
                found += times * _bodies(included, folder, above | {path, included})
        if element.tag == "replicate":
            times *= _count(element.get("count", "1"))
        found += times * (element.tag == "body")
        left += [(child, times) for child in element]
    return found


def _count(text: str) -> int:
    try:
        return max(int(text), 0)
    except ValueError:
        return 1  # MuJoCo explains it
