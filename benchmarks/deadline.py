"""Time and quality of torque ticks with contradictory constraints, with the default deadline and without.

The least loads of both feet exceed the robot's weight, hands are out of reach, kicks disturb the robot.  The last
command, clipped into the same box, is the measure of a tick that ends at its deadline.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import hqp
from benchmarks.reports import report
from tests.scenes.overloaded import Record, measure

ROBOTS = ("cbi", "talos", "g1")
MARK = "<!-- tables: python -m benchmarks deadline --page docs/results/safety.md -->"
END = "<!-- end of deadlines -->"


def row(found: Record) -> str:
    """A row of the table."""
    wall, cpu = 1e3 * np.array(found.wall), 1e3 * np.array(found.cpu)
    parts = [f"{np.median(cpu):.2f}", *(f"{np.percentile(x, 99.9):.2f}" for x in (cpu, wall)), f"{cpu.max():.1f}"]
    statuses = ", ".join(f"{name} {count}" for name, count in found.statuses.most_common())
    return f"| {found.robot}, {found.deadline} | {' | '.join(parts)} | {statuses} | {found.worse} |"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS), metavar="ROBOT")
    parser.add_argument("--ticks", type=int, default=20_000, help="of each loop (20000)")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table into this page")


def run(arguments: argparse.Namespace) -> int:
    """Run, show, write; returns 1 if a tick that ended at its deadline was worse than the last command."""
    head = "| | CPU median [ms] | CPU p99.9 | wall p99.9 | CPU worst | statuses | worse than the last command |"
    lines, worse = [head, "|---|---|---|---|---|---|---|"], 0
    for name in arguments.robots[:1] if arguments.quick else arguments.robots:
        robot = hqp.robots.load(name)
        for deadline in (None, np.inf):
            found = measure(robot, 1000 if arguments.quick else int(arguments.ticks), deadline)
            worse += found.worse
            lines.append(row(found))
            print(lines[-1], flush=True)
    text = "\n".join(lines) + "\n"
    report.section(arguments.output, "deadline", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    return int(worse > 0)
