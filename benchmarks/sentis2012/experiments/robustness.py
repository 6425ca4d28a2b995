"""Where Dreamer's controller holds and where it does not: one change at a time, some with several seeds.

Every cell is ``pass``, ``FAIL`` (a limit was promised and missed) or, where nothing was promised, what came out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from benchmarks.lab.outcome import Figure, Outcome, holds, number, table
from benchmarks.lab.setting import Setting
from benchmarks.sentis2012.experiments.cases import carry_out, seeded
from benchmarks.sentis2012.experiments.cells import NOISY, ONE_CM, Cell, cells
from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.measures import Measures
from benchmarks.sentis2012.experiments.variants import PULL


def experiment(setting: Setting) -> Outcome:
    """The table."""
    outcome = Outcome("dreamer-robustness")
    outcome.parameters = {"human's way": PULL, "gains": Compliance(), "noise": NOISY, "seeds": setting.seeds}
    listed = cells(setting.full)
    cases = [c for cell in listed for c in (seeded(cell.case, setting.seeds) if cell.seeds else [cell.case])]
    measures = carry_out(cases, setting.solver, setting.jobs, setting.advance)
    rows = []
    for cell in listed:
        names = [c.name for c in seeded(cell.case, setting.seeds)] if cell.seeds else [cell.case.name]
        runs = [measures[name] for name in names]
        rows.append(_row(cell, runs))
        if cell.limit is not None:
            outcome.figures.append(_figure(cell, runs))
    header = ("cell", "verdict", "asked [mm]", "CoM up / back [mm]", "within 1 cm", "least load [N]", "earlier [mm]")
    outcome.tables.append(table("Robustness", header, rows))
    return outcome


def _worst(runs: Sequence[Measures]) -> float:
    return max(run.com for run in runs)


def _figure(cell: Cell, runs: Sequence[Measures]) -> Figure:
    if cell.limit == math.inf:
        return holds(f"{cell.case.name}: no fall", math.isfinite(_worst(runs)), before=cell.earlier)
    seeds = f" (worst of {len(runs)})" if len(runs) > 1 else ""
    return Figure(
        f"{cell.case.name}: CoM error{seeds}", _worst(runs), "mm", high=cell.limit or 0.0, before=cell.earlier
    )


def _row(cell: Cell, runs: Sequence[Measures]) -> tuple[str, ...]:
    falls = sum(math.isfinite(run.fell) for run in runs)
    if cell.limit is None:
        verdict, asked = "outside", "nothing"
    else:
        verdict = "pass" if _worst(runs) <= cell.limit and not falls else "FAIL"
        asked = "no fall" if cell.limit == math.inf else f"{cell.limit:g}"
    if falls:
        times = ", ".join(f"{run.fell:.1f} s" for run in runs if math.isfinite(run.fell))
        shown = f"falls at {times}" + (f" ({falls} of {len(runs)})" if len(runs) > 1 else "")
    else:
        shown = f"{_spread([r.com_up for r in runs])} / {_spread([r.com_back for r in runs])}"
    within = "yes" if _worst(runs) <= ONE_CM else "no"
    return cell.case.name, verdict, asked, shown, within, _spread([r.load_least for r in runs]), cell.earlier


def _spread(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return number(low) if len(values) == 1 else f"{number(low)} to {number(high)}"
