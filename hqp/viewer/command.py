"""The command `hqp view`."""

from __future__ import annotations

import argparse
from pathlib import Path

from hqp.arguments import add_stack, read_robot, read_stack
from hqp.solvers import default

HELP = "see a stack on a robot in a browser, with targets to drag"
DESCRIPTION = """Run a stack on a robot that carries out every command exactly, and show it in a browser: drag the
targets and watch which level gives way to which.  A recording (.npz) is shown as it was."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    add_stack(parser)
    parser.add_argument("--solver", default="", metavar="NAME", help=f"default here: {default()}")
    parser.add_argument("--port", type=int, default=8080, help="of the page, default 8080, or the next that is free")
    parser.add_argument("--host", default="127.0.0.1", help="0.0.0.0 opens the page to the network, without a password")
    parser.add_argument("--seconds", type=float, metavar="S", help="stop after that long; default: on Ctrl-C")


def execute(arguments: argparse.Namespace) -> int:
    """Run until interrupted; returns the exit status."""
    from .run import run as run_loop
    from .session_view import View

    if Path(arguments.stack).suffix == ".npz":
        return _replay(arguments)
    stack, robot, formulation = read_stack(arguments)

    def tell(view: View) -> None:
        print(f"{stack}\non {robot.name}: open {view.url} (Ctrl-C ends)", flush=True)

    run_loop(
        stack,
        robot,
        formulation=formulation,
        solver=arguments.solver,
        dt=arguments.dt,
        host=arguments.host,
        port=arguments.port,
        seconds=arguments.seconds,
        started=tell,
    )
    return 0


def _replay(arguments: argparse.Namespace) -> int:
    from hqp.recorder import load

    from .replay import replay
    from .session_view import View

    recording, robot = load(arguments.stack), read_robot(arguments)

    def tell(view: View, left_out: int) -> None:
        rest = f"; {left_out} ticks of another stack are left out" if left_out else ""
        print(f"{recording}\nopen {view.url} (Ctrl-C ends){rest}", flush=True)

    replay(recording, robot, host=arguments.host, port=arguments.port, seconds=arguments.seconds, started=tell)
    return 0
