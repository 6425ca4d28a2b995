"""Tables of the pages match the committed runs."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from benchmarks import pages
from benchmarks.sentis2012.experiments import statistics

pytest.importorskip("pyarrow")

MANY = 20
"""Least number of runs behind a promise."""


@pytest.mark.long
def test_every_table_is_that_of_the_committed_runs() -> None:
    for path, text in pages.files().items():
        assert path.read_text() == text, f"{path.name}: python -m benchmarks pages"


def test_a_table_that_was_changed_by_hand_is_seen() -> None:
    page = (pages.DOCS / pages.PAGES[0]).read_text()
    changed = page.replace("| nominal-imu | own map | 300 |", "| nominal-imu | own map | 301 |")
    assert changed != page
    assert pages.renewed(changed, pages.tables()) == page


def test_the_headline_is_that_of_the_committed_percentiles() -> None:
    lines = json.loads((pages.DATA / "dreamer-statistics.json").read_text())
    (line,) = [line for line in lines if line["cell"] == "nominal-imu"]
    worst = max(line["com_up_mm"]["worst"], line["com_back_mm"]["worst"])
    assert (line["runs"], line["falls"]) == (300, 0)
    assert 3.8 < worst < 3.9
    readme = (Path(pages.DOCS).parent / "README.md").read_text()
    assert "within 3.9 mm in each of 300 runs" in readme
    assert re.search(r"3\.9 mm in each of 300\s+runs", (pages.DOCS / pages.PAGES[0]).read_text())


def test_what_is_promised_has_many_runs_and_holds() -> None:
    lines = {line["cell"]: line for line in json.loads((pages.DATA / "dreamer-statistics.json").read_text())}
    for name in statistics.PROMISED:
        assert lines[name]["runs"] >= MANY, name
        assert lines[name]["passed"], name
        assert lines[name]["promised"] is not None
    assert sum(line["promised"] is not None for line in lines.values()) == len(statistics.PROMISED)
