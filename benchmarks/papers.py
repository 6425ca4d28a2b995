"""Every equation of the papers at its tolerance, with negative controls, and the closed loops with their figures."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
from pathlib import Path

from benchmarks.mistry2008.equations import (
    contacts,
    headline,
    integration,
    kinematics,
    prioritised,
    second_order,
    theorems,
)
from benchmarks.reports import report, solver_sets
from benchmarks.reports.checks import Check, of_kind, write_json
from benchmarks.sentis2012 import equations as sentis2012
from hqp import robots

ROBOTS = ("cbi", "talos")

POINTWISE = {
    "eqs. (2) to (6), (14)": kinematics,
    "eqs. (7) to (11), conditions": contacts,
    "eqs. (12), (16), (17)": prioritised,
    "eqs. (18) to (22)": second_order,
    "equivalences": theorems,
    "the experiments' controller": headline,
}
"""Modules with ``checks(robot, count)``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    states = "random states a row; percent of Sentis 2012's; default 100"
    parser.add_argument("--states", type=int, default=None, metavar="N", help=states)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), metavar="NAME", help="default: cbi talos")


def run(arguments: argparse.Namespace) -> int:
    """Check, show, write; returns 1 if a check fails."""
    count = arguments.states or (10 if arguments.quick else 100)
    checks, notes = mistry(tuple(arguments.robots), count, arguments.output)
    more, figures = sentis(count, not arguments.quick, arguments.output)
    checks += more
    notes += figures
    report.show(checks)
    if arguments.json is not None:
        write_json(arguments.json, checks)
    failed = [check for check in checks if not check.passed]
    paragraphs = [f"{report.tally(checks)}; {count} random states a row; levels are exact (price 0).", *notes]
    if failed:
        paragraphs += ["### Failed", report.table(report.HEADER, map(report.cells, failed))]
    report.section(
        arguments.output, "papers", *paragraphs, "### Rows", report.table(report.HEADER, map(report.cells, checks))
    )
    return report.conclude(arguments.output, "papers", [report.tally(checks)], report.failures_of(checks))


def mistry(names: tuple[str, ...], count: int, output: Path | None) -> tuple[list[Check], list[str]]:
    """The rows of Mistry 2008 on robots by name; with ``output``, figures there and paragraphs that show them."""
    checks: list[Check] = []
    notes: list[str] = []
    if solver_sets.broken():
        notes.append(f"Announced but not loading: {', '.join(solver_sets.broken())}.")
    with report.bar() as bar:
        task = bar.add_task("Mistry 2008", total=len(names) * (len(POINTWISE) + 1))
        for name in names:
            robot = robots.load(name)
            for text, module in POINTWISE.items():
                bar.update(task, description=f"Mistry 2008, {text} on {name}")
                few = module in (theorems, headline)
                checks += of_kind(module.checks(robot, max(5, count // 4) if few else count), "product")
                bar.advance(task)
            bar.update(task, description=f"Mistry 2008, closed loops on {name}")
            runs = integration.experiments(robot)
            periods = integration.PERIODS[: None if count >= 100 else -1]
            checks += of_kind(integration.checks(robot, runs, periods), "product")
            if output is not None and importlib.util.find_spec("matplotlib") is not None:
                figures = importlib.import_module("benchmarks.mistry2008.equations.figures")
                notes += [f"![{text}]({path.name})" for text, path in figures.experiments(runs, name, output)]
            bar.advance(task)
    return checks, notes


def sentis(percent: int, signs: bool, output: Path | None) -> tuple[list[Check], list[str]]:
    """The rows of Sentis 2012 at so many percent of the states; with ``output``, its figures there."""
    with report.bar() as bar:
        task = bar.add_task("Sentis 2012", total=None)
        checks = sentis2012.rows(progress=lambda text: bar.update(task, description=text), percent=percent, signs=signs)
        if output is None or importlib.util.find_spec("matplotlib") is None:
            return checks, []
        bar.update(task, description="Sentis 2012, figures")
        return checks, [f"![{path.stem}]({path.name})" for path in sentis2012.figures(output, percent)]
