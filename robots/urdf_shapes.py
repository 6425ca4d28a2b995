"""Shapes of a URDF whose reader drops those that it cannot read: checked here, with line and link."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

from hqp.errors import ModelError

from . import xml_lines

_SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "mesh": ()}
_KINDS = ", ".join(f"<{kind}>" for kind in _SIZES)


def check(path: Path, root: ET.Element) -> list[str]:
    """Raise ModelError for the first malformed shape; return sentences on shapes that the reader leaves out."""
    return [
        sentence
        for name, link in xml_lines.named(root, "link")
        for tag in ("collision", "visual")
        for shape in link.findall(tag)
        if (sentence := _check(path, f"link {name!r}", shape))
    ]


def _check(path: Path, what: str, shape: ET.Element) -> str:
    """Sentence on a shape of a kind that the reader leaves out, "" otherwise."""
    at = xml_lines.place(path, shape)
    geometry = shape.find("geometry")
    found = [] if geometry is None else list(geometry)
    if len(found) != 1:
        tags = ", ".join(f"<{element.tag}>" for element in found) or "no shape"
        raise ModelError(f"{at}: {what}: its <{shape.tag}> has {tags}; allowed: one of {_KINDS} in <geometry>")
    (element,) = found
    xml_lines.numbers(path, what, shape.find("origin"), "0 0 0", "xyz", "rpy")
    if element.tag not in _SIZES:
        lost = " and nothing keeps a distance from it" if shape.tag == "collision" else ""
        line = xml_lines.place(path, element).rpartition(", ")[2]
        return f"{line}: {what}: its {shape.tag} shape <{element.tag}> is not read{lost}; allowed: {_KINDS}"
    at = f"{xml_lines.place(path, element)}: {what}: <{element.tag}>"
    for name in (*_SIZES[element.tag], *(("filename",) if element.tag == "mesh" else ())):
        if not element.get(name):
            raise ModelError(f'{at} has no {name}; allowed: {name}="..."')
    if element.tag == "mesh":
        scale = xml_lines.numbers(path, what, element, "1 1 1", "scale")
        if not math.prod(scale):
            raise ModelError(f"{at}: scale {element.get('scale')!r} leaves no volume; allowed: three numbers but 0")
        return ""
    sizes = xml_lines.numbers(path, what, element, "", *_SIZES[element.tag])
    if min(sizes) < 0.0:
        raise ModelError(f"{at}: a length of {min(sizes):g} m; allowed: 0 or above")
    return ""
