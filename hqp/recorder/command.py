"""`hqp replay`: solve a recording again with any solver."""

from __future__ import annotations

import argparse

DESCRIPTION = """Read a file of session.record(...), solve its ticks again with other solvers and tell which agree with
what was sent, and over time what was not met and why. Needs neither the robot nor the program that made the file."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The file, the solvers, and how densely."""
    parser.add_argument("file", metavar="FILE.npz", help="a recording")
    parser.add_argument("--solvers", nargs="+", default=["all"], metavar="NAME", help="default: all available ones")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only each N-th tick (1)")
    parser.add_argument(
        "--explain", type=int, metavar="COUNT", help="the explanation of the tick of that count instead"
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
            raise DeclarationError("replay", "no tick of that count", value=arguments.explain, allowed=allowed)
        print(tick.explain())
        return 0
    if arguments.every < 1:
        raise DeclarationError("replay", "--every", value=arguments.every, allowed="1 and more")
    found = replay(recording, "all" if arguments.solvers == ["all"] else arguments.solvers, arguments.every)
    print(found)
    return int(not any(line.solved and line.agreed == line.solved for line in found.lines))
