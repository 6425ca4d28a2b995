"""Runs of Dreamer by name, side by side on several processes."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field

from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.dreamer_run import Outing
from benchmarks.sentis2012.experiments.measures import Measures, measure
from benchmarks.sentis2012.experiments.scene import Scene
from hqp.solvers.base import Solver


@dataclass(frozen=True, kw_only=True)
class Case:
    """A run, and the start of its measurement [s]; ``solver`` None takes the experiment's."""

    name: str
    scene: Scene = field(default_factory=Scene)
    choice: Compliance = field(default_factory=Compliance)
    since: float = 0.5
    solver: str | None = None


def carry_out(
    cases: Sequence[Case], solver: str | Solver, jobs: int, done: Callable[[], None]
) -> Mapping[str, Measures]:
    """Measures by name of case; ``done`` is called after each.  The result does not depend on ``jobs``."""
    results: dict[str, Measures] = {}
    if jobs <= 1 or len(cases) == 1:
        for case in cases:
            results[case.name] = _one(case, solver)
            done()
        return results
    # one BLAS thread a process: the matrices are too small for more to pay
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with ProcessPoolExecutor(jobs) as pool:
        waiting = [(case.name, pool.submit(_one, case, solver)) for case in cases]
        for name, future in waiting:
            results[name] = future.result()
            done()
    return results


def _one(case: Case, solver: str | Solver) -> Measures:
    return measure(Outing(case.scene, case.choice, case.solver or solver, residuals=False).run(), case.since)
