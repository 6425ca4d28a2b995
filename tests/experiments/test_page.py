"""The pages' figures of many runs are those of the committed runs."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from benchmarks.sentis2012.experiments import statistics as st

DOCS = Path(__file__).parents[2] / "docs"
PAGE, DATA = DOCS / "dreamer-experiments.md", DOCS / "data"


def lines() -> list[dict[str, Any]]:
    def plain(value: Any) -> Any:
        return {k: math.inf if v is None else v for k, v in value.items()} if isinstance(value, dict) else value

    read = json.loads((DATA / "dreamer-statistics.json").read_text())
    return [{name: plain(value) for name, value in line.items()} for line in read]


def test_every_row_of_the_page_is_that_of_the_committed_percentiles() -> None:
    page = PAGE.read_text()
    for line in lines():
        (row,) = st.shown([line]).rows
        cells = (row[0].removeprefix("one controller, "), *row[1:])
        assert "| " + " | ".join(cells).rstrip() in page, line["cell"]


def test_the_headline_is_that_of_the_committed_percentiles() -> None:
    (line,) = [line for line in lines() if line["cell"] == "nominal-imu"]
    worst = max(line["com_up_mm"]["worst"], line["com_back_mm"]["worst"])
    assert (line["runs"], line["falls"]) == (300, 0)
    assert 3.8 < worst < 3.9
    assert "within 3.9 mm in each of 300 runs" in (DOCS.parent / "README.md").read_text()


def test_the_committed_percentiles_are_those_of_the_committed_runs() -> None:
    pytest.importorskip("pyarrow")
    from hqp import sweep

    rows = sweep.read(DATA / "dreamer-statistics").to_pylist()
    made = st.runs_of(list(st.by_case(rows, {row["code"] for row in rows}).values()), list(st.registry()))
    found = [st.summary(name, own) for name, own in made.items()]
    assert json.loads(json.dumps(st.finite(found))) == json.loads((DATA / "dreamer-statistics.json").read_text())
