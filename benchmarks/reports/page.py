"""Terminal page of the main job: a bar, a line or two as a part ends, then failures, figures and the report."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks.reports.report import Outcome

GLANCE_TICKS = 500
"""Ticks of the first figure on the page."""


class Page:
    """A terminal page; a context manager."""

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
    def part(self, name: str) -> Iterator[None]:
        """A part runs inside; several may at once."""
        task = self._bar.add_task(f"  {name}", total=None)
        try:
            yield
        finally:
            self._bar.remove_task(task)
            self._bar.advance(self._whole)

    def show(self, outcome: Outcome) -> None:
        """Show the outcome of a part."""
        color = "bold red" if outcome.status else "yellow" if outcome.missed else "green"
        mark = f"[{color}]{outcome.verdict:9}[/]"
        head, *lines = outcome.lines or (outcome.text,)
        self._console.print(f"[bold]{outcome.part:12}[/]{mark}{outcome.seconds:5.0f} s  {escape(head)}", soft_wrap=True)
        for line in lines:
            self._console.print(f"{'':27}{escape(line)}", soft_wrap=True)

    def finish(self, outcomes: Sequence[Outcome], figures: Sequence[Path], path: Path, seconds: float) -> None:
        """List every failure in full, the paths of figures, and the report."""
        say = self._console.print
        failures = [(o.part, text) for o in outcomes for text in o.failures]
        if failures:
            say(f"\n[bold red]{len(failures)} failed[/]")
            for part, text in failures:
                say(f"  [red]{part}[/]: {escape(text)}", soft_wrap=True)
        if figures:
            names = "  ".join(figure.name for figure in sorted(figures))
            say(f"\nfigures in {_short(figures[0].parent)}: {escape(names)}")
        good, missed = sum(o.verdict == "passed" for o in outcomes), sum(o.missed for o in outcomes)
        told = f", {missed} goals missed" if missed else ""
        say(f"\n[bold]{good} of {len(outcomes)} parts passed[/]{told} in {seconds:.0f} s; every row: {_short(path)}")


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
