"""The page of dates: the version of every generated table of the documentation, by git."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

from benchmarks.reports import report
from hqp.markdown import table as markdown

DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS / "results" / "dates.md"
MARK = "<!-- table: python -m benchmarks.reports.dates -->"
OPEN = re.compile(r"<!-- tables?: (.+?) -->")
HEADER = ("page", "table", "last written", "version")


def latest(path: Path, first: int, last: int) -> tuple[str, str]:
    """Day and version of the newest of these lines, from 1."""
    blame = ["git", "blame", "--porcelain", "-L", f"{first},{last}", path.name]
    text = subprocess.check_output(blame, cwd=path.parent, text=True)
    versions = set(re.findall(r"^([0-9a-f]{40}) ", text, re.MULTILINE))
    show = ["git", "log", "--no-walk=sorted", "--format=%cs %h", *versions]
    day, version = subprocess.check_output(show, cwd=path.parent, text=True).split("\n")[0].split()
    return day, version


def dates() -> str:
    """Every table between marks: its page, its command or run, and its newest line."""
    rows = []
    for path in sorted(DOCS.rglob("*.md")):
        lines = path.read_text("utf-8").splitlines()
        for k, line in enumerate(lines):
            if path != PAGE and (found := OPEN.match(line)):
                end = next((i for i in range(k, len(lines)) if lines[i].startswith("<!-- end")), len(lines))
                name = re.sub(r" --page( \S+)?$", "", found[1])
                page = os.path.relpath(path, PAGE.parent)
                rows.append((f"[{path.stem}]({page})", f"`{name}`", *latest(path, k + 2, end)))
    return markdown(HEADER, rows)


if __name__ == "__main__":
    report.into_page(PAGE, MARK, dates() + "\n", end="<!-- end -->")
