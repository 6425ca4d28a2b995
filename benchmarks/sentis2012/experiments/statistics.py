"""Distributions of Dreamer's figures: each cell many times, with small variations.

Runs differ in the start of the human's walk (up to 0.5 s), in friction (2 percent) and in the sensors' noise (a tenth
of the table's noisy cells, for cells without noise).  A fall counts as an infinite error.  A promise holds if no run
fell and the 99th percentile, rounded up to an existing run, is within it.  The cells in PROMISED have many runs; other
cells compare a few runs with a limit, which is an observation.

Every run is a case of ``hqp.sweep``: the table takes hours, can be stopped at any time and resumed.
"""

from __future__ import annotations

import math
import sys
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lab.distribution import fall_rate_bound, percentiles
from benchmarks.lab.outcome import Figure, Outcome, Table, number, table
from benchmarks.lab.setting import Setting
from benchmarks.sentis2012.experiments.cases import Case, carry_out
from benchmarks.sentis2012.experiments.cells import Cell, cells
from benchmarks.sentis2012.experiments.dreamer_run import Outing
from benchmarks.sentis2012.experiments.measures import measure
from benchmarks.sentis2012.experiments.promised import compared
from benchmarks.sentis2012.experiments.scene import Scene
from benchmarks.sentis2012.experiments.variants import FELT, IMU_ONLY, IMU_WALK, MAPPED, PULL
from hqp.robots.on_mujoco import Noise, Sensors

TRIFLES = Sensors(
    orientation=Noise(1e-4), gyro=Noise(1e-3), angle=Noise(1e-5), rate=Noise(1e-3), force=Noise(0.3)
)  # fmt: skip
"""Noise of runs of cells without noise."""

LATER, SLIPPERIER = 0.5, 0.02
"""Largest delay of the human's walk [s], and largest relative deviation of friction."""

MANY, FEW = 300, 30
"""Runs of a cell with a promise, and of another cell."""

PROMISED = (
    "nominal-imu",
    "nominal-felt",
    "nominal-tilt",
    "nominal",
    "heading, 45 deg, rollers, own map",
    "noise, all sensors, 4 ms, rollers, own map",
    "step pull, 60 N aside, flat, with limits, tilt alone, rollers",
    "payload, 1 kg, unknown, observed, rollers, ground felt",
)
"""Cells whose limit is a promise, with enough runs for a rate.  Other cells compare a few runs with their limit."""

ABOUT = {
    "nominal": "7 degrees on rollers, contact normals from the simulator: privileged",
    "nominal-imu": "the same by IMU, encoders and wheel odometry alone: normals from the robot's own map",
    "nominal-felt": "the same by IMU, encoders, odometry and motor torques: the ground's push, no map",
    "nominal-tilt": "the same by the IMU's tilt alone, the human carries a share of the weight",
}


@cache
def registry() -> Mapping[str, Cell]:
    """Every cell by name: the nominal ones, then the table of robustness."""
    rollers = Scene(plant="dreamer_rollers", walk=PULL)
    nominal = {
        "nominal": Cell(case=Case(name="nominal", scene=rollers), group="nominal", limit=6.0),
        "nominal-imu": Cell(case=Case(name="nominal-imu", scene=rollers, choice=MAPPED), group="nominal", limit=10.0),
        "nominal-felt": Cell(case=Case(name="nominal-felt", scene=rollers, choice=FELT), group="nominal", limit=10.0),
        "nominal-tilt": Cell(
            case=Case(name="nominal-tilt", scene=replace(rollers, walk=IMU_WALK), choice=IMU_ONLY),
            group="nominal",
            limit=10.0,
        ),
    }
    return {**nominal, **{cell.case.name: cell for cell in cells()}}


def varied(case: Case, run: int, seed: int) -> Case:
    """The case with the small variations of one run."""
    rng = np.random.default_rng([seed, zlib.crc32(case.name.encode()), run])
    scene = case.scene
    return replace(
        case,
        scene=replace(
            scene,
            walk=replace(scene.walk, start=scene.walk.start + LATER * rng.uniform()),
            friction=scene.friction * (1.0 + SLIPPERIER * rng.uniform(-1.0, 1.0)),
            sensors=TRIFLES if scene.sensors == Sensors() else scene.sensors,
            seed=int(rng.integers(2**31)),
        ),
    )


def one_run(cell: str, run: int, seed: int, solver: str = "lexicographic") -> dict[str, Any]:
    """Measures of one run, a case of a sweep."""
    case = varied(registry()[cell].case, run, seed)
    outing = Outing(case.scene, case.choice, case.solver or solver, residuals=False).run()
    return {**asdict(measure(outing, case.since)), "ignored_normals": outing.ignored_normals}


def summary(cell: str, rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Row of a cell: percentiles over its runs, falls, promised limit or None, and ``passed``: true if the limit holds.

    ``passed`` also judges the limit of a cell without a promise.
    """
    fell = np.array([math.isfinite(row["fell"]) for row in rows])
    figures = {}
    for name, key, scale in (
        ("com_up_mm", "com_up", 1.0),
        ("com_back_mm", "com_back", 1.0),
        ("unloaded_ms", "unloaded", 1e3),
    ):
        values = scale * np.array([row[key] for row in rows])
        figures[name] = percentiles(np.where(fell | np.isnan(values), np.inf, values))
    limit = registry()[cell].limit
    worst = np.where(fell, np.inf, np.array([np.nanmax((row["com_up"], row["com_back"])) for row in rows]))
    asked = "no fall" if limit == math.inf else limit
    holds = not fell.any() and (limit is None or percentiles(worst)["p99"] <= limit)
    return {
        "cell": cell,
        "runs": len(rows),
        **figures,
        "falls": int(fell.sum()),
        "promised": asked if cell in PROMISED else None,
        "passed": bool(limit is None or holds),
    }


def runs_of(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, list[dict[str, Any]]]:
    """The measures of every cell that has runs, from the rows of a sweep."""
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in names}
    for row in rows:
        if row["ok"] and row["case.cell"] in found:
            own = {key.removeprefix("result."): value for key, value in row.items() if key.startswith("result.")}
            found[row["case.cell"]].append(own)
    return {name: own for name, own in found.items() if own}


SPREAD = {"median": "median", "p95": "95th", "p99": "99th percentile", "worst": "worst"}
"""Figures of a distribution, in a row's order."""


def shown(found: Sequence[Mapping[str, Any]], of: Sequence[str] = tuple(SPREAD)) -> Table:
    """Rows of the table: the figures ``of`` every distribution, and the bound on the fall rate."""

    def spread(figures: Mapping[str, float]) -> str:
        found = [number(figures[name]) if figures[name] < math.inf else "falls" for name in of]
        return "falls" if set(found) == {"falls"} else " / ".join(found)

    rows = []
    for line in found:
        limit = registry()[line["cell"]].limit
        asked = "none" if limit is None else "no fall" if limit == math.inf else f"{limit:g}"
        verdict = "within" if line["passed"] else "beyond"
        if line["promised"] is not None:
            verdict = "promise holds" if line["passed"] else "promise FAILS"
        bound = 100.0 * fall_rate_bound(line["falls"], line["runs"])
        rows.append((
            line["cell"], knows(line["cell"]), str(line["runs"]), spread(line["com_up_mm"]),
            spread(line["com_back_mm"]), spread(line["unloaded_ms"]), f"{line['falls']} (< {bound:.3g} %)", asked,
            "" if limit is None else verdict,
        ))  # fmt: skip
    header = (
        "cell", "normals", "runs", "CoM up [mm]", "CoM back [mm]", "a wheel unloaded [ms]", "falls (rate, 95 %)",
        "limit [mm]", "",
    )  # fmt: skip
    return table(f"Statistics: {' / '.join(SPREAD[name] for name in of)}", header, rows)


def command(arguments: Any) -> int:
    """Make missing runs, show and write the table; return 1 if a promise fails, 2 for an unknown cell."""
    from benchmarks.lab import sweeps
    from hqp import sweep

    names = _names(arguments.cells)
    if unknown := [name for name in names if name not in registry()]:
        known = ", ".join(registry())
        print(f"benchmarks experiments: no cell {', '.join(unknown)}; there are {known}", file=sys.stderr)
        return 2
    solver = arguments.solver or "lexicographic"
    each = {name: arguments.runs or (MANY if name in PROMISED else FEW) for name in names}
    # the first run of every cell, then the second: a stopped table has all of its cells
    wanted = [
        {"cell": name, "run": run, "seed": arguments.seed, "solver": solver}
        for run in range(max(each.values()))
        for name in names
        if run < each[name]
    ]
    function = "benchmarks.sentis2012.experiments.statistics:one_run"
    cases = sweep.Sweep(function, wanted, arguments.code)
    kept = arguments.kept or Path(arguments.output) / "dreamer-statistics"
    rows = sweeps.rows(cases, kept, jobs=arguments.jobs, only_read=arguments.show, vouch=arguments.vouch)
    made = runs_of(rows, names)
    found = [summary(name, own) for name, own in made.items()]
    nominal = [name for name in made if registry()[name].group == "nominal"]
    groups = [group for group in (nominal, by_tilt(made, nominal)) if group]
    tables = [shown(found), *(compared({name: made[name] for name in group}) for group in groups)]
    sweeps.show(tables, found, arguments.json)
    return int(not all(line["passed"] for line in found if line["promised"] is not None))


def knows(cell: str) -> str:
    """Source of the ground's normals: the simulator's contacts, which are privileged, or the robot itself."""
    words = {"contact": "privileged", "map": "own map", "felt": "ground felt", "base": "tilt"}
    normals = registry()[cell].case.choice.normals
    return words.get(normals, normals)


def by_tilt(made: Iterable[str], but: Sequence[str]) -> list[str]:
    """Cells in which the human carries a share of the weight: they also promise a limit of the pull."""
    return [name for name in made if registry()[name].case.choice.carried != (0.0, 0.0) and name not in but]


def _names(asked: Sequence[str]) -> list[str]:
    groups = {"promised": PROMISED, "all": tuple(registry())}
    return list(dict.fromkeys(name for word in asked for name in groups.get(word, (word,))))


def experiment(setting: Setting) -> Outcome:
    """Six runs each, in full thirty, of the privileged run and of that on the robot's own sensing."""
    runs = FEW if setting.full else 6
    outcome = Outcome("dreamer-statistics")
    outcome.parameters = {"runs": runs, "sets out later by up to [s]": LATER, "friction": f"+-{100 * SLIPPERIER:g} %"}
    outcome.parameters |= {name: ABOUT[name] for name in ("nominal", "nominal-imu")}
    found = []
    for name in ("nominal", "nominal-imu"):
        cases = [replace(varied(registry()[name].case, run, 0), name=f"{name}#{run}") for run in range(runs)]
        made = carry_out(cases, setting.solver, setting.jobs, setting.advance)
        line = summary(name, [asdict(m) for m in made.values()])
        worst = max(line["com_up_mm"]["worst"], line["com_back_mm"]["worst"])
        limit = registry()[name].limit
        outcome.figures.append(Figure(f"{name}: CoM error, worst of {runs}", worst, "mm", high=limit or math.inf))
        outcome.figures.append(Figure(f"{name}: falls of {runs}", line["falls"], high=0.0))
        found.append(line)
    outcome.tables.append(shown(found))
    return outcome
