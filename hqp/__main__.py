"""The command `hqp`: which solvers and robots are there, and one stack through many solvers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from hqp import __version__
from hqp.errors import HqpError


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status, 2 for an error that hqp explains."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    if arguments.command is None:
        parser.print_help()
        return 0
    commands: dict[str, Callable[[argparse.Namespace], int]]
    commands = {"solvers": _solvers, "robots": _robots, "compare": _compare, "sweep": _sweep}
    try:
        return commands[arguments.command](arguments)
    except HqpError as error:
        print(f"hqp: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="hqp", description="Strict task priorities for floating-base robots: one stack of tasks, any solver."
    )
    parser.add_argument("--version", action="version", version=f"hqp {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    commands.add_parser("solvers", help="list the solvers: available, or how to install them")
    commands.add_parser("robots", help="list the robots that load by name")
    compare = commands.add_parser(
        "compare",
        help="run a stack from a TOML file through solvers",
        description="Solve one stack with many solvers at states near the robot's home posture and compare "
        "residuals of each level, optimality and time against the 2 ms of a 500 Hz loop.",
    )
    compare.add_argument("stack", metavar="STACK.toml", help="the stack, see docs/quickstart.md for the format")
    compare.add_argument("--robot", required=True, metavar="NAME", help="a name from `hqp robots`, a URDF or MJCF file")
    compare.add_argument("--solvers", nargs="+", default="all", metavar="NAME", help="default: all available ones")
    compare.add_argument(
        "--formulation", choices=("velocity", "acceleration"), default="velocity", help="default: velocity"
    )
    compare.add_argument("--dt", type=float, default=0.002, metavar="S", help="control period [s], default 0.002")
    compare.add_argument("--format", choices=("table", "markdown", "csv", "json"), default="table")
    from hqp.sweep import command

    sweep = commands.add_parser("sweep", help="call a function at many cases", description=command.DESCRIPTION)
    command.add_arguments(sweep)
    return parser


def _solvers(arguments: argparse.Namespace) -> int:
    from hqp.solvers import known

    for name, missing in known().items():
        print(f"{name:20} {missing or 'available'}")
    return 0


def _robots(arguments: argparse.Namespace) -> int:
    from hqp import robots

    print("\n".join(robots.names()))
    return 0


def _compare(arguments: argparse.Namespace) -> int:
    from hqp import robots, serial
    from hqp.comparison import compare
    from hqp.formulation import Acceleration, Velocity

    formulation = Acceleration() if arguments.formulation == "acceleration" else Velocity()
    result = compare(
        serial.load(arguments.stack),
        robots.load(arguments.robot),
        solvers=arguments.solvers,
        formulation=formulation,
        dt=arguments.dt,
    )
    shown = {"table": result.__str__, "markdown": result.markdown, "csv": result.csv, "json": result.json}
    print(shown[arguments.format]())
    return 0


def _sweep(arguments: argparse.Namespace) -> int:
    from hqp.sweep.command import execute

    return execute(arguments)


if __name__ == "__main__":
    sys.exit(main())
