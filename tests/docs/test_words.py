"""Promises of pages to a reader: guides of bounded length, code that fits a page."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MOST = 20_000
"""Words of all guides."""
WIDEST = 88
"""Columns of a line of code."""
GUIDES = ("Start", "Tutorials", "Guide")


def sections() -> dict[str, list[Path]]:
    """Pages of each section of the site's navigation."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    found: dict[str, list[Path]] = {}
    for line in text.splitlines():
        if head := re.match(r"  - ([\w ]+):$", line):
            found[head[1]] = []
        elif page := re.match(r"\s+- ([\w/-]+\.md)$", line):
            found[list(found)[-1]].append(DOCS / page[1])
    return found


def test_guides_are_short() -> None:
    known = sections()
    pages = [page for name in GUIDES for page in known[name]]
    assert len(pages) > 15
    words = {page.name: len(page.read_text(encoding="utf-8").split()) for page in pages}
    assert sum(words.values()) <= MOST, words


def test_code_fits_a_page() -> None:
    wide = [
        f"{page.relative_to(ROOT)}: {line}"
        for page in (*DOCS.rglob("*.md"), ROOT / "README.md")
        for block in re.findall(r"^```.*?\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
        for line in block.splitlines()
        if len(line) > WIDEST
    ]
    assert not wide


def test_every_page_is_in_the_navigation() -> None:
    listed = {page for pages in sections().values() for page in pages} | {DOCS / "index.md"}
    assert not sorted(str(page) for page in set(DOCS.rglob("*.md")) - listed)
