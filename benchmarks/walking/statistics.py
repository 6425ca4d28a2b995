"""Statistics of walks over seeds by cell: falls, speed, changes of torques, ticks, errors of the estimator."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lab.distribution import fall_rate_bound, percentiles
from benchmarks.lab.outcome import Figure, Outcome, Table, table
from benchmarks.lab.setting import Setting
from benchmarks.walking import robots
from benchmarks.walking.cells import cells, one_run

RUNS = 20
"""Default number of runs of a cell."""

ASKED = ("talos, 0.3 m/s", "g1, 0.2 m/s", "cbi, 0.15 m/s")


def command(arguments: Any) -> int:
    """Make missing runs and show the table; return 1 if falls exceed a cell's limit, 2 for an unknown cell.

    ``--cells robots`` selects the table of bipeds, by default with four runs each.
    """
    if arguments.cells == ["robots"]:
        cases = [{"robot": n, "seed": k} for k in _seeds(arguments, robots.RUNS) for n in robots.bipeds()]
        _show(arguments, robots.found(_runs(arguments, f"{robots.__name__}:one_robot", cases, "robots")), robots.lines)
        return 0
    known = cells()
    names = tuple(known) if arguments.cells == ["all"] else tuple(n for n in arguments.cells if n in known) or ASKED
    if unknown := [n for n in arguments.cells if n not in known and n not in ("all", "nominal", "nominal-imu")]:
        there = "; ".join(("all", "robots", *known))
        print(f"benchmarks experiments: no cell {', '.join(unknown)}; there are {there}", file=sys.stderr)
        return 2
    cases = [{"cell": n, "seed": k} for k in _seeds(arguments, RUNS) for n in names]
    rows = _runs(arguments, f"{__name__}:run", cases, "walking")
    found = [summary(n, own) for n in names if (own := [row for row in rows if row["cell"] == n])]
    _show(arguments, found, lines)
    return int(any(line["asked"] is not None and line["falls"] > line["asked"] for line in found))


def _seeds(arguments: Any, usual: int) -> range:
    return range(arguments.seed, arguments.seed + (arguments.runs or usual))


def _runs(arguments: Any, function: str, cases: Sequence[Mapping[str, Any]], folder: str) -> list[dict[str, Any]]:
    """Make the missing cases and read all; arguments and figures by name."""
    from benchmarks.lab import sweeps
    from hqp import sweep

    kept = arguments.kept or Path(arguments.output) / folder
    wanted = sweep.Sweep(function, list(cases), arguments.code)
    return [sweeps.plain(row) for row in sweeps.rows(wanted, kept, jobs=arguments.jobs, only_read=arguments.show)]


def _show(arguments: Any, found: Any, shown: Callable[[Any], Table]) -> None:
    """Print the table, write its data into a file."""
    from benchmarks.lab import sweeps

    sweeps.show([shown(found)], found, arguments.json)


def run(cell: str, seed: int) -> dict[str, Any]:
    """One run, a case of a sweep."""
    return one_run(cell, seed)


def summary(cell: str, rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Row of a cell: falls, and percentiles over the runs without a fall."""
    stood = [row for row in rows if not math.isfinite(row["fell"])]
    declared = cells()[cell]
    spread = {
        key: percentiles(np.array([row[key] for row in stood])) if stood else {}
        for key in ("jump_switch", "jump_else", "reversals", "off_mm", "off_deg")
    }
    per_second = 1.0 / declared.seconds if declared.seconds else 0.0
    asked = None if declared.falls is None else math.ceil(declared.falls * len(rows) / 20.0)
    return {
        "cell": cell,
        "runs": len(rows),
        "falls": len(rows) - len(stood),
        "asked": asked,
        "walked": per_second * float(np.median([row["walked"] for row in stood])) if stood else math.nan,
        "optimal": float(np.median([row["optimal"] for row in rows])),
        "in_time": float(np.median([row["in_time"] for row in rows])),
        **spread,
    }


def lines(found: Sequence[Mapping[str, Any]]) -> Table:
    """Rows of the table."""

    def there(figure: float | None) -> bool:  # a standing robot has no switch of feet; files have null for NaN
        return figure is not None and math.isfinite(figure)

    def two(figures: Mapping[str, float]) -> str:
        return f"{figures['median']:.0f} / {figures['worst']:.0f}" if figures and there(figures["worst"]) else ""

    rows = [
        (
            line["cell"],
            f"{line['falls']} of {line['runs']}",
            f"{100.0 * fall_rate_bound(line['falls'], line['runs']):.0f} %",
            f"{line['walked']:.2f}" if there(line["walked"]) else "",
            two(line["jump_switch"]),
            two(line["jump_else"]),
            two(line["reversals"]),
            f"{100.0 * line['optimal']:.2f} %",
            f"{100.0 * line['in_time']:.1f} %",
            two(line["off_mm"]),
        )
        for line in found
    ]
    header = (
        "cell", "falls", "rate below (95 %)", "walked [m/s]", "torque at a switch [N m a tick]", "else",
        "reversals [1/s]", "OPTIMAL", "ticks within 1.6 ms", "estimate off [mm]",
    )  # fmt: skip
    return table("Walks: median / worst of the runs that did not fall", header, rows)


def experiment(setting: Setting) -> Outcome:
    """One run of each walk with a limit of falls, five in full."""
    runs = 5 if setting.full else 1
    outcome = Outcome("walking")
    outcome.parameters = {"runs": runs, "masses": "+-10 %", "encoders [rad]": 0.005, "delay [s]": 0.004, "mu": 0.5}
    found = []
    for name in ASKED:
        line = summary(name, [one_run(name, seed) for seed in range(runs)])
        setting.advance()
        outcome.figures.append(Figure(f"{name}: falls of {runs}", line["falls"], high=0.0))
        found.append(line)
    outcome.tables.append(lines(found))
    return outcome
