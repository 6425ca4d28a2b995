"""The harness: a row without a measurement fails, a failed row sets the exit status, numbers are as promised."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks import papers
from benchmarks.mistry2008.equations import theorems
from benchmarks.reports import report
from benchmarks.reports.checks import Check, at_most, exactly, seen_to_fail, write_json
from benchmarks.speed import teleoperation, ticks, timing
from hqp import robots, solvers
from hqp.problem import Stats


def test_at_most_needs_values_within_the_tolerance() -> None:
    assert at_most("e", "c", "r", 1e-9, [0.0, 1e-9]).passed
    assert not at_most("e", "c", "r", 1e-9, [0.0, 2e-9]).passed


@pytest.mark.parametrize("values", [[], [0.0, math.nan]])
def test_nothing_measured_is_a_failure(values: list[float]) -> None:
    assert not at_most("e", "c", "r", 1.0, values).passed
    assert not seen_to_fail("e", "c", "r", 1.0, [math.nan] if values else []).passed


def test_exactly_shows_the_largest_deviation() -> None:
    assert exactly("e", "c", "r", 14, [14, 14]).passed
    check = exactly("e", "c", "r", 14, [14, 12])
    assert (check.passed, check.measured) == (False, 2.0)
    assert not exactly("e", "c", "r", 14, []).passed


def test_a_negative_control_fails_where_the_formula_is_right() -> None:
    assert seen_to_fail("e", "c", "r", 1e-12, [0.5, 0.5, 1e-16]).passed
    assert not seen_to_fail("e", "c", "r", 1e-12, [0.5, 1e-16, 1e-16]).passed


def test_json_has_the_promised_fields_and_no_nan(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "rows.json"
    write_json(path, [Check("M(1)", "x", "cbi", 1e-9, math.nan, False, "n")])
    (row,) = json.loads(path.read_text())
    assert set(row) == {"equation", "check", "kind", "robot", "tolerance", "measured", "passed", "note"}
    assert row["measured"] is None


def _fake_papers(monkeypatch: pytest.MonkeyPatch, passed: bool) -> None:
    check = Check("M(2)", "x", "cbi", 1e-9, 0.0 if passed else 1.0, passed)
    monkeypatch.setattr(papers, "mistry", lambda names, count, output: ([check], []))
    monkeypatch.setattr(papers, "sentis", lambda percent, signs, output: ([], []))


@pytest.mark.parametrize(("passed", "status"), [(True, 0), (False, 1)])
def test_a_failing_check_is_the_exit_status(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, passed: bool, status: int
) -> None:
    _fake_papers(monkeypatch, passed)
    assert command.main(["papers", "--output", str(tmp_path), "--json", str(tmp_path / "p.json")]) == status
    assert json.loads((tmp_path / "p.json").read_text())[0]["passed"] is passed
    assert ("FAIL" in (tmp_path / "papers.md").read_text()) is not passed


PART = """
import json, pathlib, sys
name, output = sys.argv[1], pathlib.Path(sys.argv[sys.argv.index("--output") + 1])
failures = ["too far"] if name == "compare" else []
lines = [name, *(["missed: p99: 2 ms, goal 1 ms"] if name == "timing" else [])]
(output / f"{name}.md").write_text(f"section of {name}")
(output / f"{name}.json").write_text("[1]")
(output / f"{name}.summary.json").write_text(json.dumps({"lines": lines, "failures": failures}))
print("log of", name)
sys.exit(3 if name == "calm" else bool(failures))
"""


def test_the_main_job_gathers_sections_and_worst_status(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "PYTHON", (sys.executable, "-c", PART))
    (tmp_path / "timing.md").write_text("from an earlier run")
    monkeypatch.setattr(command, "present", lambda part: part in ("papers", "calm", "compare"))
    assert command.main(["--output", str(tmp_path), "--json", str(tmp_path / "all.json")]) == 3
    text = (tmp_path / "report.md").read_text()
    parts = [line.split("|")[1].strip() for line in text.splitlines() if "| FAILED |" in line]
    assert parts == ["compare", "calm"]
    assert all(f"section of {name}" in text for name in ("papers", "compare", "calm"))
    assert "native" in text
    assert "earlier run" not in text
    assert list(json.loads((tmp_path / "all.json").read_text())) == ["papers", "compare", "calm"]
    assert (tmp_path / "calm.log").read_text() == "log of calm\n"
    told = capsys.readouterr().out
    assert "too far" in told
    assert "ended with status 3" in told


@pytest.mark.long
def test_the_main_job_runs_a_part(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(command, "present", lambda part: part == "papers")
    monkeypatch.setitem(command.SMALLER, "papers", ("--robots", "none"))
    assert command.main(["--output", str(tmp_path), "--quick"]) == 1
    assert "'none'" in (tmp_path / "papers.log").read_text()


@pytest.mark.parametrize("full", [False, True])
def test_the_main_job_asks_less_of_a_part_unless_in_full(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, full: bool
) -> None:
    monkeypatch.setattr(command, "PYTHON", (sys.executable, "-c", "import sys; print(sys.argv)"))
    monkeypatch.setattr(command, "present", lambda part: part == "papers")
    command.main(["--output", str(tmp_path), *(["--full"] if full else [])])
    assert ("--states" in (tmp_path / "papers.log").read_text()) is not full


def test_options_may_come_before_the_part(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    _fake_papers(monkeypatch, True)
    assert command.main(["--output", str(tmp_path), "papers"]) == 0


def test_an_unknown_part_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(["nothing"])
    assert "papers" in capsys.readouterr().err


@dataclass(frozen=True)
class _Unasked(solvers.Solver):
    """Wrap a back end in name only: the projector answers, without any iteration."""

    name = "unasked"
    accuracy = 1e-8
    refine: bool = True

    def workspace(self, shape: Any) -> Any:
        return self

    def solve(self, problem: Any) -> Any:
        answer = solvers.load("nullspace", ignore_inequalities=True).solve(problem)
        return replace(answer, stats=Stats())


def test_a_back_end_that_was_not_asked_fails_its_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(theorems.solver_sets, "exact", lambda: {"unasked": _Unasked()})
    checks = list(theorems._equal_to_projector(robots.load("talos"), 1))
    assert checks
    assert not any(check.passed for check in checks)


def test_the_box_that_has_a_back_end_asked_is_never_active() -> None:
    rng = np.random.default_rng(0)
    stack = [(rng.standard_normal((3, 8)), rng.standard_normal(3))]
    answer = theorems.ask(solvers.load("cascade:proxqp"), stack)
    assert theorems.asked(solvers.load("cascade:proxqp"), answer)
    assert not answer.active[0].any()


def test_a_timed_run_has_the_promised_numbers() -> None:
    run = ticks.paper(robots.load("talos"), "lexicographic", solvers.load("lexicographic"), ticks.JUDGED)
    record = run.record()
    assert {"robot", "stack", "solver", "ticks", "wall_us", "cpu_us", "split_us", "floor_us", "misses"} <= set(record)
    assert set(record["wall_us"]) == {"median", "p99", "max"}  # type: ignore[call-overload]
    assert set(record["split_us"]) == {"state", "assemble", "solve", "command"}  # type: ignore[call-overload]
    assert run.unsolved == 0
    assert 0.0 < run.gap < 1e-6
    assert not timing.wrong(run)
    assert timing.wrong(replace(run, run=replace(run.run, gaps=np.array([1e-3]))))
    assert timing.wrong(replace(run, run=replace(run.run, gaps=np.array([math.nan]))))
    assert np.all(run.run.times.sum(axis=1) <= run.wall)


def test_hands_that_follow_a_goal_are_measured_with_their_ratios() -> None:
    runs = [run for name in ("ur5", "panda", "g1") for run in teleoperation.measure(name, 100) if "hqp" in run.name]
    assert [run.robot for run in runs] == ["ur5", "panda", "g1"]
    for run in runs:
        record = run.record()
        assert run.unsolved == 0
        assert 1e-4 < run.off < 0.03  # it follows, a little behind
        assert record["times_floor"] == pytest.approx(np.median(run.wall) / np.median(run.floor))
    assert len(list(teleoperation.rows(runs))) == 3
    said = {line[0]: line[3] for line in teleoperation.outcomes([replace(run, wall=0.1 * run.floor) for run in runs])}
    assert set(said.values()) == {"reached"}
    assert "over the two calls" in " ".join(said)
    slow = list(teleoperation.outcomes([replace(run, wall=1e3 * run.floor) for run in runs]))
    assert {line[3] for line in slow} == {"MISSED"}


def test_a_table_keeps_bars_inside_cells() -> None:
    assert report.table(("a",), [("|w|",)]).splitlines()[2] == r"| \|w\| |"


@pytest.mark.long
def test_passed_stands_above_no_missed_goal(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "PYTHON", (sys.executable, "-c", PART))
    monkeypatch.setattr(command, "present", lambda part: part in ("papers", "timing"))
    assert command.main(["--output", str(tmp_path)]) == 0  # a missed goal is no failure
    rows = [line.split("|") for line in (tmp_path / "report.md").read_text().splitlines() if line.startswith("| ")]
    assert {row[1].strip(): row[3].strip() for row in rows if len(row) > 4} == {
        "part": "outcome", "---": "---", "papers": "passed", "timing": "1 missed",
    }  # fmt: skip
    told = capsys.readouterr().out
    assert "1 of 2 parts passed, 1 goals missed" in told
    (of_timing,) = (line for line in told.splitlines() if line.startswith("timing"))
    assert "passed" not in of_timing
