"""The report in Markdown, and progress in the terminal."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks.reports import machine
from benchmarks.reports.checks import Check
from hqp.markdown import table as _table

console = Console(highlight=False)


MISSED = "missed: "
"""Prefix of a summary's line of a missed goal, which is neither a failure nor passed."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a part of the main job: summary and failures."""

    part: str
    text: str
    status: int
    seconds: float
    lines: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()

    @property
    def missed(self) -> int:
        """Number of missed goals; each has its own line."""
        return sum(line.startswith(MISSED) for line in self.lines)

    @property
    def verdict(self) -> str:
        """Verdict in words: ``passed`` only without a failure and without a missed goal."""
        return "FAILED" if self.status else f"{self.missed} missed" if self.missed else "passed"


def bar() -> Progress:
    """A progress bar for long parts."""
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), console=console,
        transient=True,
    )  # fmt: skip


def conclude(output: Path, part: str, lines: Sequence[str], failures: Sequence[str]) -> int:
    """Write a part's summary for the page of the main job; return the exit status, 1 after a failure."""
    path = output / f"{part}.summary.json"
    path.write_text(json.dumps({"lines": list(lines), "failures": list(failures)}, ensure_ascii=False))
    return int(bool(failures))


def failures_of(checks: Sequence[Check]) -> list[str]:
    """Checks that failed, a line each."""
    return [
        f"{c.equation}, {c.check}, {c.robot}: {c.measured:.2e}, allowed {c.tolerance:.0e}. {c.note}".rstrip()
        for c in checks
        if not c.passed
    ]


def goals_of(goals: Iterable[Sequence[str]]) -> list[str]:
    """Number of met speed goals in a line, and a line for each missed one."""
    listed = list(goals)
    missed = [f"{MISSED}{what}: {measured}, goal {goal}" for what, goal, measured, said in listed if said != "reached"]
    return [f"{len(listed) - len(missed)} of {len(listed)} goals of speed reached", *missed] if listed else []


def table(header: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    return _table(tuple(header), tuple(tuple(row) for row in body)) + "\n"


HEADER = ("", "kind", "equation", "check", "robot", "tolerance", "measured", "note")


def cells(check: Check) -> tuple[str, ...]:
    """A check as the cells of a table."""
    tolerance = f"{check.tolerance:.0e}" if check.tolerance else "exact"
    return (
        "ok" if check.passed else "FAIL", check.kind, check.equation, check.check, check.robot, tolerance,
        f"{check.measured:.1e}", check.note,
    )  # fmt: skip


def show(checks: Sequence[Check]) -> None:
    """Print failures and the count; the report holds every row."""
    for text in failures_of(checks):
        console.print(f"FAIL {text}", style="bold red", markup=False, soft_wrap=True)
    console.print(tally(checks))


def tally(checks: Sequence[Check]) -> str:
    """Count the passed checks, in words."""
    failed = sum(not check.passed for check in checks)
    kinds = Counter(check.kind for check in checks)
    told = f" ({', '.join(f'{count} {kind}' for kind, count in kinds.items())})" if any(kinds) else ""
    return f"{len(checks) - failed} of {len(checks)} checks passed{told}" + (f", {failed} FAILED" if failed else "")


def section(output: Path, part: str, *paragraphs: str) -> None:
    """Write the section of a part, which ``write`` gathers."""
    output.mkdir(parents=True, exist_ok=True)
    (output / f"{part}.md").write_text("\n\n".join(p.strip("\n") for p in paragraphs) + "\n")


def into_page(page: Path, mark: str, text: str, end: str = "") -> None:
    """Put a text after its mark in a page of docs/, up to ``end`` or to the end of the page."""
    head, found, rest = page.read_text(encoding="utf-8").partition(mark)
    tail = f"\n{end}{rest.partition(end)[2]}" if end else ""
    page.write_text(f"{head}{found}\n\n{text}{tail}", encoding="utf-8")


def write(output: Path, outcomes: Sequence[Outcome], quick: bool) -> Path:
    """The report: machine, outcome of each part, their sections."""
    lines = ["# Benchmark report", ""]
    if quick:
        lines += ["Made with `--quick`: a look, not a measurement.", ""]
    lines += [table(("", ""), machine.description())]
    lines += [
        table(
            ("part", "what", "outcome", "seconds"),
            ((o.part, o.text, o.verdict, f"{o.seconds:.0f}") for o in outcomes),
        )
    ]
    for outcome in outcomes:
        page = output / f"{outcome.part}.md"
        lines += [f"## {outcome.part}", ""]
        lines += [page.read_text() if page.is_file() else f"Numbers: `{outcome.part}.json`.", ""]
    path = output / "report.md"
    path.write_text("\n".join(lines))
    return path


def outcome(output: Path, part: str, text: str, status: int, seconds: float) -> Outcome:
    """Read the outcome of a part; a bad status without a reason is itself the failure."""
    path = output / f"{part}.summary.json"
    told = json.loads(path.read_text()) if path.is_file() else {"lines": [], "failures": []}
    failures = tuple(told["failures"]) or ((f"ended with status {status} (in full: {part}.log)",) if status else ())
    return Outcome(part, text, status or int(bool(failures)), seconds, tuple(told["lines"]), failures)


def gather(output: Path, outcomes: Sequence[Outcome], path: Path) -> None:
    """One JSON file with the numbers of all parts."""
    parts = {o.part: output / f"{o.part}.json" for o in outcomes}
    found = {name: json.loads(file.read_text()) for name, file in parts.items() if file.is_file()}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
