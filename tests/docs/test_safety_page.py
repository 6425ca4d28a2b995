"""docs/safety.md names the test that holds each promise; these are there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_promise_names_tests_that_are_there() -> None:
    page = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    files = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")}
    rows = [line for line in page.splitlines() if line.startswith("| ") and ("`test_" in line or "`::test_" in line)]
    assert len(rows) >= 14
    for row in rows:
        for name in re.findall(r"::(test_\w+)", row):
            assert any(f"def {name}(" in text for text in files.values()), name
        for name in re.findall(r"(test_\w+\.py)", row):
            assert name in files, name
    promises = page.partition("## A change of stack")[0]
    table = [line for line in promises.splitlines() if line.startswith("| ") and line != "| promise | test |"]
    assert all("test_" in line.rpartition("|")[0].rpartition("|")[2] for line in table)
