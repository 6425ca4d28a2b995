"""The command `hqp bench`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from hqp.commands.arguments import add_output, add_stack, read_stack
from hqp.solvers import default

if TYPE_CHECKING:
    from hqp.declare.robot import Robot
    from hqp.declare.stack import Stack

    from .result import Change

DESCRIPTION = """Run a stack in closed loop with each solver and measure times against the period, residuals and
certificates of every level, and how calm the commands are; write one page of HTML, Markdown, JSON or Parquet."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    from .plants import PLANTS
    from .trajectory import NAMED

    add_stack(parser)
    named = "; ".join(f"{name}: {text}" for name, text in NAMED.items())
    parser.add_argument(
        "--trajectory", default="circle", metavar="WHAT", help=f"FILE.csv, FILE.parquet, module:function, or {named}"
    )
    parser.add_argument(
        "--solvers", nargs="+", default=[default()], metavar="NAME", help=f"or all; default here: {default()}"
    )
    parser.add_argument("--plant", choices=PLANTS, default="integrator", help="default: integrator")
    parser.add_argument("--seconds", type=float, default=2.0, metavar="S", help="of each loop, default 2")
    for suffix, what in (("html", "one page with plots"), ("md", "Markdown"), ("json", "JSON"), ("parquet", "ticks")):
        add_output(parser, f"--{suffix}", help=f"write {what} there")
    parser.add_argument(
        "--rivals", nargs="+", metavar="NAME",
        help="compare with pink, mink, placo or tsid, each in its own environment",
    )  # fmt: skip
    parser.add_argument(
        "--scenes", choices=("teleop",),
        help="teleop: follow an operator's hand over a network, instead of a trajectory; with --rivals beside them",
    )  # fmt: skip
    parser.add_argument("--against", type=Path, metavar="OLD.json", help="compare with the JSON of an older run")


def execute(arguments: argparse.Namespace) -> int:
    """Run the loops, print the table, write the requested files; 1 if a solver has become slower than before."""
    from .closed_loop import bench

    stack, robot, formulation = read_stack(arguments)
    if arguments.rivals or arguments.scenes:
        return _rivals(arguments, stack, robot)
    solvers = "all" if arguments.solvers == ["all"] else arguments.solvers
    show, done = _progress()
    try:
        result = bench(
            stack,
            robot,
            trajectory=arguments.trajectory,
            solvers=solvers,
            formulation=formulation,
            dt=arguments.dt,
            seconds=arguments.seconds,
            plant=arguments.plant,
            progress=show,
        )
    finally:
        done()
    print(result)
    if arguments.json:
        arguments.json.write_text(result.json())
    if arguments.md:
        arguments.md.write_text(result.markdown())
    if arguments.parquet:
        result.parquet(arguments.parquet)
    changes: tuple[Change, ...] = ()
    try:  # the report is written, too, if the older run is of another kind
        changes = result.against(arguments.against) if arguments.against else ()
    finally:
        if arguments.html:
            print(f"report: {result.html(arguments.html, changes)}")
    for change in changes:
        print(f"{change.solver}: {change.verdict}, {change.ratio:.2f} times (noise {100.0 * change.noise:.0f} %)")
    return int(any(change.verdict == "slower" for change in changes))


def _rivals(arguments: argparse.Namespace, stack: Stack, robot: Robot) -> int:
    from .rivals import RivalTable, compare_rivals
    from .teleop import TeleopTable, compare_teleop

    def progress(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    result: RivalTable | TeleopTable
    if arguments.scenes:
        result = compare_teleop(stack, robot, arguments.rivals or (), dt=arguments.dt, progress=progress)
    else:
        result = compare_rivals(
            stack, robot, arguments.rivals, seconds=arguments.seconds, dt=arguments.dt, progress=progress
        )
    print(result)
    if arguments.json:
        arguments.json.write_text(result.json())
    if arguments.md:
        arguments.md.write_text(result.markdown())
    return 0


def _progress() -> tuple[Callable[[str, float], None], Callable[[], None]]:
    """A bar on standard error for each solver; nothing where that is no terminal."""
    if not sys.stderr.isatty():
        return (lambda name, share: None), (lambda: None)
    from rich.console import Console
    from rich.progress import Progress, TaskID

    bar = Progress(console=Console(stderr=True), transient=True)
    bar.start()
    tasks: dict[str, TaskID] = {}

    def show(name: str, share: float) -> None:
        if name not in tasks:
            tasks[name] = bar.add_task(name, total=1.0)
        bar.update(tasks[name], completed=share)

    return show, bar.stop
