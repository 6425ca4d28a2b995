"""XML files as elements that know their line."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from hqp.errors import ModelError

from .description import LARGEST

_TRIPLES = ("xyz", "rpy", "size", "scale")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.ASCII | re.IGNORECASE)

_PAYLOAD = re.compile(r"(?<!\S)([+-]?nan)\(\w*\)", re.ASCII | re.IGNORECASE)


class Element(ET.Element):
    """An element, with the line of its start."""

    line: int = 0


def read(path: Path) -> Element:
    """The file's root element; names keep their prefixes, declared or not.

    Raises ModelError for files that are not UTF-8 or declare entities, which the readers of models do not expand.
    """
    parser, builder = expat.ParserCreate(), ET.TreeBuilder(element_factory=Element)

    def declared(name: str, *_: object) -> None:
        at = f"{path}, line {parser.CurrentLineNumber}"
        raise ModelError(f"{at}: an entity {name!r} is declared; allowed: XML without entities, values written out")

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = builder.start(tag, attributes)
        element.line = parser.CurrentLineNumber  # type: ignore[attr-defined]

    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = declared
    try:
        content = path.read_bytes()
        parser.Parse(content, True)
        root = builder.close()
    except (expat.ExpatError, ValueError, LookupError, OSError) as error:  # bytes that are no text, encodings unknown
        raise ModelError(f"{path} could not be read: {error}") from error
    try:
        content.decode()
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ModelError(f"{path}, line {line}: a byte that is not UTF-8; allowed: files in UTF-8") from error
    assert isinstance(root, Element)
    return root


def numbers(
    path: Path, what: str, element: ET.Element | None, default: str, *names: str, most: float = LARGEST
) -> list[float]:
    """Numbers of attributes, ``default`` for missing ones; raises ModelError for another count or not finite ones."""
    values, at = [], place(path, element)
    for name in names:
        text = default if element is None else element.get(name, default)
        words = text.split()
        if not all(_NUMBER.fullmatch(word) for word in words):
            raise ModelError(f"{at}: {what}: {name}={text!r} is not a number; allowed: decimals, without units")
        parts = [float(word) for word in words]
        count = 3 if name in _TRIPLES else 1
        if len(parts) != count:
            raise ModelError(f"{at}: {what}: {name}={text!r} has {len(parts)} numbers, allowed {count}")
        if not all(abs(part) <= most for part in parts) or not all(map(math.isfinite, parts)):
            raise ModelError(f"{at}: {what}: {name}={text!r} is not finite or too large")
        values += parts
    return values


def floats(text: str) -> list[float]:
    """The numbers of a text, [] unless it has numbers alone; NaN may have a payload in brackets, as in C."""
    words = _PAYLOAD.sub(r"\1", text).split()
    return [float(word) for word in words] if all(_NUMBER.fullmatch(word) for word in words) else []


def place(path: Path, element: ET.Element | None) -> str:
    """File and line of an element, for messages."""
    return f"{path}, line {element.line}" if isinstance(element, Element) and element.line else str(path)


def where(path: Path | str, elements: str, name: str) -> str:
    """File and line of the first of some elements, by XPath, with a name; without a line if there is none."""
    if not isinstance(path, Path):
        return path
    for at, root in with_included(path):
        for found in root.iterfind(elements):
            if found.get("name") == name:
                return place(at, found)
    return str(path)


def with_included(
    path: Path, folder: Path | None = None, above: frozenset[Path] = frozenset()
) -> Iterator[tuple[Path, Element]]:
    """Root elements of a file and of those that an MJCF includes; none of a file that cannot be read."""
    folder = folder or path.parent
    try:
        root = read(path)
    except ModelError:
        return
    yield path, root
    for element in root.iter("include"):
        if (included := folder / str(element.get("file"))) not in above:
            yield from with_included(included, folder, above | {path, included})


def named(root: ET.Element, tag: str) -> Iterator[tuple[str, ET.Element]]:
    """Children of a tag with their names."""
    for element in root.findall(tag):
        yield str(element.get("name")), element
