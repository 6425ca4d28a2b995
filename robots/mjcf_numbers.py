"""Numbers of an MJCF that are not finite or too large, by line, element and attribute: MuJoCo names none of them."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from hqp.errors import ModelError

from . import xml_lines
from .description import LARGEST

_TEXT = ("name", "class", "childclass", "file", "model", "prefix")
_FORMAT = re.compile(r"bad format in attribute '(\w+)' Element '(\w+)'")
"""MuJoCo's error for a text that is no number, without the line if the element is in an included file."""


def check(path: Path) -> None:
    """Raise ModelError for a NaN, in the file or those that it includes, wherever MuJoCo would take it."""
    for at, value in _odd(path):
        if math.isnan(value):
            raise ModelError(at)


def first(path: Path | str) -> str:
    """The first number that is not finite or too large, in words; "" without one."""
    return next((at for at, _ in _odd(path)), "") if isinstance(path, Path) else ""


def explained(path: Path, error: Exception) -> str:
    """Why MuJoCo does not read a file: the number that it stumbles over, or its own words."""
    told = " ".join(str(error).split())
    attribute, tag = found.groups() if (found := _FORMAT.search(told)) else ("", "")
    for at, root in xml_lines.with_included(path) if tag else ():
        for element in root.iter(tag):
            text = element.get(attribute, "")
            if text and not xml_lines.floats(text):
                return f"{_place(at, element)}: {attribute}={text!r} has words that are no numbers"
    return first(path) or f"{path} could not be read: {told}"


def _odd(path: Path) -> Iterator[tuple[str, float]]:
    """Numbers that are not finite or too large, in words."""
    for at, root in xml_lines.with_included(path):
        for element in root.iter():
            for name, text in element.attrib.items():
                for value in () if name in _TEXT else xml_lines.floats(text):
                    if not abs(value) < LARGEST:
                        short = text if len(text) < 60 else f"{text[:56]} ..."
                        reason = f"{name}={short!r} is not finite or too large; allowed: numbers below {LARGEST:g}"
                        yield f"{_place(at, element)}: {reason}", value


def _place(path: Path, element: ET.Element) -> str:
    name = element.get("name", "")
    return f"{xml_lines.place(path, element)}: {f'{element.tag} {name!r}' if name else f'<{element.tag}>'}"
