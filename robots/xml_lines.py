"""XML files as elements that know their line."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from hqp.errors import ModelError


class Element(ET.Element):
    """An element, with the line of its start."""

    line: int = 0


def read(path: Path) -> Element:
    """The file's root element; names keep their prefixes, declared or not.  Raises ModelError."""
    parser, builder = expat.ParserCreate(), ET.TreeBuilder(element_factory=Element)

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = builder.start(tag, attributes)
        element.line = parser.CurrentLineNumber  # type: ignore[attr-defined]

    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(path.read_bytes(), True)
        root = builder.close()
    except (expat.ExpatError, ValueError, LookupError, OSError) as error:  # bytes that are no text, encodings unknown
        raise ModelError(f"{path} could not be read: {error}") from error
    assert isinstance(root, Element)
    return root


def place(path: Path, element: ET.Element | None) -> str:
    """File and line of an element, for messages."""
    return f"{path}, line {element.line}" if isinstance(element, Element) and element.line else str(path)


def named(root: ET.Element, tag: str) -> Iterator[tuple[str, ET.Element]]:
    """Children of a tag with their names."""
    for element in root.findall(tag):
        yield str(element.get("name")), element
