"""Each promise of docs/safety.md and docs/operation.md names the tests that hold it, and these tests run."""

from __future__ import annotations

import ast
import functools
import re
import subprocess
import sys
from collections.abc import Collection
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TESTS = {path.name: path for path in (ROOT / "tests").rglob("test_*.py")}
PAGES = {name: ROOT / "docs" / f"{name}.md" for name in ("safety", "operation", "results/requirements")}
NEVER = r"\bmark\.(skip|xfail)\b"
HEAD = "| promise | test |\n|---|---|\n"


def promises(page: str) -> list[tuple[str, str]]:
    """Rows of the tables of promises: promise and tests."""
    tables = [part.partition("\n\n")[0] for part in page.split(HEAD)[1:]]
    rows = [line.strip("|").rpartition(" | ") for table in tables for line in table.splitlines()]
    return [(promise.strip(), tests.strip()) for promise, _, tests in rows]


def broken(page: str, running: Collection[str]) -> list[str]:
    """Defects of a page's promises, for the set of tests that run."""
    found = []
    for promise, tests in promises(page):
        names = re.findall(r"`(test_\w+\.py::test_\w+)`", tests)
        if not names or re.sub(r"`test_\w+\.py::test_\w+`|, ", "", tests):
            found.append(f"{promise}: no test, or what is none")
        found += [f"{promise}: {name} does not run" for name in names if name not in running]
    return found


@functools.cache
def running() -> set[str]:
    """Tests of the files named by the pages that pytest collects and never skips."""
    text = " ".join(path.read_text(encoding="utf-8") for path in PAGES.values())
    files = sorted({TESTS[name] for name in re.findall(r"test_\w+\.py", text) if name in TESTS})
    options = ["--collect-only", "-q", "--no-header", "-p", "no:cacheprovider"]
    told = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *map(str, files)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    collected = set(re.findall(r"(test_\w+\.py::test_\w+)", told))
    return collected - {f"{path.name}::{name}" for path in files for name in left_out(path)}


def left_out(path: Path) -> list[str]:
    """Tests of a file that are always skipped, or expected to fail."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    tests = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")]
    whole = any(isinstance(n, ast.Assign) and re.match(rf"pytestmark\b.*{NEVER}", ast.unparse(n)) for n in tree.body)
    marks = {test.name: " ".join(ast.unparse(mark) for mark in test.decorator_list) for test in tests}
    return [name for name, mark in marks.items() if whole or re.search(NEVER, mark)]


@pytest.mark.parametrize(("name", "least"), [("safety", 30), ("operation", 15)])
def test_every_promise_has_tests_that_run(name: str, least: int) -> None:
    page = PAGES[name].read_text(encoding="utf-8")
    assert len(promises(page)) >= least
    assert not broken(page, running())


def test_every_requirement_has_an_identifier_a_hazard_and_tests_that_run() -> None:
    page = PAGES["results/requirements"].read_text(encoding="utf-8")
    hazards = set(re.findall(r"^\| (H\d+) \|", page, re.MULTILINE))
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if re.match(r"\| REQ-\d+ [A-Z]", line)]
    assert [row[0][:6] for row in rows] == [f"REQ-{k:02}" for k in range(1, len(rows) + 1)]
    assert len(rows) >= 15
    found, missing = running(), []
    for what, hazard, tests in rows:
        assert set(hazard.split(", ")) <= hazards, what
        names = re.findall(r"`(test_\w+\.py::test_\w+)`", tests)
        assert names, what
        missing += [f"{what}: {name} does not run" for name in names if name not in found]
    assert not missing


def test_files_named_elsewhere_on_the_page_are_there() -> None:
    page = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    assert not [name for name in re.findall(r"test_\w+\.py", page) if name not in TESTS]


def test_a_promise_without_a_test_is_told() -> None:
    known = {"test_a.py::test_one"}
    rows = {
        "kept": "`test_a.py::test_one`",
        "of a file": "`test_a.py`",
        "of nothing": "",
        "of prose": "`test_a.py::test_one`, and the author's word",
        "gone": "`test_a.py::test_two`",
    }
    page = "# Page\n" + HEAD + "".join(f"| {promise} | {tests} |\n" for promise, tests in rows.items()) + "\nMore.\n"
    assert [line.partition(":")[0] for line in broken(page, known)] == ["of a file", "of nothing", "of prose", "gone"]


def test_what_is_skipped_does_not_run(tmp_path: Path) -> None:
    path = tmp_path / "test_some.py"
    path.write_text(
        "@pytest.mark.skip\ndef test_a(): ...\n@pytest.mark.xfail(reason='')\ndef test_b(): ...\ndef test_c(): ...\n"
    )
    assert left_out(path) == ["test_a", "test_b"]
    path.write_text("pytestmark = pytest.mark.skip\ndef test_a(): ...\n")
    assert left_out(path) == ["test_a"]
    path.write_text("pytestmark = pytest.mark.skipif(not kernel())\ndef test_a(): ...\n")
    assert left_out(path) == []
