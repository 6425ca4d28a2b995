"""CBi's figures as distributions: each motion many times, with the sensors' noise and friction changed from run to run.

Every run is a case of ``hqp.sweep``: after a kill, the command resumes with the missing runs.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from benchmarks.lab.curves import largest, rms
from benchmarks.lab.distribution import Asked, fall_rate_bound
from benchmarks.lab.outcome import Figure, Outcome, Table, table
from benchmarks.lab.setting import Setting
from benchmarks.mistry2008.experiments import cog, figure8, switch
from benchmarks.mistry2008.experiments.balance import Balance, base_errors

SLIPPERIER = 0.02
"""Friction differs by up to this share."""

MANY, FEW = 30, 2
"""Runs of a motion, in full and in the short version."""

BASE = (
    Asked("place", "base as estimated: place off by, max [mm]", high=2.0),
    Asked("turned", "base as estimated: orientation off by, max [deg]", high=0.2),
)

MOTIONS: Mapping[str, tuple[Asked, ...]] = {
    "side to side": (
        Asked("across", "CoG left-right, RMS [mm]", high=2.0),
        Asked("ahead", "CoG front-back, RMS [mm]", high=2.0),
        Asked("feet", "feet, max [mm]", high=1.0),
        *BASE,
    ),
    "side to side without feedforward": (
        Asked("lag", "lag [s]", low=0.39, high=0.45),
        Asked("gain", "gain", low=0.84, high=0.90),
    ),
    "figure-8": (
        Asked("hand", "hand, RMS [mm]", high=1.0),
        Asked("com", "CoG over the ground, max [mm]", high=0.5),
        Asked("feet", "feet, max [mm]", high=1.0),
        *BASE,
    ),
    "figure-8 by eq. (16) as printed": (Asked("hand", "hand, RMS [mm]", low=45.0, high=55.0),),
    "contact switch": (
        Asked("com", "CoG over the ground, max [mm]", high=12.0),
        Asked("lift", "foot lifted, max [mm]", low=40.0, high=43.0),
        Asked("jump", "jump of a joint's velocity at a switch, max [rad/s]"),
        Asked("landed", "lifted foot from where it stood, at the end [mm]"),
        *BASE,
    ),
}
"""Measures and limits of each motion, equal to those of a single run; durations of the short ones: 15, 10, 14.4 s."""


def one_run(motion: str, run: int, seed: int = 0, solver: str = "lexicographic") -> dict[str, float]:
    """Measures of one run, a case of a sweep."""
    rng = np.random.default_rng([seed, zlib.crc32(motion.encode()), run])
    friction = 0.8 * (1.0 + SLIPPERIER * rng.uniform(-1.0, 1.0))
    noise = int(rng.integers(2**31))
    setting = Setting(solver=solver)
    done, found = _MADE[motion](setting, friction, noise)
    place, turned = base_errors(done.log)
    feet = 1e3 * largest(done.log["soles"].max(axis=1))
    fell = done.t if done.fallen else math.nan
    return {"fell": fell, "feet": feet, "place": place, "turned": turned, **found}


def _side_to_side(setting: Setting, friction: float, noise: int) -> tuple[Balance, dict[str, float]]:
    run = cog.swing(cog.Swing(seconds=15.0, friction=friction, seed=noise), setting)
    e = cog.errors(run)
    return run, {"across": rms(e[:, 1]), "ahead": rms(e[:, 0])}


def _lagging(setting: Setting, friction: float, noise: int) -> tuple[Balance, dict[str, float]]:
    run = cog.swing(cog.Swing(seconds=15.0, feedforward=False, friction=friction, seed=noise), setting)
    gain, lag = cog.lag(run, cog.FREQUENCY)
    return run, {"lag": lag, "gain": gain}


def _drawn(setting: Setting, friction: float, noise: int) -> tuple[Balance, dict[str, float]]:
    run = figure8.draw(setting, setting.solver, 10.0, friction=friction, seed=noise)
    return run, {"hand": rms(figure8.hand_errors(run)), "com": largest(figure8.com_errors(run))}


def _printed(setting: Setting, friction: float, noise: int) -> tuple[Balance, dict[str, float]]:
    run = figure8.draw(setting, figure8.PRINTED, 10.0, friction=friction, seed=noise)
    return run, {"hand": rms(figure8.hand_errors(run))}


def _switched(setting: Setting, friction: float, noise: int) -> tuple[Balance, dict[str, float]]:
    run, jumps = switch.switch(setting, switch.QUICK, friction=friction, seed=noise)
    log = run.log
    return run, {
        "com": 1e3 * largest(log["com"][:, :2] - log["com_goal"]),
        "lift": 1e3 * float(log["lift"].max()),
        "jump": max(jumps, default=math.nan),
        "landed": 1e3 * float(log["soles"][-1, 1]),
    }


_MADE: Mapping[str, Callable[[Setting, float, int], tuple[Balance, dict[str, float]]]] = dict(
    zip(MOTIONS, (_side_to_side, _lagging, _drawn, _printed, _switched), strict=True)
)


def experiment(setting: Setting) -> Outcome:
    """Two runs of each motion; in full, thirty by a sweep that can be stopped and resumed."""
    runs = MANY if setting.full else FEW
    outcome = Outcome("cbi-statistics")
    outcome.parameters = {"runs": runs, "friction": f"+-{100 * SLIPPERIER:g} %", "noise": "another seed each"}
    wanted = [{"motion": m, "run": i, "solver": str(setting.solver)} for i in range(runs) for m in MOTIONS]
    if setting.full and setting.output is not None:
        rows = _swept(wanted, setting)
    else:
        rows = []
        with ProcessPoolExecutor(setting.jobs) as pool:
            for case, waiting in [(case, pool.submit(one_run, **case)) for case in wanted]:  # type: ignore[arg-type]
                rows.append({**case, **waiting.result()})
                setting.advance()
    for motion, asked in MOTIONS.items():
        own = [row for row in rows if row["motion"] == motion]
        falls = sum(math.isfinite(row["fell"]) for row in own)
        outcome.figures.append(Figure(f"{motion}: falls of {len(own)}", falls, high=0.0))
        for figure in asked:
            found = figure.spread(own)["p99"]
            text = f"{motion}: {figure.words}, 99th percentile"
            outcome.figures.append(Figure(text, found, low=figure.low, high=figure.high))
    outcome.tables.append(shown(rows))
    return outcome


def shown(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Median / 99th percentile / worst of every figure, and the bound on the fall rate."""
    lines = []
    for motion, asked in MOTIONS.items():
        own = [row for row in rows if row["motion"] == motion]
        falls = sum(math.isfinite(row["fell"]) for row in own)
        bound = f"{falls} of {len(own)} (< {100.0 * fall_rate_bound(falls, len(own)):.3g} %)"
        lines += [(motion, figure.words, figure.cell(own), bound) for figure in asked]
    header = ("motion", "figure", "median / 99th percentile / worst", "falls (rate, 95 %)")
    return table("CBi's figures over runs", header, lines)


def _swept(wanted: Sequence[dict[str, Any]], setting: Setting) -> list[dict[str, Any]]:
    from benchmarks.lab import sweeps
    from hqp import sweep

    assert setting.output is not None
    cases = sweep.Sweep("benchmarks.mistry2008.experiments.statistics:one_run", wanted)
    kept = setting.output / "cbi-statistics"
    return [sweeps.plain(row) for row in sweeps.rows(cases, kept, jobs=setting.jobs, show=False)]
