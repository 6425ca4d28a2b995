"""The command `hqp view`."""

from __future__ import annotations

import argparse
import getpass
import os
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hqp.commands.arguments import add_stack, read_robot, read_stack
from hqp.solvers import default
from hqp.web.doors import LOOPBACK

if TYPE_CHECKING:
    from hqp.teleoperation import OperatorPage

    from .session_view import View

DESCRIPTION = """Run a stack on a robot that carries out every command exactly, and show it in a browser: drag the
targets and watch which level gives way to which.  A recording (.npz) is replayed."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    add_stack(parser)
    parser.add_argument("--solver", default="", metavar="NAME", help=f"default here: {default()}")
    parser.add_argument("--port", type=int, default=0, help="port of the page, or the next free one; default: any")
    parser.add_argument("--host", default=LOOPBACK, help="0.0.0.0 opens the page to the network (SECURITY.md)")
    parser.add_argument("--password", help="password for the page without its full address; - prompts for it")
    parser.add_argument("--no-browser", action="store_true", help="print the address of the page, open no browser")
    parser.add_argument(
        "--operator", action="store_true", help="serve a second page for a headset or a phone that moves the hands"
    )
    parser.add_argument("--seconds", type=float, metavar="S", help="stop after this time; default: on Ctrl-C")


def execute(arguments: argparse.Namespace) -> int:
    """Run until interrupted; returns the exit status."""
    if arguments.password == "-":
        arguments.password = getpass.getpass("password of the page: ")
    with warnings.catch_warnings():
        warnings.showwarning = _say  # type: ignore[assignment]
        return _replay(arguments) if Path(arguments.stack).suffix == ".npz" else _run(arguments)


def _run(arguments: argparse.Namespace) -> int:
    from .run import run as run_loop

    stack, robot, formulation = read_stack(arguments)
    run_loop(
        stack,
        robot,
        formulation=formulation,
        solver=arguments.solver,
        dt=arguments.dt,
        seconds=arguments.seconds,
        started=lambda view: _announce(view, f"{stack}\non {robot.name}", arguments),
        operator=_invite if arguments.operator else None,
        **_page(arguments),
    )
    return 0


def _invite(page: OperatorPage) -> None:
    print(f"operator: open {page.url} in the headset or phone", flush=True)


def _replay(arguments: argparse.Namespace) -> int:
    from hqp.recorder import load

    from .replay import replay

    recording, robot = load(arguments.stack), read_robot(arguments)

    def announce(view: View, left_out: int) -> None:
        rest = f"; {left_out} ticks of another stack are left out" if left_out else ""
        _announce(view, f"{recording}{rest}", arguments)

    replay(recording, robot, seconds=arguments.seconds, started=announce, **_page(arguments))
    return 0


def _page(arguments: argparse.Namespace) -> dict[str, Any]:
    return {"host": arguments.host, "port": arguments.port, "password": arguments.password}


def _announce(view: View, what: str, arguments: argparse.Namespace) -> None:
    """Print the content and address of the page, and open it."""
    print(f"{what}\nopen {view.url} (Ctrl-C ends)", flush=True)
    if view.elsewhere:
        print(f"from another machine: {view.elsewhere}", flush=True)
    if not arguments.no_browser and _has_display():
        view.open()


def _has_display() -> bool:
    """Return true if a browser opens in a window: without one Python takes browsers of the terminal."""
    return sys.platform in ("darwin", "win32") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")))


def _say(message: Warning | str, *_: object) -> None:
    print(f"hqp: {message}", file=sys.stderr)
