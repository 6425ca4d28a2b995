"""A recording solved again: agreement of solvers with the sent commands, and the losses over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from hqp.errors import HqpError
from hqp.numbers import whole
from hqp.problem import Hierarchy, Solution, Status
from hqp.recorder.files import RecordedTick, Recording
from hqp.solvers import load, select
from hqp.solvers.base import Solver, Workspace

AGREE = 1e-6
"""Norms of levels that differ by less, relative to 1 + their size, are the same."""


@dataclass(frozen=True)
class Line:
    """One solver over a recording.

    agreed, solved: number of ticks with the levels of the recording; number of solved ticks.  first: count of the first
    tick where not, -1 for none.  level, difference: place and size of its largest difference.  worse: in how many ticks
    the first level that differs is larger than recorded.  note: why it did not run, or not to the end.
    """

    solver: str
    solved: int = 0
    agreed: int = 0
    worse: int = 0
    first: int = -1
    level: str = ""
    difference: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class Period:
    """Ticks in which the same elements were not met for the same reasons."""

    first: int
    last: int
    status: str
    causes: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        why = "; ".join(f"{element} {cause}" for element, cause in self.causes) or "everything is met"
        return f"{self.first:>8} .. {self.last:<8} {self.status:20} {why}"


@dataclass(frozen=True)
class Replay:
    """Results of solvers on a recording, and the account over time; ``str()`` for a terminal."""

    recording: Recording
    lines: tuple[Line, ...]
    periods: tuple[Period, ...]

    def __str__(self) -> str:
        head = ("solver", "ticks", "agree", "worse", "first", "most off")
        body = [
            (
                line.solver,
                str(line.solved),
                line.note or str(line.agreed),
                "" if line.note else str(line.worse),
                "" if line.first < 0 else str(line.first),
                f"{line.difference:.1e} in {line.level}" if line.level else "",
            )
            for line in self.lines
        ]
        widths = [max(len(row[i]) for row in (head, *body)) for i in range(len(head) - 1)]
        table = [
            "  ".join((*(c.ljust(w) for c, w in zip(row, widths, strict=False)), row[-1])) for row in (head, *body)
        ]
        return "\n".join(
            (str(self.recording), "", *table, "", "ticks, status, what was not met", *map(str, self.periods))
        )


def replay(recording: Recording, solvers: str | Solver | Sequence[str | Solver] = "all", every: int = 1) -> Replay:
    """Solve every tick of a recording again; raises HqpError for an unknown solver, or no tick to solve.

    solvers: names, Solver values, or "all" that are installed.  every: only each so many-th tick.
    """
    chosen, every = select(solvers), whole("replay", "every", every, 1)
    ticks = [tick for tick in recording.ticks[::every] if tick.solution is not None]
    if not ticks:
        raise HqpError("the recording has no solved tick")
    return Replay(recording, tuple(_line(one, ticks) for one in chosen), periods(recording.ticks[::every]))


SECONDS = 30.0
"""A solver that takes longer over a recording is stopped [s]."""


def _line(chosen: str | Solver, ticks: Sequence[RecordedTick]) -> Line:
    solver = load(chosen) if isinstance(chosen, str) else chosen
    name = chosen if isinstance(chosen, str) else solver.name
    workspaces: dict[int, Workspace] = {}
    solved = agreed = worse = 0
    first, level, most = -1, "", 0.0
    end, note = perf_counter() + SECONDS, ""
    for tick in ticks:
        if perf_counter() > end:
            note = f"{agreed}, stopped after {SECONDS:g} s"
            break
        try:
            key = id(tick.places)
            if key not in workspaces:
                solver.require(tick.problem.shape)
                workspaces[key] = solver.workspace(tick.problem.shape)
            found = workspaces[key].solve(tick.problem)
        except (HqpError, ValueError, ArithmeticError, RuntimeError) as error:
            return Line(name, solved, note=f"refused: {error}")
        solved += 1
        assert tick.solution is not None
        off = _differences(tick.problem, found, tick.solution)
        k = int(np.argmax(np.abs(off)))
        if abs(off[k]) <= AGREE and found.status.usable:
            agreed += 1
            continue
        where = next(i for i, d in enumerate(off) if abs(d) > AGREE or i == k)
        worse += bool(off[where] > 0.0)
        first = tick.count if first < 0 else first
        if abs(off[k]) > most:
            most = abs(float(off[k]))
            level = next((p.declared for p in tick.places.values() if p.level == k), str(k))
    return Line(name, solved, agreed, worse, first, level, most, note)


def _differences(problem: Hierarchy, found: Solution, recorded: Solution) -> list[float]:
    """Excess of each level over the recorded one, relative to 1 + its size."""
    pairs = zip(found.norms.tolist(), recorded.norms.tolist(), strict=True)
    return [(new - old) / (1.0 + old) for new, old in pairs] or [0.0] * len(problem.levels)


def periods(ticks: Sequence[RecordedTick]) -> tuple[Period, ...]:
    """The account over time: runs of ticks with the same causes."""
    found: list[Period] = []
    for tick in ticks:
        causes = _causes(tick)
        last = found[-1] if found else None
        if last is not None and last.causes == causes and last.status == tick.status.name:
            found[-1] = Period(last.first, tick.count, last.status, causes)
        else:
            found.append(Period(tick.count, tick.count, tick.status.name, causes))
    return tuple(found)


def _causes(tick: RecordedTick) -> tuple[tuple[str, str], ...]:
    """Elements that are not met, and why: the cause, and the largest shares."""
    if tick.solution is None or tick.status is Status.NOT_CERTIFIED:
        return tuple((element, text) for element, _, text in tick.notes)
    found = []
    for account in tick.explain().accounts:
        if not account.met and not account.active:
            most = f" to {account.losses[0].element}" if account.cause == "lost" and account.losses else ""
            limits = [loss.rows for loss in account.losses if loss.binds]
            by = f" {', '.join(limits[0][:2])}" if account.cause == "limit" and limits else ""
            found.append((account.element, f"{account.cause}{most}{by}"))
    return tuple(found)
