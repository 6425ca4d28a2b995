"""Changes of stack in a closed loop: largest jump of the command and CPU time of a tick of the transition.

Events: add a hand, swap two levels, remove the hand; shift the CoM over a foot, release the other foot, load it again.
Every robot runs them at every level on the exact integrator, with transitions of 0.25 s and ticks of 2 ms.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import hqp
from benchmarks.reports import report
from tests.scenes.changes import EVENTS, LEVELS, ROBOTS, Change, measure

UNITS = {"velocity": "rad/s", "acceleration": "rad/s^2", "torque": "N m"}
MARK = "<!-- tables: python -m benchmarks changes --page docs/results/safety.md -->"
END = "<!-- end of tables -->"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS), metavar="ROBOT")
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=list(LEVELS))
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the tables into this page")


def run(arguments: argparse.Namespace) -> int:
    """Run, show, write; returns 1 if a change is not calm."""
    found = []
    for name in arguments.robots[:1] if arguments.quick else arguments.robots:
        robot = hqp.robots.load(name)
        for level in arguments.levels:
            for each in measure(robot, level):
                found.append(each)
                print(f"{name} {level} {each}", flush=True)
    text = tables(found)
    report.section(arguments.output, "changes", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    return 0 if all(each.calm for each in found) else 1


def tables(found: Sequence[Change]) -> str:
    """Jumps, and ticks of a transition in plain ticks, as Markdown."""
    head = f"| | {' | '.join(EVENTS)} |\n|---{'|---' * len(EVENTS)}|\n"

    def rows(cell: Callable[[Change], str]) -> str:
        lines = []
        for level in LEVELS:
            for name in dict.fromkeys(c.robot for c in found):
                mine = {c.event: cell(c) for c in found if (c.level, c.robot) == (level, name)}
                if mine:
                    cells = " | ".join(mine.get(event, "") for event in EVENTS)
                    lines.append(f"| {name}, {level} [{UNITS[level]}] | {cells} |")
        return "\n".join(lines)

    def jump(c: Change) -> str:
        worst = number(c.during)
        return f"{worst if c.calm else f'**{worst}**'} ({number(c.before)}; {number(c.abrupt)})"

    return (
        "Largest change of a command in one tick; in brackets: in the second before, and if the stack changes at"
        f" once:\n\n{head}{rows(jump)}\n\n"
        "Median CPU time of a tick of the transition. Unit: mean of a tick of the old stack before it and a tick of the"
        " new stack\nafter a change at once:\n\n"
        f"{head}{rows(lambda c: f'{c.ratio:.1f}')}\n"
    )


def number(value: float) -> str:
    """Two digits, and 0 for rounding."""
    return "0" if value < 1e-6 else f"{value:.2g}" if value < 10.0 else f"{value:.0f}"
