"""Results of a bench: a table for the terminal, Markdown, JSON, Parquet and one page of HTML."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqp.errors import DeclarationError, HqpError
from hqp.markdown import table as markdown_table

from .measures import MOST_DRIFT, MOST_REVERSALS, Summary
from .run import Run

_HEADER = (
    "solver", "status", "p50 us", "p95", "p99", "max", "x floor", "missed", "longest", "certified", "gap",
    "jump", "rate p50", "rate p99", "reversals/s", "off mm", "drift mm", "over limit",
)  # fmt: skip


MISS = " !"
"""Follows a cell whose figure misses its goal."""

BEHAVIOUR = _HEADER.index("certified")
"""The first column of the first table on behaviour instead of time."""


@dataclass(frozen=True)
class Change:
    """A solver's p50, as ratio to its run's floor, now and before; verdict: faster, slower or no change."""

    solver: str
    ratio: float
    noise: float
    verdict: str


@dataclass(frozen=True)
class Bench:
    """Summaries by solver, every tick behind them, and their conditions; ``str()`` for a terminal."""

    manifest: dict[str, Any]
    lines: tuple[Summary, ...]
    runs: tuple[Run, ...] = ()

    def __getitem__(self, solver: str) -> Summary:
        """The summary of a solver; raises KeyError naming those that ran."""
        for line in self.lines:
            if line.solver == solver:
                return line
        raise KeyError(f"no solver {solver!r}; there are {', '.join(line.solver for line in self.lines)}")

    @property
    def levels(self) -> tuple[str, ...]:
        """Names of the levels of all hierarchies, in their order: a solver without prices may have fewer levels."""
        found: list[str] = []
        for line in self.lines:
            at = 0
            for name in line.residual_max:
                if name not in found:
                    found.insert(at, name)
                at = found.index(name) + 1
        return tuple(found)

    @property
    def title(self) -> str:
        """Stack, robot and conditions of the run."""
        m = self.manifest
        return (
            f"{m['stack']}\non {m['robot']}, {m['formulation']}, {m['trajectory']}, {m['plant']}, "
            f"{m['ticks']} ticks of {1e3 * m['dt']:g} ms"
        )

    @property
    def caption(self) -> str:
        """Explanation of the table."""
        unit = {"Velocity": "rad/s", "Acceleration": "rad/s^2", "Torque": "N m"}[self.manifest["formulation"]]
        return (
            "* not strict; x floor: median tick over a bare kinematics call of the same run; missed: ticks over the "
            f"period, longest run of them; jump: largest change of a command in a tick [{unit}]; rate: of that change "
            f"[{unit} a second]; off: largest distance from a reference at the end; drift: of a contact; over limit: "
            "of a joint's range [rad]; ‖w‖: residual of a level; !: a goal that is missed (every tick solved, in its "
            f"period and certified, at most {MOST_REVERSALS:g} reversals a second, contacts within "
            f"{1e3 * MOST_DRIFT:g} mm, joints inside their range)"
        )

    def header(self) -> tuple[str, ...]:
        """Titles of the columns of the first table."""
        return _HEADER

    def cells(self) -> tuple[tuple[str, ...], ...]:
        """The first table's body as text: times and calm, `` !`` behind missed goals."""
        rows: list[tuple[str, ...]] = []
        for s in self.lines:
            name = s.solver if s.strict else f"{s.solver} *"
            if not s.ticks:
                rows.append((name, "refused", *("",) * (len(_HEADER) - 2)))
                continue
            missed = s.missed(1e6 * self.manifest["dt"])
            cells = (
                name, s.status, *(f"{t:.0f}" for t in (s.p50_us, s.p95_us, s.p99_us, s.max_us)), f"{s.ratio:.1f}",
                f"{s.misses}", f"{s.longest_misses}", f"{100.0 * s.certified:.0f} %", f"{s.gap:.0e}",
                f"{s.jump:.3g}", f"{s.rate_p50:.3g}", f"{s.rate_p99:.3g}", f"{s.reversals:.0f}",
                f"{1e3 * max(s.off.values(), default=np.nan):.2g}", f"{1e3 * s.drift:.2g}", f"{s.over:.1g}",
            )  # fmt: skip
            rows.append(tuple(c + MISS * (title in missed) for title, c in zip(_HEADER, cells, strict=True)))
        return tuple(rows)

    def residual_header(self) -> tuple[str, ...]:
        """Titles of the columns of the second table."""
        return ("largest ‖w‖", *self.levels)

    def residual_cells(self) -> tuple[tuple[str, ...], ...]:
        """The second table's body as text: the largest residual of each level."""
        ran = [line for line in self.lines if line.ticks]
        return tuple(
            (s.solver, *(f"{s.residual_max[name]:.1e}" if name in s.residual_max else "" for name in self.levels))
            for s in ran
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Why solvers refused the stack."""
        return tuple(f"{line.solver}: {line.note}" for line in self.lines if line.note)

    def markdown(self) -> str:
        """The tables in Markdown."""
        both = ((self.header(), self.cells()), (self.residual_header(), self.residual_cells()))
        tables = "\n\n".join(markdown_table(header, body) for header, body in both)
        title = self.title.replace("\n", "  \n").replace("|", "\\|")
        notes = "".join(f"- {note}\n" for note in self.notes)
        return f"{title}\n\n{tables}\n\n{self.caption}\n\n{notes}\n{_about(self.manifest)}\n"

    def json(self) -> str:
        """Summaries and manifest, numbers in full; ``against`` reads it back."""
        return json.dumps({"manifest": self.manifest, "lines": [asdict(line) for line in self.lines]}, indent=2)

    def parquet(self, path: str | Path) -> Path:
        """Every tick of every solver, the manifest as metadata ``hqp``; raises HqpError without pyarrow."""
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError as error:
            raise HqpError("Parquet needs pyarrow: pip install 'hqp[lab]'") from error
        parts = [_table(pyarrow, run) for run in self.runs]
        table = pyarrow.concat_tables(parts, promote_options="default") if parts else pyarrow.table({})
        about = {**(table.schema.metadata or {}), b"hqp": json.dumps(self.manifest).encode()}
        pyarrow.parquet.write_table(table.replace_schema_metadata(about), path)
        return Path(path)

    def html(self, path: str | Path, changes: tuple[Change, ...] = ()) -> Path:
        """One page with plots that needs no network; raises HqpError without plotly."""
        from .page import render

        Path(path).write_text(render(self, changes), encoding="utf-8")
        return Path(path)

    def against(self, old: str | Path) -> tuple[Change, ...]:
        """Median ticks now over those of an older JSON, both in floors of their own run, with a verdict beyond noise.

        Noise: both runs' spreads added, at least 3 %.  Raises DeclarationError for a file of another kind, stack,
        robot, formulation, trajectory or plant.
        """
        try:
            before = json.loads(Path(old).read_text())
            lines = {line["solver"]: line for line in before["lines"]}
            settings = before["manifest"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DeclarationError("against", f"not a bench's JSON: {error}", value=str(old)) from error
        for key in ("stack", "robot", "formulation", "trajectory", "plant", "dt"):
            if settings.get(key) != self.manifest[key]:
                raise DeclarationError("against", f"another {key}", value=settings.get(key), allowed=self.manifest[key])
        changes = []
        for line in self.lines:
            if line.solver not in lines or not line.ticks or not lines[line.solver]["ticks"]:
                continue
            was = lines[line.solver]
            ratio = line.ratio / was["ratio"]
            noise = max(0.03, line.noise + was["noise"])
            verdict = "no change" if abs(ratio - 1.0) <= noise else "slower" if ratio > 1.0 else "faster"
            changes.append(Change(line.solver, ratio, noise, verdict))
        return tuple(changes)

    def __str__(self) -> str:
        both = ((self.header(), self.cells()), (self.residual_header(), self.residual_cells()))
        return as_text(self.title, both, (self.caption, *self.notes))


LEFT = ("solver", "status", "library", "scene", "said")
"""Columns of words."""


def as_text(
    title: str, tables: Sequence[tuple[Sequence[str], Sequence[Sequence[str]]]], notes: Sequence[str], width: int = 200
) -> str:
    """Tables for a terminal under a title, with notes below."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    out = io.StringIO()
    console = Console(width=width, file=out, force_terminal=False)
    if title:
        console.print(escape(title), soft_wrap=True)
    for header, body in tables:
        shown = Table()
        for name in header:
            shown.add_column(name, justify="left" if name in LEFT else "right", no_wrap=True)
        for cells in body:
            shown.add_row(*map(escape, cells))
        console.print(shown)
    for text in notes:
        console.print(escape(text), soft_wrap=True)
    return "\n".join(text.rstrip() for text in out.getvalue().splitlines())


def _about(manifest: dict[str, Any]) -> str:
    machine = manifest["machine"]
    packages = ", ".join(f"{name} {version}" for name, version in manifest["packages"].items())
    return (
        f"{machine['processor']}, {machine['cores']} cores, {machine['system']}; Python {manifest['python']}, "
        f"hqp {manifest['hqp']} {manifest['commit'][:10]}; {packages}; {manifest['made']}"
    )


def _table(pyarrow: Any, run: Run) -> Any:
    k = run.total.size
    columns: dict[str, Any] = {
        "solver": [run.solver] * k,
        "tick": np.arange(k),
        "t": run.dt * np.arange(k),
        "status": list(run.statuses),
        "total_us": run.total,
        "floor_us": run.floor,
    }
    for i, name in enumerate(("state", "assemble", "solve", "command")):
        columns[f"{name}_us"] = run.times[:, i]
    for i, name in enumerate(run.levels):
        columns[f"residual {name}"] = run.residuals[:, i]
    columns["command"] = list(run.commands)
    return pyarrow.table(columns)
