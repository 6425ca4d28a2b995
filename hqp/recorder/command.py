"""`hqp replay`: solve a recording again with any solver."""

from __future__ import annotations

import argparse

DESCRIPTION = """Read a file of session.record(...), solve its ticks again with other solvers, and report which solvers
agree with the sent commands, and over time which elements were not met and why.  Needs neither the robot nor the
program that made the file."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The file, the solvers, and how densely."""
    parser.add_argument("file", metavar="FILE.npz", help="a recording")
    parser.add_argument("--solvers", nargs="+", default=["all"], metavar="NAME", help="default: all available ones")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="replay every N-th tick (1)")
    parser.add_argument(
        "--explain", type=int, metavar="COUNT", help="print the explanation of the tick with this count instead"
    )


def execute(arguments: argparse.Namespace) -> int:
    """0; 1 where no solver agrees with the recording."""
    from hqp.errors import DeclarationError
    from hqp.recorder import load, replay

    recording = load(arguments.file)
    if arguments.explain is not None:
        tick = next((tick for tick in recording if tick.count == arguments.explain), None)
        if tick is None:
            allowed = f"{recording[0].count} to {recording[len(recording) - 1].count}"
            raise DeclarationError("replay", "no tick with this count", value=arguments.explain, allowed=allowed)
        print(tick.explain())
        return 0
    if arguments.every < 1:
        raise DeclarationError("replay", "--every", value=arguments.every, allowed="1 or above")
    found = replay(recording, "all" if arguments.solvers == ["all"] else arguments.solvers, arguments.every)
    print(found)
    return int(not any(line.solved and line.agreed == line.solved for line in found.lines))
