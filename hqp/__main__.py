"""The command `hqp`: list solvers and robots, compare a stack through solvers, and the packages' own commands."""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from hqp import __version__
from hqp.commands.arguments import add_output, add_robot, add_stack, read_robot, read_stack
from hqp.errors import HqpError

PACKAGES = {
    "view": ("hqp.viewer.command", "show a stack on a robot in a browser, with targets to drag"),
    "bench": ("hqp.lab.command", "run a stack in closed loop through solvers: time, accuracy, calm, as a report"),
    "sweep": ("hqp.sweep.command", "call a function at many cases"),
    "export": ("hqp.export.command", "export a stack on a robot to a file that C++ runs without Python"),
    "replay": (
        "hqp.recorder.command",
        "replay a session's flight recording: which solvers agree, which element limited which",
    ),
    "retarget": ("hqp.motion.command", "retarget recorded human motion to a robot: BVH, joint positions, SMPL-X"),
    "walk": (
        "hqp.walking.command",
        "walk with a biped in MuJoCo, steer it by keys in a browser, or write the walk as a reference motion",
    ),
}
"""Commands of a package of their own: a module with DESCRIPTION, add_arguments and execute; and its help text."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status, 2 for an error that hqp explains."""
    argv = sys.argv[1:] if argv is None else argv
    parser = _parser(argv)
    arguments = parser.parse_args(argv)
    if arguments.cmake_dir:
        print(Path(__file__).parent / "cmake")
        return 0
    if arguments.command is None:
        parser.print_help()
        return 0
    try:
        status = _command(arguments.command)(arguments)
        if sys.stdout is not None:  # closed: `hqp robots >&-`
            sys.stdout.flush()
        return status
    except HqpError as error:
        print(f"hqp: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # `hqp robots | head`: nobody reads on
        _discard_output()
        return 0
    except OSError as error:  # a file to read or write, a full disk
        reason = error.strerror or str(error)
        print(f"hqp: {reason if error.filename is None else f'{error.filename}: {reason}'}", file=sys.stderr)
        if error.errno == errno.ENOSPC:
            _discard_output()
        return 2


def _discard_output() -> None:
    """Leave no output to be written at the exit."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _command(name: str) -> Callable[[argparse.Namespace], int]:
    if name in PACKAGES:
        return importlib.import_module(PACKAGES[name][0]).execute  # type: ignore[no-any-return]
    return {
        "doctor": _doctor,
        "solvers": _solvers,
        "robots": _robots,
        "capsules": _capsules,
        "compare": _compare,
    }[name]


def _parser(argv: Sequence[str]) -> argparse.ArgumentParser:
    """All commands; a package that argv does not name has its help text only, because the rest needs its import."""
    parser = argparse.ArgumentParser(
        prog="hqp", description="Strict task priorities for floating-base robots: one stack of tasks, any solver."
    )
    parser.add_argument("--version", action="version", version=f"hqp {__version__}")
    parser.add_argument(
        "--cmake-dir", action="store_true", help="print the folder of the C++ parts for find_package(hqp)"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    doctor = commands.add_parser(
        "doctor", help="check versions, compiled parts, BLAS threads and optional packages, with a fix for each"
    )
    doctor.add_argument("--contributor", action="store_true", help="include packages for work on hqp itself")
    commands.add_parser("solvers", help="list the solvers: available, or how to install them")
    listed = commands.add_parser(
        "robots",
        help="list the robots that load by name, or report on one",
        description="Without a robot, list the names that load. With one, print what its file gave: what was read, "
        "assumed and left out (docs/file-elements.md).",
    )
    add_robot(listed, "robot", nargs="?")
    capsules = commands.add_parser(
        "capsules",
        help="fit capsules around the links of a robot and write them as TOML",
        description="Fit one or two capsules to the collision shapes of each link, for collision avoidance; "
        "robot.with_capsules(FILE) takes them.",
    )
    add_robot(capsules, "robot")
    add_output(capsules, "--output", help="default: ROBOT.capsules.toml")
    compare = commands.add_parser(
        "compare",
        help="compare solvers on a stack from a TOML file",
        description="Solve one stack with many solvers at states near the robot's home posture and compare "
        "residuals of each level, optimality and time against the 2 ms of a 500 Hz loop.",
    )
    add_stack(compare)
    compare.add_argument("--solvers", nargs="+", default="all", metavar="NAME", help="default: all available ones")
    compare.add_argument(
        "--price",
        choices=("exact", "default", "both"),
        default="exact",
        help="price on motion of levels (docs/calm.md)",
    )
    compare.add_argument("--format", choices=("table", "markdown", "csv", "json"), default="table")
    for name, (module, what) in PACKAGES.items():
        command = commands.add_parser(name, help=what)
        if name in argv:
            package = importlib.import_module(module)
            command.description = package.DESCRIPTION
            package.add_arguments(command)
    return parser


def _doctor(arguments: argparse.Namespace) -> int:
    """1 where something slows the control loop."""
    from hqp.commands.doctor import findings, table

    found = findings(arguments.contributor)
    print(table(found))
    return int(any(finding.slow for finding in found))


def _solvers(arguments: argparse.Namespace) -> int:
    from hqp import native
    from hqp.solvers import known

    for name, missing in known().items():
        text = native.describe() if name == "lexicographic" else "available"
        print(f"{name:20} {missing or text}")
    return 0


def _robots(arguments: argparse.Namespace) -> int:
    import warnings

    from hqp import robots
    from hqp.errors import ModelWarning
    from hqp.robots.report import report

    if arguments.robot is None:
        print("\n".join(robots.names()))
        return 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # the report has them
        print(report(read_robot(arguments)))
    return 0


def _capsules(arguments: argparse.Namespace) -> int:
    from pathlib import Path

    from hqp.robots import capsule_files, capsules

    robot = read_robot(arguments)
    found = capsules.fitted(robot)
    path = Path(arguments.output or f"{Path(arguments.robot).stem}.capsules.toml")
    path.write_text(capsule_files.text(robot, found))
    print(f"{path}: {len(found)} capsules")
    return 0


def _compare(arguments: argparse.Namespace) -> int:
    from hqp.comparison import compare

    stack, robot, formulation = read_stack(arguments)
    price = {"exact": 0, "default": None, "both": "both"}[arguments.price]
    result = compare(
        stack,
        robot,
        solvers=arguments.solvers,
        formulation=formulation,
        dt=arguments.dt,
        price=price,  # type: ignore[arg-type]
    )
    shown = {"table": result.__str__, "markdown": result.markdown, "csv": result.csv, "json": result.json}
    print(shown[arguments.format]())
    return 0


if __name__ == "__main__":
    sys.exit(main())
