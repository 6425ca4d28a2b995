"""Table of elements and formulations: every cell is run, and the page has the results."""

from __future__ import annotations

import pytest

from benchmarks.reports.elements import EXAMPLES, FILES, FORMULATIONS, PAGE, works
from hqp import serial, tasks


def test_every_element_has_a_row() -> None:
    assert set(EXAMPLES) == set(tasks.__all__)


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_cells_are_what_runs(name: str) -> None:
    (row,) = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `{name}` |")]
    told = [cell.strip() for cell in row.split("|")[2:5]]
    assert told == ["yes" if works(name, formulation) else "–" for formulation in FORMULATIONS]


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_files_declare_what_ran(name: str) -> None:
    """The page's TOML equals the element in the table's stack, read back whole."""
    page = FILES.read_text(encoding="utf-8")
    text = page.split(f"## {name}\n\n```toml\n")[1].split("```")[0]
    stack = serial.loads(text if "[[level]]" in text else f'[[level]]\n[[level.element]]\ntype = "Posture"\n{text}')
    read = (*stack.subject_to, *stack.levels[0].elements)[0]
    assert read == EXAMPLES[name]()[-1]
