"""The driver of tables over many runs: cases are run once, read in order, and shown without running."""

from __future__ import annotations

import json
import math
from pathlib import Path

from benchmarks.lab import sweeps
from benchmarks.lab.outcome import table
from hqp import sweep


def test_missing_runs_are_made_once_and_read_in_order(tmp_path: Path) -> None:
    def rows(*numbers: int, only_read: bool = False, code: str = "now") -> list[int]:
        cases = sweep.Sweep(f"{__name__}:twice", [{"x": n} for n in numbers], code)
        found = sweeps.rows(cases, tmp_path, jobs=1, only_read=only_read, show=False)
        return [sweeps.plain(row)["double"] for row in found]

    assert rows(1, 2) == [2, 4]
    assert rows(3, 1, 2) == [6, 2, 4]
    assert rows(2, 5, only_read=True) == [4]
    assert rows(2, code="older", only_read=True) == [4]
    assert len(sweep.read(tmp_path).to_pylist()) == 3
    assert rows(2, code="older") == [4]
    assert len(sweep.read(tmp_path).to_pylist()) == 4


def test_data_of_a_table_have_null_for_infinity(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "table.json"
    sweeps.show([table("Falls", ("robot", "fell"), [("g1", "never")])], {"g1": {"fell": math.inf}}, path)
    assert json.loads(path.read_text()) == {"g1": {"fell": None}}


def twice(x: int) -> dict[str, int]:
    """A figure of a run."""
    return {"double": 2 * x}
