"""Ticks of 500 Hz through every solver, split into parts, against 2 ms and the bare Pinocchio calls."""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import TypeAlias

import numpy as np

from benchmarks.reports import report, solver_sets
from benchmarks.reports.checks import write_json
from benchmarks.speed import teleoperation, ticks
from benchmarks.speed.ticks import PARTS, Ticks
from hqp import native, robots, solvers
from tests.scenes.mistry2008 import HZ

ROBOTS = ("cbi", "talos")

Through: TypeAlias = Callable[[str, solvers.Solver, int], Ticks]
"""A scene with a solver, by name, for a number of ticks."""

WITHOUT_SOLVE_US, TIMES_FLOOR, WHOLE_US = 45.0, 7.0, 250.0
"""Goals of medians on Talos: tick without the solve, its ratio to the floor, the fastest strict solver's tick."""


GAP = 1e-6
"""Largest certificate gap of a solved tick of a strict solver."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    add_counts(parser)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), metavar="NAME", help="default: cbi talos")
    parser.add_argument(
        "--hands",
        nargs="*",
        default=list(teleoperation.GOALS),
        metavar="NAME",
        help="following a goal; default: ur5 ...",
    )


def add_counts(parser: argparse.ArgumentParser) -> None:
    """Options of the number of ticks and of the solvers."""
    parser.add_argument("--ticks", type=int, default=None, metavar="N", help="ticks a solver, default 2000")
    parser.add_argument("--solvers", nargs="+", default=None, metavar="NAME", help="default: all available")


def run(arguments: argparse.Namespace) -> int:
    """Measure, show, write; return 1 if a solved answer is wrong.  Times depend on the machine and fail nothing."""
    count = arguments.ticks or (200 if arguments.quick else 2000)
    names = arguments.solvers or list(solver_sets.every())
    scenes = [partial(ticks.paper, robots.load(name)) for name in arguments.robots]
    runs = each("timing", scenes, names, count)
    hands = [run for name in arguments.hands if name in robots.names() for run in teleoperation.measure(name, count)]
    records = [r.record() for r in runs]
    if arguments.json is not None:
        write_json(arguments.json, [*records, *(run.record() for run in hands)])
    text, goals = report.table(HEADER, map(cells, records)), report.table(GOAL_HEADER, _goals(runs))
    following = report.table(teleoperation.HEADER, teleoperation.rows(hands))
    reached = report.table(GOAL_HEADER, teleoperation.outcomes(hands))
    for shown in (text, goals, following, reached):
        report.console.print(shown, markup=False, soft_wrap=True)
    report.section(
        arguments.output,
        "timing",
        f"{count} ticks each of 500 Hz (budget 2 ms; *late*: over it), one BLAS thread, garbage collection off, "
        f"{native.describe()}. Times in us. "
        "*floor*: the bare Pinocchio calls of the stack at the same states in the same run. "
        "*gap*: largest certificate gap of every "
        f"{ticks.JUDGED}th tick. Solvers marked (limits ignored) take no inequalities: they do less. `daqp` and "
        "`cascade:*` include the refinement of the back end's answer.",
        f"Stack: `{runs[0].stack}`" if runs else "",
        text,
        "To reach on Talos (medians):",
        goals,
        "Hands that follow a goal (UR5, Panda: hand pose > posture; G1: feet > CoM > two hand poses > posture; joint "
        "limits), from `robot.state` to the command, beside the two bare Pinocchio calls of the same run:",
        following,
        reached,
        *_figures(runs, arguments.output),
    )
    return report.conclude(
        arguments.output,
        "timing",
        [*summary(runs), *report.goals_of([*_goals(runs), *teleoperation.outcomes(hands)])],
        [f"{r.solver} on {r.robot}: solved, but the certificate's gap is {r.gap:.1e}" for r in runs if wrong(r)],
    )


def each(
    part: str, scenes: Sequence[Callable[[str, solvers.Solver, int], Ticks]], names: Sequence[str], count: int
) -> list[Ticks]:
    """Every scene through every solver."""
    runs = []
    with report.bar() as bar:
        task = bar.add_task(part, total=len(scenes) * len(names))
        for scene, name in product(scenes, names):
            bar.update(task, description=f"{part} {name}")
            runs.append(scene(name, solvers.load(name), count))
            bar.advance(task)
    return runs


def summary(runs: list[Ticks]) -> Iterator[str]:
    """A line a robot: median ticks of every solver, the fastest first."""
    for robot in dict.fromkeys(r.robot for r in runs):
        mine = sorted((r for r in runs if r.robot == robot), key=lambda r: r.median)
        yield f"{robot}, median us: " + ", ".join(f"{r.solver} {r.median:.0f}" for r in mine)


def wrong(run: Ticks) -> bool:
    """Return true if the certificate refuses an answer that a strict solver under limits calls solved."""
    return run.solver in solver_sets.bounded() and not run.unsolved and not run.gap <= GAP


HEADER = (
    "robot", "solver", "median", "p99", "max", "cpu", *PARTS, "without solve", "floor", "late", "unsolved",
    "gap", "hand RMS mm",
)  # fmt: skip


def cells(record: dict[str, object]) -> tuple[str, ...]:
    """A run's record as the cells of a table."""
    wall, cpu, split = (dict(record[key]) for key in ("wall_us", "cpu_us", "split_us"))  # type: ignore[call-overload]
    parts = (f"{split[part]:.1f}" if part in split else "" for part in PARTS)
    gap = f"{record['gap']:.0e}" if "gap" in record else ""
    without = f"{record['without_solve_us']:.1f}" if split else ""
    return (
        str(record["robot"]), str(record["solver"]), *(f"{wall[key]:.0f}" for key in ("median", "p99", "max")),
        f"{cpu['median']:.0f}", *parts, without, f"{record['floor_us']:.1f}",
        f"{record['misses']}/{record['ticks']}", str(record["unsolved"]), gap, f"{record['hand_rms_mm']:.3f}",
    )  # fmt: skip


GOAL_HEADER = ("", "goal", "measured", "outcome")


def _goals(runs: list[Ticks]) -> list[tuple[str, str, str, str]]:
    """Each goal on Talos with its measurement and verdict."""
    limited = [r for r in runs if r.robot == "talos" and "ignored" not in r.solver]
    strict = [r for r in limited if r.solver in solver_sets.strict() and not r.unsolved]
    if not strict:
        return []
    best = min(strict, key=lambda r: r.median)
    floor, median = float(np.median(best.run.floor)), best.median
    ratio = best.without_solve / floor
    return [
        goal(f"state + references + assemble + command ({best.solver})", WITHOUT_SOLVE_US, best.without_solve, "us"),
        goal(f"the same over the floor of {floor:.1f} us", TIMES_FLOOR, ratio, "times"),
        goal(f"whole tick with limits, fastest strict solver ({best.solver})", WHOLE_US, median, "us"),
    ]


def goal(text: str, most: float, measured: float, unit: str) -> tuple[str, str, str, str]:
    """A goal with its measurement and verdict."""
    return text, f"{most:g} {unit}", f"{measured:.1f} {unit}", "reached" if measured <= most else "MISSED"


def _figures(runs: list[Ticks], output: Path) -> list[str]:
    if importlib.util.find_spec("matplotlib") is None:
        return []
    from benchmarks.speed import figures

    found = []
    for name in dict.fromkeys(r.robot for r in runs):
        walls = {r.solver: r.wall for r in runs if r.robot == name}
        path = figures.tick_times(
            walls, 1e6 / HZ, f"{name}: share of ticks finished in time", output / f"ticks_{name}.png"
        )
        found.append(f"![tick times on {name}]({path.name})")
    return found
