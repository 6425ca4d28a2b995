"""Where Dreamer's controller holds and where it does not: one change at a time, some with several seeds, and limits.

Every cell is ``pass``, ``FAIL`` (a limit was promised and missed) or, where nothing was promised, what came out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from benchmarks.lab.outcome import Figure, Outcome, Table, holds, number, table
from benchmarks.lab.setting import Setting
from benchmarks.sentis2012.experiments.cases import carry_out, seeded
from benchmarks.sentis2012.experiments.cells import NOISY, ONE_CM, Cell, cells
from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.measures import Measures
from benchmarks.sentis2012.experiments.pairs import Pair, pairs
from benchmarks.sentis2012.experiments.step_bound import steps
from benchmarks.sentis2012.experiments.variants import PULL


def experiment(setting: Setting) -> Outcome:
    """The table, and the projector against the HQP with limits."""
    outcome = Outcome("dreamer-robustness")
    outcome.parameters = {"human's way": PULL, "gains": Compliance(), "noise": NOISY, "seeds": setting.seeds}
    listed = cells(setting.full)
    cases = [c for cell in listed for c in (seeded(cell.case, setting.seeds) if cell.seeds else [cell.case])]
    both = pairs(setting.full)
    cases += [case for pair in both for case in (pair.projector, pair.bounded)]
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
    outcome.tables.append(_pairs(both, measures))
    if setting.full:
        outcome.tables.append(steps())
    slippery = both[0]
    outcome.figures += [
        holds(f"{slippery.text}: HQP with friction bounds stands", math.isnan(measures[slippery.bounded.name].fell)),
        Figure(f"{slippery.text}: CoM error, HQP", measures[slippery.bounded.name].com, "mm", high=ONE_CM),
        holds(
            f"{slippery.text}: projector keeps the CoM within 1 cm",
            measures[slippery.projector.name].com <= ONE_CM,
            wanted=False,
        ),
    ]
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


def _pairs(both: Sequence[Pair], measures: Mapping[str, Measures]) -> Table:
    def say(m: Measures) -> str:
        outcome = f"falls at {m.fell:.1f} s" if math.isfinite(m.fell) else f"CoM {number(m.com)} mm"
        slip = "" if math.isnan(m.slip) else f", slip {number(m.slip)} m/s"
        return f"{outcome}, unloaded {1e3 * m.unloaded:.0f} ms{slip}"

    rows = [(pair.text, say(measures[pair.projector.name]), say(measures[pair.bounded.name])) for pair in both]
    header = ("scene", "projector, CoM task capped at 2.5 m/s^2", "HQP: torque limits, friction cones, no cap")
    return table("What inequalities buy", header, rows)
