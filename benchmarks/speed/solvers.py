"""Solvers on the stored problem sets: time cold and warm against LAPACK's dgeqp3, effort, certified share."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.reports import report, solver_sets
from benchmarks.reports.checks import write_json
from benchmarks.speed import sequences, stopwatch
from hqp import Hierarchy, Status, certificate, native, solvers
from hqp.solvers import Solver
from tests.scenes import problems, random_hierarchies

TARGETS = {
    "a38": 0.6, "a57": 0.45, "b5_38": 1.6, "b15_38": 6.0, "c38": 16.0, "d38": 8.0, "f62eq": 3.5,
}  # fmt: skip
"""Median of a whole cold solve to reach, in units of dgeqp3 on the equality stack of the same n."""

SEQUENCES = ("e38", "e57")
"""Sets in the order of a closed loop, every 20th tick of it: each problem is also solved warm from the one before."""

FLOOR = "dgeqp3"
SLOW_PROBLEMS, QUICK_PROBLEMS = 8, 4
"""Problems of a set for a slow solver, and for all solvers with --quick."""

SLOW_TICKS, LOOP_REPEATS = 50, 3
"""Ticks of a loop for a slow solver, and for all solvers with --quick; repetitions of a loop."""


@dataclass(frozen=True)
class Measured:
    """One solver on one set, cold or warm; times in us, effort as medians, certified as a share."""

    set: str
    solver: str
    start: str
    problems: int
    median: float
    p99: float
    largest: float
    ratio: float
    iterations: float
    factorisations: float
    certified: float
    solved: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    every = [*problems.names(), *sequences.ROBOTS]
    parser.add_argument("--sets", nargs="+", choices=every, default=every, metavar="SET", help="default: all")
    parser.add_argument("--solvers", nargs="+", default=None, metavar="NAME", help="default: all available")
    parser.add_argument(
        "--others", type=int, default=None, metavar="N",
        help=f"problems of a set for all solvers but the fastest, default {SLOW_PROBLEMS}, all of them for daqp",
    )  # fmt: skip
    parser.add_argument("--repeat", type=int, default=None, metavar="N", help="solves a problem, default 20")
    parser.add_argument(
        "--random", type=int, default=None, metavar="N",
        help="hard random hierarchies to certify, default 100000; 1000000 takes over an hour",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Measure, show, write; return 1 if the certificate refuses an answer that the native solver calls solved."""
    subjects, others = _subjects(arguments.solvers), arguments.others
    repeat = arguments.repeat or (3 if arguments.quick else 20)
    found: list[Measured] = []
    walls: dict[str, dict[str, float]] = {}
    with report.bar() as bar:
        task = bar.add_task("solvers", total=len(arguments.sets) * len(subjects))
        for name in arguments.sets:
            for label, solver in subjects.items():
                bar.update(task, description=f"{label} on {name}")
                if name in sequences.ROBOTS:
                    ticks = SLOW_TICKS if arguments.quick or not _fast(label, others) else sequences.TICKS
                    found += _loop(name, label, solver, sequences.load(name, ticks))
                    bar.advance(task)
                    continue
                limit = None if _fast(label, others) else others or SLOW_PROBLEMS
                limit = QUICK_PROBLEMS if arguments.quick else limit
                chosen_problems = problems.load(name, limit)
                if label == FLOOR or all(_takes(solver, problem) for problem in chosen_problems):
                    found += _measure(name, label, solver, chosen_problems, repeat, walls)
                bar.advance(task)
    count = arguments.random if arguments.random is not None else (500 if arguments.quick else 100_000)
    drawn = _random(count) if count else None
    if arguments.json is not None:
        write_json(arguments.json, [*found, *([drawn] if drawn else [])])
    return _show(found, drawn, walls, arguments.output)


def _subjects(names: Sequence[str] | None) -> dict[str, Solver | None]:
    found: dict[str, Solver | None] = {FLOOR: None}
    for name in names or solver_sets.every():
        found[name] = solvers.load(name)
    return found


def _fast(label: str, others: int | None) -> bool:
    return label in (FLOOR, "lexicographic", "nullspace") or (label == "daqp" and others is None)


def _takes(solver: Solver | None, problem: Hierarchy) -> bool:
    return solver is not None and (solver.inequalities or not problem.shape.inequalities)


def _measure(
    name: str, label: str, solver: Solver | None, chosen_problems: Sequence[Hierarchy], repeat: int,
    walls: dict[str, dict[str, float]],
) -> Iterator[Measured]:  # fmt: skip
    floors = stopwatch.stacks("a57" if chosen_problems[0].n == 57 else "a38")
    if solver is None:
        times = np.array([stopwatch.factorisation(A, repeat) for A in floors])
        typical, late, largest = np.median(times), np.quantile(times, 0.99), times.max()
        count = len(floors)
        yield Measured(name, label, "cold", count, typical, late, largest, 1.0, 0.0, 0.0, 1.0, 1.0)
        return
    for start in ("cold", "warm"):
        laps = [
            stopwatch.solve(solver, problem, floors[i % len(floors)], repeat, start == "warm")
            for i, problem in enumerate(chosen_problems)
        ]
        certified = [certificate(p, lap.solution.x).ok for p, lap in zip(chosen_problems, laps, strict=True)]
        if start == "cold":
            walls.setdefault(label, {}).update({f"{name}/{i}": lap.best for i, lap in enumerate(laps)})
        yield _row(name, label, start, laps, certified)
    if name in SEQUENCES:
        laps = stopwatch.sequence(solver, chosen_problems, floors[0], repeat)
        certified = [certificate(p, lap.solution.x).ok for p, lap in zip(chosen_problems, laps, strict=True)]
        yield _row(name, label, "sequence", laps, certified)


def _loop(name: str, label: str, solver: Solver | None, ticks: Sequence[Hierarchy]) -> Iterator[Measured]:
    if solver is None or not _takes(solver, ticks[0]):
        return
    floor = stopwatch.stacks(name.replace("loop", "a"))[0]
    laps = stopwatch.sequence(solver, ticks, floor, LOOP_REPEATS)
    judged = slice(None, None, max(1, len(ticks) // SLOW_TICKS))
    certified = [certificate(p, lap.solution.x).ok for p, lap in zip(ticks[judged], laps[judged], strict=True)]
    yield _row(name, label, "every tick", laps, certified)


def _row(name: str, label: str, start: str, laps: Sequence[stopwatch.Lap], certified: Sequence[bool]) -> Measured:
    times, stats = np.concatenate([lap.times for lap in laps]), [lap.solution.stats for lap in laps]
    typical, floor = float(np.median([lap.best for lap in laps])), float(np.median([lap.floor for lap in laps]))
    return Measured(
        name, label, start, len(laps), typical, float(np.quantile(times, 0.99)), float(times.max()), typical / floor,
        float(np.median([s.iterations for s in stats])), float(np.median([s.factorisations for s in stats])),
        float(np.mean(certified)), float(np.mean([lap.solution.status.solved for lap in laps])),
    )  # fmt: skip


def _random(count: int) -> dict[str, object]:
    """Solve hard random hierarchies: number solved, and number of these that the certificate refuses."""
    solver = solvers.load("lexicographic")
    refused, unsolved, uncertain, most = [], [], 0, 0
    with report.bar() as bar:
        for seed in bar.track(range(count), description="hard random hierarchies"):
            problem = random_hierarchies.hierarchy(seed)
            solution = solver.solve(problem)
            most = max(most, solution.stats.factorisations)
            if solution.status is Status.RANK_UNCERTAIN:
                uncertain += 1
            if not solution.status.solved:
                unsolved.append(seed)
            elif not certificate(problem, solution.x).ok:
                refused.append(seed)
    return {
        "set": "hard random", "problems": count, "unsolved": unsolved, "refused": refused,
        "rank uncertain": uncertain, "most factorisations": most,
    }  # fmt: skip


HEADER = (
    "set", "solver", "start", "problems", "median us", "p99", "max", "/ dgeqp3", "iterations", "factorisations",
    "solved", "certified",
)  # fmt: skip


def _cells(row: Measured) -> tuple[str, ...]:
    solved = ("", "") if row.solver == FLOOR else (f"{row.solved:.0%}", f"{row.certified:.0%}")
    return (
        row.set, row.solver, row.start, str(row.problems), f"{row.median:.1f}", f"{row.p99:.1f}", f"{row.largest:.1f}",
        f"{row.ratio:.2f}", f"{row.iterations:g}", f"{row.factorisations:g}", *solved,
    )  # fmt: skip


def _show(
    found: Sequence[Measured], drawn: dict[str, object] | None, walls: dict[str, dict[str, float]], output: Path
) -> int:
    text = report.table(HEADER, map(_cells, found))
    goals = report.table(("set", "goal", "measured", "outcome"), _goals(found))
    told = (
        f"Hard random hierarchies: {drawn['problems']}, not solved {drawn['unsolved']}, solved but refused by the "
        f"certificate {drawn['refused']}, rank uncertain {drawn['rank uncertain']}, most factorisations "
        f"{drawn['most factorisations']}."
        if drawn
        else ""
    )
    for part in (text, goals, told):
        report.console.print(part, markup=False, soft_wrap=True)
    report.section(
        output,
        "solvers",
        f"Whole solve calls from Python, one thread, {native.describe()}; median over the problems of the fastest of "
        "each, p99 and max over all calls; the unit is one column-pivoted QR (LAPACK dgeqp3) of the equality stack "
        "with the same n, timed in between. Warm: the same problem again; every tick: warm from the tick before in a "
        "loop at 500 Hz (loop38: Talos, loop57: CBi); sequence: warm from the problem before, 20 ticks earlier.",
        text,
        "Goals of the native solver:",
        goals,
        told,
        *_figure(walls, output),
    )
    failures = [
        f"lexicographic, set {r.set}, {r.start}: solved {r.solved:.0%}, certified {r.certified:.0%}"
        for r in found
        if r.solver == "lexicographic" and r.certified < r.solved
    ]
    if drawn and (drawn["refused"] or drawn["unsolved"]):
        failures.append(told)
    judged = [r for r in found if r.solver == "lexicographic"]
    whole = sum(r.certified == 1.0 for r in judged)
    lines = [f"lexicographic: every problem certified in {whole} of {len(judged)} runs of a set", told]
    return report.conclude(output, "solvers", [*lines, *report.goals_of(_goals(found))], failures)


def _goals(found: Sequence[Measured]) -> list[tuple[str, str, str, str]]:
    mine = {(r.set, r.start): r for r in found if r.solver == "lexicographic"}
    cold = {name: row.ratio for (name, start), row in mine.items() if start == "cold"}
    wanted = [(name, "cold", goal, cold[name]) for name, goal in TARGETS.items() if name in cold]
    for (name, start), row in mine.items():
        base = "a" + name[-2:]
        if (name in SEQUENCES or name in sequences.ROBOTS) and start != "cold" and base in cold:
            wanted.append((name, start, 1.15 * cold[base], row.ratio))
    if "f62eq" in cold and "f62" in cold:
        wanted.append(("f62", "cold", 15.0 * cold["f62eq"], cold["f62"]))
        wanted.append(("f62", "warm", 1.2 * cold["f62eq"], mine["f62", "warm"].ratio))
    return [
        (f"{name} {start}", f"{goal:.2f}", f"{value:.2f}", "reached" if value <= goal else "MISSED")
        for name, start, goal, value in wanted
    ]


def _figure(walls: dict[str, dict[str, float]], output: Path) -> list[str]:
    try:
        from benchmarks.speed import profile
    except ImportError:
        return []
    path = profile.performance(walls, output / "solvers_profile.png")
    return [f"![performance profile]({path.name})"]
