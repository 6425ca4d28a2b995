"""The report in Markdown and what is shown while it grows."""

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

console = Console(highlight=False)


@dataclass(frozen=True)
class Outcome:
    """How a part of the main job went."""

    part: str
    text: str
    status: int
    seconds: float


def heading(text: str) -> None:
    """A rule across the terminal."""
    console.rule(text, align="left")


def bar() -> Progress:
    """A progress bar for long parts."""
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), console=console,
        transient=True,
    )  # fmt: skip


def table(header: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    rows = [tuple(header), tuple("---" for _ in header), *(tuple(row) for row in body)]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows) + "\n"


HEADER = ("", "kind", "equation", "check", "robot", "tolerance", "measured", "note")


def cells(check: Check) -> tuple[str, ...]:
    """A check as the cells of a table."""
    tolerance = f"{check.tolerance:.0e}" if check.tolerance else "exact"
    return (
        "ok" if check.passed else "FAIL", check.kind, check.equation, check.check, check.robot, tolerance,
        f"{check.measured:.1e}", check.note,
    )  # fmt: skip


def show(checks: Sequence[Check]) -> None:
    """The checks in the terminal, failures in red, and their count."""
    body = [cells(check) for check in checks]
    widths = [max(len(row[i]) for row in (HEADER, *body)) for i in range(len(HEADER))]
    for row, check in zip((HEADER, *body), (None, *checks), strict=True):
        text = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        failed = check is not None and not check.passed
        console.print(text, style="bold red" if failed else None, markup=False, soft_wrap=True)
    console.print(tally(checks))


def tally(checks: Sequence[Check]) -> str:
    """How many checks passed."""
    failed = sum(not check.passed for check in checks)
    kinds = Counter(check.kind for check in checks)
    told = f" ({', '.join(f'{count} {kind}' for kind, count in kinds.items())})" if any(kinds) else ""
    return f"{len(checks) - failed} of {len(checks)} checks passed{told}" + (f", {failed} FAILED" if failed else "")


def section(output: Path, part: str, *paragraphs: str) -> None:
    """Write the section of a part, to be gathered by ``write``."""
    output.mkdir(parents=True, exist_ok=True)
    (output / f"{part}.md").write_text("\n\n".join(p.strip("\n") for p in paragraphs) + "\n")


def write(output: Path, outcomes: Sequence[Outcome], quick: bool) -> Path:
    """The report: machine, outcome of each part, their sections."""
    lines = ["# Benchmark report", ""]
    if quick:
        lines += ["Made with `--quick`: a look, not a measurement.", ""]
    lines += [table(("", ""), machine.description())]
    lines += [
        table(
            ("part", "what", "outcome", "seconds"),
            ((o.part, o.text, "passed" if o.status == 0 else "FAILED", f"{o.seconds:.0f}") for o in outcomes),
        )
    ]
    for outcome in outcomes:
        page = output / f"{outcome.part}.md"
        lines += [f"## {outcome.part}", ""]
        lines += [page.read_text() if page.is_file() else f"Numbers: `{outcome.part}.json`.", ""]
    path = output / "report.md"
    path.write_text("\n".join(lines))
    return path


def gather(output: Path, outcomes: Sequence[Outcome], path: Path) -> None:
    """One JSON file with the numbers of all parts."""
    parts = {o.part: output / f"{o.part}.json" for o in outcomes}
    found = {name: json.loads(file.read_text()) for name, file in parts.items() if file.is_file()}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
