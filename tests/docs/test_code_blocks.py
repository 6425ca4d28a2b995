"""Every Python block of the README and of the docs runs; later blocks of a page use the names of earlier ones."""

from __future__ import annotations

import gc
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from hqp import Stack
from tests.scenes import mistry2008, sentis2012

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: Path, language: str) -> list[tuple[int, str]]:
    text = page.read_text()
    return [(text[: m.start()].count("\n") + 2, m[2]) for m in FENCE.finditer(text) if m[1] == language]


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python")], ids=lambda p: p.name)
def test_python_blocks_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    module = ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", module)  # classes look up their module
    for line, code in blocks(page, "python"):
        source = "\n" * (line - 1) + code  # tracebacks then point into the page
        exec(compile(source, str(page), "exec", dont_inherit=True), module.__dict__)
    gc.unfreeze()  # a loop of a page may have frozen the heap


def test_the_loop_of_the_quickstart_is_spared_full_collections() -> None:
    code = next(c for _, c in blocks(ROOT / "docs/quickstart.md", "python") if "session.step(" in c)
    assert 0 < code.index("gc.freeze()") < code.index("session.step(")


def test_toml_blocks_are_stacks() -> None:
    from hqp import serial

    found = [code for page in PAGES for _, code in blocks(page, "toml") if "[[level]]" in code]
    assert found
    for code in found:
        stack = serial.loads(code)
        assert serial.loads(serial.dumps(stack)) == stack


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:\s]+)\)", page.read_text()):
        assert (page.parent / target).exists(), f"{page.name}: {target}"


def _shape(stack: Stack) -> list[list[tuple[str, object, object]]]:
    """Kind, frame and axes of every member of every level, and of ``subject_to`` without limits."""
    parts = [*(level.elements for level in stack.levels), [e for e in stack.subject_to if e.equality]]
    return [[(type(e).__name__, getattr(e, "frame", None), getattr(e, "axes", None)) for e in part] for part in parts]


@pytest.mark.parametrize(
    ("page", "theirs"),
    [
        ("docs/results/cbi.md", mistry2008.paper_stack(mistry2008.CBI)),
        ("docs/torque.md", sentis2012.paper_stack()),
    ],
)
def test_stacks_of_the_papers_are_shown_as_they_are_run(page: str, theirs: Stack) -> None:
    module: dict[str, object] = {}
    code = blocks(ROOT / page, "python")[0][1]
    exec(compile(code.partition("\nsession =")[0], page, "exec", dont_inherit=True), module)
    shown = module["stack"]
    assert isinstance(shown, Stack)
    assert _shape(shown) == _shape(theirs)


def test_first_examples_put_the_feet_into_subject_to() -> None:
    """Contacts are physics; newcomers copy the first example."""
    for page in ("README.md", "docs/quickstart.md"):
        code = next(c for _, c in blocks(ROOT / page, "python") if "FixedContact(" in c and "Stack(" in c)
        module: dict[str, object] = {}
        code = code.partition("\nsession =")[0].partition("\nassert ")[0]
        exec(compile(code, page, "exec", dont_inherit=True), module)
        stack = module["stack"]
        assert isinstance(stack, Stack)
        assert sum(type(e).__name__ == "FixedContact" for e in stack.subject_to) == 2
