"""Figures of a run: times against the budget, residuals, certificates, and how calm the commands are."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mask, Mat, Vec
from hqp.problem import Status

from .run import Run, worst

PARTS = ("state", "assemble", "solve", "command")
"""Parts of a tick, in order."""

MOST_REVERSALS = 5.0
"""More sign changes of a command's change a second than this are felt as chatter [1/s]."""

MOST_DRIFT = 1e-4
"""A contact displaced by more than this is no longer where it was put [m, rad]."""

MOST_OVER = 1e-6
"""A joint this far out of its range is outside it [rad, m]."""


@dataclass(frozen=True)
class Summary:
    """One line of the table.

    p50_us ... max_us: times of the whole step.  floor_us: median of a bare kinematics call in the same run; ratio: p50
    to it.  noise: relative spread of the ratio between tenths of the run.  misses: ticks over the period, and the
    longest run of them.  split_us: medians of state, assemble, solve, command.  residual_max, residual_end: by level.
    certified: share of judged ticks.  jump: largest change of a command in a tick; acceleration: its p50 and p99 over
    the period, of the fastest joint; reversals: sign changes of the command's change a second, worst joint.  off:
    distance from its reference at the end, off_max: at most, of each element that has one [m, rad].  drift: largest
    displacement of a contact [m, rad].  over, speeding: largest excess over a joint's range [rad] and speed limit
    [rad/s].
    """

    solver: str
    strict: bool
    status: str
    statuses: dict[str, int]
    ticks: int
    p50_us: float
    p95_us: float
    p99_us: float
    max_us: float
    floor_us: float
    ratio: float
    noise: float
    misses: int
    longest_misses: int
    split_us: dict[str, float]
    residual_max: dict[str, float]
    residual_end: dict[str, float]
    gap: float
    certified: float
    jump: float
    rate_p50: float
    rate_p99: float
    reversals: float
    off: dict[str, float]
    off_max: dict[str, float]
    drift: float
    over: float
    speeding: float
    note: str = ""

    def missed(self, period_us: float) -> frozenset[str]:
        """Columns in which the run violates a requirement on a controller at a period [us]; none for a refused one.

        Every tick solved, in its period and, by a strict solver, certified; at most ``MOST_REVERSALS``; contacts
        within ``MOST_DRIFT``; joints inside their range.
        """
        times = {"p50 us": self.p50_us, "p95": self.p95_us, "p99": self.p99_us, "max": self.max_us}
        kept = {name: time <= period_us for name, time in times.items()} | {
            "status": all(Status[name].solved or name == "NOT_STRICT" for name in self.statuses),
            "missed": self.misses == 0,
            "certified": not self.strict or self.certified == 1.0,
            "reversals/s": self.reversals <= MOST_REVERSALS,
            "drift mm": self.drift <= MOST_DRIFT,
            "over limit": self.over <= MOST_OVER,
        }
        return frozenset(name for name, held in kept.items() if not held) if self.ticks else frozenset()


def summarise(run: Run) -> Summary:
    """The figures of a run."""
    over = run.total > 1e6 * run.dt
    change = np.abs(np.diff(run.commands, axis=0)).max(axis=1, initial=0.0)
    percentiles = np.percentile(run.total, (50, 95, 99))
    floor = float(np.median(run.floor))
    rate = np.percentile(change, (50, 99)) / run.dt if change.size else np.zeros(2)
    p50, p95, p99 = (float(p) for p in percentiles)
    return Summary(
        solver=run.solver,
        strict=run.strict,
        status=worst(run.statuses),
        statuses=dict(Counter(run.statuses)),
        ticks=run.total.size,
        p50_us=p50,
        p95_us=p95,
        p99_us=p99,
        max_us=float(run.total.max()),
        floor_us=floor,
        ratio=p50 / floor,
        noise=_noise(run.total, run.floor),
        misses=int(over.sum()),
        longest_misses=_longest(over),
        split_us=dict(zip(PARTS, np.median(run.times, axis=0).tolist(), strict=True)),
        residual_max=dict(zip(run.levels, np.nanmax(run.residuals, axis=0).tolist(), strict=True)),
        residual_end=dict(zip(run.levels, run.residuals[-1].tolist(), strict=True)),
        gap=float(run.gaps.max(initial=0.0)),
        certified=float(np.mean(run.certified)) if run.certified else 0.0,
        jump=float(change.max(initial=0.0)),
        rate_p50=float(rate[0]),
        rate_p99=float(rate[1]),
        reversals=reversals(run.commands, run.dt),
        off=_by_name(run, run.behaviour.errors[-1]),
        off_max=_by_name(run, _largest(run.behaviour.errors)),
        drift=float(run.behaviour.drift.max()),
        over=float(run.behaviour.over.max()),
        speeding=float(run.behaviour.speeding.max()),
    )


def refused(solver: str, strict: bool, note: str) -> Summary:
    """The line of a solver that does not take the stack."""
    nan = float("nan")
    return Summary(
        solver, strict, "refused", {}, 0, nan, nan, nan, nan, nan, nan, nan, 0, 0, {}, {}, {}, nan, 0.0, nan, nan, nan,
        nan, {}, {}, nan, nan, nan, note,
    )  # fmt: skip


def _longest(over: Mask) -> int:
    longest = current = 0
    for missed in over.tolist():
        current = current + 1 if missed else 0
        longest = max(longest, current)
    return longest


def _noise(total: Vec, floor: Vec) -> float:
    """Half the spread between the 2nd smallest and the 2nd largest of the ratios of ten parts, relative."""
    if total.size < 50:
        return 1.0
    ratios = np.sort([np.median(t) / np.median(f) for t, f in zip(*map(_tenths, (total, floor)), strict=True)])
    return float(0.5 * (ratios[-2] - ratios[1]) / np.median(ratios))


def _tenths(values: Vec) -> list[Vec]:
    return np.array_split(values, 10)


def _by_name(run: Run, values: Vec) -> dict[str, float]:
    return dict(zip(run.behaviour.tracked, values.tolist(), strict=True))


def _largest(errors: Mat) -> Vec:
    return np.asarray(np.where(np.isnan(errors), -np.inf, errors).max(axis=0))


def reversals(commands: Mat, dt: float) -> float:
    """Sign changes a second of the command's change, worst joint; changes below 1e-6 of the largest do not count."""
    change = np.diff(commands, axis=0)
    if len(change) < 2:
        return 0.0
    change[np.abs(change) < 1e-6 * max(float(np.abs(change).max(initial=0.0)), 1e-9)] = 0.0
    turns = (change[1:] * change[:-1] < 0.0).sum(axis=0)
    return float(turns.max(initial=0) / (len(change) * dt))
