"""The table a comparison returns: for a terminal, Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import asdict, dataclass

from hqp.markdown import table


@dataclass(frozen=True)
class Line:
    """Result of one solver over all states.

    residuals: largest ||w_k|| of each level.  gap: largest certificate gap.  difference: largest entry of the
    command's difference to the first certified strict solver.  Times of the solve call [us].
    """

    solver: str
    strict: bool
    status: str
    residuals: tuple[float, ...]
    ranks: tuple[int, ...]
    gap: float
    certified: float
    difference: float
    median_us: float
    p99_us: float
    max_us: float
    cpu_us: float
    misses: int
    note: str = ""


@dataclass(frozen=True)
class Comparison:
    """The table that ``compare`` returns; ``str()`` for a terminal."""

    stack: str
    robot: str
    levels: tuple[str, ...]
    states: int
    solves: int
    reference: str
    lines: tuple[Line, ...]

    def __getitem__(self, solver: str) -> Line:
        """The line of a solver; raises KeyError naming those that ran."""
        for line in self.lines:
            if line.solver == solver:
                return line
        raise KeyError(f"no solver {solver!r}; there are {', '.join(line.solver for line in self.lines)}")

    def header(self) -> tuple[str, ...]:
        """Titles of the columns."""
        residuals = tuple(f"|w| {name}" for name in self.levels)
        return (
            "solver", "status", *residuals, "rank", "gap", "certified", "|dx|",
            "median us", "p99", "max", "cpu", "over 2 ms", "note",
        )  # fmt: skip

    def cells(self) -> tuple[tuple[str, ...], ...]:
        """The table's body as text."""
        return tuple(
            (
                line.solver if line.strict else f"{line.solver} *", line.status,
                *(f"{r:.1e}" for r in line.residuals or (float("nan"),) * len(self.levels)),
                "+".join(map(str, line.ranks)),
                f"{line.gap:.0e}", f"{100.0 * line.certified:.0f} %", f"{line.difference:.0e}",
                f"{line.median_us:.0f}", f"{line.p99_us:.0f}", f"{line.max_us:.0f}", f"{line.cpu_us:.0f}",
                f"{line.misses}/{self.solves}", line.note,
            )
            for line in self.lines
        )  # fmt: skip

    @property
    def title(self) -> str:
        """Stack, robot and conditions of the comparison."""
        return f"{self.stack}   on {self.robot}, {self.states} states"

    @property
    def caption(self) -> str:
        """Explanation of the table."""
        return f"* not strict; |dx| against {self.reference or 'none'}; times of the solve call against 2 ms (500 Hz)"

    def markdown(self) -> str:
        """The table in Markdown."""
        return f"{self.title}\n\n{table(self.header(), self.cells())}\n\n{self.caption}\n"

    def csv(self) -> str:
        """One line a solver, numbers in full."""
        out = io.StringIO()
        writer = csv.writer(out)
        names = [key for key in asdict(self.lines[0]) if key not in ("residuals", "ranks")] if self.lines else []
        writer.writerow([*names, *(f"residual_{name}" for name in self.levels), "ranks"])
        for line in self.lines:
            entry = asdict(line)
            writer.writerow([*(entry[n] for n in names), *line.residuals, "+".join(map(str, line.ranks))])
        return out.getvalue()

    def json(self) -> str:
        """Everything, numbers in full."""
        return json.dumps(asdict(self), indent=2)

    def __str__(self) -> str:
        from rich.console import Console
        from rich.table import Table

        table = Table(title=self.title, caption=self.caption, title_justify="left", caption_justify="left")
        for name in self.header():
            table.add_column(name, justify="left" if name in ("solver", "status", "note") else "right", no_wrap=True)
        for cells in self.cells():
            table.add_row(*cells)
        console = Console(width=260, file=io.StringIO(), force_terminal=False)
        console.print(table)
        return "\n".join(text.rstrip() for text in console.file.getvalue().splitlines())  # type: ignore[attr-defined]

    def _repr_markdown_(self) -> str:
        return self.markdown()
