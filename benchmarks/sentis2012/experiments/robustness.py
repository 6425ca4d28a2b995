"""A single run of every cell, without the variations of ``statistics``: successes and failures of the controller."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

from benchmarks.lab.outcome import Figure, Outcome, holds
from benchmarks.lab.setting import Setting
from benchmarks.sentis2012.experiments import statistics
from benchmarks.sentis2012.experiments.cases import carry_out
from benchmarks.sentis2012.experiments.cells import NOISY, cells
from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.variants import PULL

QUICK = ("slope, 5 deg, ball wheels", "friction, 0.25, rollers")
"""The short version."""


def experiment(setting: Setting) -> Outcome:
    """The table, and a figure of every cell that has a limit."""
    outcome = Outcome("dreamer-robustness")
    outcome.parameters = {"human's way": PULL, "gains": Compliance(), "noise": NOISY}
    listed = [cell for cell in cells() if setting.full or cell.case.name in QUICK]
    measures = carry_out([cell.case for cell in listed], setting.solver, setting.jobs, setting.advance)
    for cell in listed:
        name, error = cell.case.name, measures[cell.case.name].com
        if cell.limit == math.inf:
            outcome.figures.append(holds(f"{name}: no fall", math.isfinite(error)))
        elif cell.limit is not None:
            outcome.figures.append(Figure(f"{name}: CoM error", error, "mm", high=cell.limit))
    lines = [statistics.summary(name, [asdict(run)]) for name, run in measures.items()]
    outcome.tables.append(replace(statistics.shown(lines, ("worst",)), title="Single runs"))
    return outcome
