"""Prose of comments, docstrings and pages by room: indirect sentences stay below a ceiling per 1000 sentences."""

from __future__ import annotations

import ast
import math
import re
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]

PATTERNS = (
    r"^(whether|where|what|who|whose|which|how|that|by how|by what|so many|those|these are)\b",
    r"\b(what|whatever|whatsoever)\b",
    r"^(of|the same|that of|those of)\b",
    r"\b(asks?|asked|tells?|told|says?|said)\b",
)
"""A clause for a subject; "what"; "Of" and "The same" for a noun; speech for reports and requests."""

CEILINGS = 10, 8, 10, 8
"""Ceilings of a room per 1000 sentences, by pattern."""

SPARE = 4
"""Sentences above the ceiling that a room may have: rooms are small."""


def room(path: str) -> str:
    """The folder of a file: two levels, three in native code; a page by its folder."""
    parts = path.split("/")[:-1]
    return "/".join(parts[: 3 if parts[:2] == ["hqp", "cpp"] else 2]) or path


def statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """All statements of a file, flat: a walk over expressions takes most of the time."""
    for node in body:
        yield node
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from statements(getattr(node, name, []))


def prose(path: Path) -> Iterator[str]:
    """Texts of a file that people read: pages without code, docstrings, comments."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        yield re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    elif path.suffix in {".py", ".pyi"}:
        for node in statements(ast.parse(text).body):
            if (
                isinstance(node, ast.Expr)
                and isinstance(node.value, ast.Constant)
                and isinstance(node.value.value, str)
            ):
                yield node.value.value
        yield from re.findall(r"(?:^[ \t]*|  )(# .*)$", text, re.MULTILINE)
    else:
        for block in re.findall(r"(?:^[ \t]*//[^\n]*\n)+", text, re.MULTILINE):
            yield re.sub(r"^[ \t]*//", "", block, flags=re.MULTILINE)
        yield from re.findall(r"[;{},)] +//(.*)$", text, re.MULTILINE)


def sentences(text: str) -> Iterator[str]:
    """Parts of at least three words between full stops, colons, semicolons and blank lines."""
    for part in re.split(r"(?<=[.;:])\s+|\n\s*\n", text):
        found = re.sub(r"\s+", " ", part).strip(" #*-|/")
        if len(found.split()) > 2:
            yield found


def counted() -> tuple[Counter[str], dict[str, list[list[str]]]]:
    """Number of sentences of each room, and its indirect ones by pattern."""
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    total: Counter[str] = Counter()
    found: dict[str, list[list[str]]] = {}
    for name in files:
        path = ROOT / name
        if path.suffix not in {".py", ".pyi", ".hpp", ".cpp", ".md"} or "results" in name or path.is_symlink():
            continue
        if not path.is_file() or name.startswith(("build", "tests/data")):
            continue
        lists = found.setdefault(room(name), [[] for _ in PATTERNS])
        for text in prose(path):
            for sentence in sentences(text):
                total[room(name)] += 1
                for k, pattern in enumerate(PATTERNS):
                    if re.search(pattern, sentence, re.IGNORECASE):
                        lists[k].append(f"{name}: {sentence}")
    return total, found


def test_prose_is_direct() -> None:
    total, found = counted()
    assert sum(total.values()) > 5000
    over = []
    for name, lists in found.items():
        for k, (listed, ceiling) in enumerate(zip(lists, CEILINGS, strict=True)):
            if len(listed) > math.ceil(ceiling * total[name] / 1000) + SPARE:
                over.append(
                    f"{name}: {len(listed)} of {total[name]}, ceiling {ceiling}, as in {listed[-3:]}, {PATTERNS[k]}"
                )
    assert not over, "write subject, verb, object, condition (CONTRIBUTING.md):\n" + "\n".join(over)


def test_indirect_sentences_are_counted() -> None:
    text = "Whether it holds. What is asked of a row; Of each row its bound. Return the active rows of a level."
    flagged = [[bool(re.search(p, s, re.IGNORECASE)) for p in PATTERNS] for s in sentences(text)]
    assert flagged == [[True, False, False, False], [True, True, False, True], [False, False, True, False], [False] * 4]
