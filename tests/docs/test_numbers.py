"""The table of the numbers of walking and motion: each has its value in Python or C++, and tests that exist."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "numbers.md"
ROOMS = ("walking", "motion")
OTHER = {
    "walking.footsteps.LEFT", "walking.footsteps.RIGHT", "motion.clip.TURNS", "motion.page.MILLI",
    "motion.scrubber.PERSON", "motion.smplx.NAMES", "motion.targets.Z", "motion.tracker.ZERO",
    "walking.plane.hpp.kTurn",
}  # fmt: skip
"""Indices, axes, names, colours and units."""


def assigned(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Names in capitals of a module with their values, one by one."""
    for node in tree.body:
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            target, value = node.target, node.value
        else:
            continue
        pairs = [(target, value)]
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs = list(zip(target.elts, value.elts, strict=True))
        yield from ((name.id, number) for name, number in pairs if isinstance(name, ast.Name) and name.id.isupper())


def numbers() -> dict[str, str]:
    """Named numbers of both rooms by name, as in the source."""
    found = {}
    for path in sorted(path for room in ROOMS for path in (ROOT / "hqp" / room).glob("*.py")):
        for name, value in assigned(ast.parse(path.read_text(encoding="utf-8"))):
            text = ast.unparse(value)
            if re.search(r"\d", text) and not re.match("f?['\"]", text):
                found[f"{path.parent.name}.{path.stem}.{name}"] = text
    for path in sorted((ROOT / "hqp" / "cpp" / "walking").glob("*.hpp")):
        for line in re.findall(r"constexpr (?:double|int) (.+?);", path.read_text(encoding="utf-8")):
            for name, value in re.findall(r"(k\w+) = ([^,]+)", line):
                found[f"walking.{path.name}.{name}"] = value
    return {name: text for name, text in found.items() if name not in OTHER}


def rows() -> dict[str, tuple[str, str]]:
    """Value and test of each number in the table."""
    found, room = {}, ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if head := re.match(r"\| `hqp\.(\w+)` \|", line):
            room = head[1]
        elif row := re.match(r"\| `([\w.]+)` \| `(.+?)` \| [^|]+ \| [^|]+ \| (.+) \|$", line):
            found[f"{room}.{row[1]}"] = row[2], row[3]
    return found


def test_the_table_has_every_number_with_its_value() -> None:
    known = numbers()
    assert len(known) > 90
    assert {name: value for name, (value, _) in rows().items()} == known


def test_tests_in_the_table_exist() -> None:
    files = {path.name: path for path in (ROOT / "tests").rglob("test_*.py")}
    missing = []
    for name, (_, where) in rows().items():
        named = re.findall(r"(test_\w+\.py)::(test_\w+)", where)
        assert named or re.fullmatch(r"none|cell `.+`", where), name
        missing += [test for file, test in named if f"def {test}(" not in files[file].read_text(encoding="utf-8")]
    assert not missing
