"""Classes of the native code have one definition: the linker merges two of one name, and calls the wrong one."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

SOURCES = Path(__file__).parents[2] / "hqp" / "cpp"
DEFINED = re.compile(
    r"^(?:inline )?namespace (?P<room>\w*)|^(?:class|struct) (?P<name>\w+)(?: final)?(?: :[^;{]*)?\s*\{", re.MULTILINE
)


def twice(sources: Mapping[str, str]) -> dict[tuple[str, str], set[str]]:
    """Namespace and name of classes with several definitions, with their files; anonymous namespaces are apart."""
    found: dict[tuple[str, str], set[str]] = defaultdict(set)
    for path, text in sources.items():
        room = ""
        for match in DEFINED.finditer(text):
            if match["name"] is None:
                room = match["room"]
            elif room:
                found[room, match["name"]].add(path)
    return {key: paths for key, paths in found.items() if len(paths) > 1}


def test_a_class_has_one_definition() -> None:
    one = "namespace hqp {\ninline namespace HQP_ISA {\nclass Rows final : public Base {\n"
    assert twice({"a": one, "b": one}) == {("HQP_ISA", "Rows"): {"a", "b"}}
    assert not twice({"a": one, "b": "namespace hqp {\nclass Rows {\n", "c": "namespace {\nclass Rows {\n"})
    paths = sorted([*SOURCES.rglob("*.hpp"), *SOURCES.rglob("*.cpp")])
    assert len(paths) > 100
    assert not twice({str(path.relative_to(SOURCES)): path.read_text(encoding="utf-8") for path in paths})
