"""What the main job shows: a bar, a line or two a part as it ends, then failures in full, figures and the report."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from benchmarks.reports import report
from benchmarks.reports.report import Outcome

GLANCE_TICKS = 500
"""Ticks of the first figure on the page."""


class Page:
    """A terminal page; what a part prints by itself goes into its log.  A context manager."""

    def __init__(self, parts: int) -> None:
        self._console = Console(highlight=False)
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"), TimeElapsedColumn(),
            console=self._console, transient=True,
        )  # fmt: skip
        self._whole = self._bar.add_task("[bold]all parts", total=parts)

    def __enter__(self) -> Page:
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.stop()

    def say(self, text: str) -> None:
        """A line above the bar."""
        self._console.print(escape(text), soft_wrap=True)

    @contextmanager
    def part(self, name: str, log: Path) -> Iterator[None]:
        """Run a part inside: its output goes into the log, its bars under the page's own."""
        console, bar = report.console, report.bar
        with log.open("w", encoding="utf-8") as file:
            report.console = Console(file=file, highlight=False, width=240)
            report.bar = lambda: _Nested(self._bar, name)  # type: ignore[assignment,return-value]
            try:
                yield
            finally:
                report.console, report.bar = console, bar
        self._bar.advance(self._whole)

    def show(self, outcome: Outcome) -> None:
        """What came of a part."""
        failed = bool(outcome.status)
        mark = "[bold red]FAILED[/]" if failed else "[green]passed[/]"
        head, *lines = outcome.lines or (outcome.text,)
        self._console.print(f"[bold]{outcome.part:12}[/]{mark}{outcome.seconds:5.0f} s  {escape(head)}", soft_wrap=True)
        for line in lines:
            self._console.print(f"{'':27}{escape(line)}", soft_wrap=True)

    def finish(self, outcomes: Sequence[Outcome], path: Path, seconds: float) -> None:
        """Every failure in full, where the figures are, and the report."""
        say = self._console.print
        failures = [(o.part, text) for o in outcomes for text in o.failures]
        if failures:
            say(f"\n[bold red]{len(failures)} failed[/]")
            for part, text in failures:
                say(f"  [red]{part}[/]: {escape(text)}", soft_wrap=True)
        figures = [Path(f) for o in outcomes for f in o.figures]
        if figures:
            names = "  ".join(figure.name for figure in figures)
            say(f"\nfigures in {_short(figures[0].parent)}: {escape(names)}")
        good = sum(not o.status for o in outcomes)
        say(f"\n[bold]{good} of {len(outcomes)} parts passed[/] in {seconds:.0f} s; every row: {_short(path)}")


class _Nested:
    """Tasks of a part inside the page's bar, taken away when the part's bar would close."""

    def __init__(self, bar: Progress, part: str) -> None:
        self._bar, self._part = bar, part
        self._tasks: list[TaskID] = []

    def __enter__(self) -> _Nested:
        return self

    def __exit__(self, *error: object) -> None:
        for task in self._tasks:
            self.remove_task(task)

    def add_task(self, description: str, total: float | None = 100.0) -> TaskID:
        task = self._bar.add_task(f"  {description}", total=total)
        self._tasks.append(task)
        return task

    def update(self, task: TaskID, *, description: str | None = None, **given: Any) -> None:
        if description is not None:
            given["description"] = f"  {description}"
        self._bar.update(task, **given)

    def advance(self, task: TaskID, advance: float = 1.0) -> None:
        self._bar.advance(task, advance)

    def remove_task(self, task: TaskID) -> None:
        if task in self._bar.task_ids:
            self._bar.remove_task(task)

    def track(self, sequence: Sequence[Any], description: str = "") -> Iterator[Any]:
        task = self.add_task(description, total=len(sequence))
        for item in sequence:
            yield item
            self.advance(task)


def glance() -> str:
    """The first figure, a few seconds after the start: the five-level stack on Talos with joint limits."""
    import numpy as np

    from benchmarks.speed import ticks
    from hqp import native, robots, solvers

    run = ticks.paper(robots.load("talos"), "lexicographic", solvers.load("lexicographic"), GLANCE_TICKS)
    return (
        f"five strict levels with joint limits on Talos, {native.describe()}: {run.median:.0f} us a tick at "
        f"the median, p99 {np.percentile(run.wall, 99.0):.0f} us, {run.misses} of {GLANCE_TICKS} over 2 ms, "
        f"certificate gap {run.gap:.0e}"
    )


def _short(path: Path) -> str:
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative
