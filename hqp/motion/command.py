"""The command `hqp retarget`."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hqp.commands.arguments import add_output, add_robot, read_robot
from hqp.errors import DeclarationError

from .clip import UPS

if TYPE_CHECKING:
    from .retargeted import Retargeted

DESCRIPTION = """Retarget recorded human motion to a robot with a free base: standing feet do not slide, floor,
self-collision and limits hold, and a report lists unmet targets and the reason for each."""


class _Downwards(argparse.Action):
    """``-y`` behind ``--up``, which argparse takes for an option of its own."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        namespace.up = option_string


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    parser.add_argument(
        "motion", nargs="?", metavar="MOTION", help=".bvh, or .npz with joint positions or SMPL-X parameters"
    )
    add_robot(parser, "--robot", required=True)
    add_output(
        parser, "-o", "--output", action="append", default=[],
        help=".npz, .csv as Unitree and BeyondMimic read it, .pkl as GMR does; may be given more than once",
    )  # fmt: skip
    parser.add_argument("--map", metavar="MAP", help="a skeleton map's file or name; default: a shipped one that fits")
    parser.add_argument("--suggest-map", action="store_true", help="print a map for the robot, made from its tree")
    parser.add_argument("--contacts", default="auto", metavar="FILE", help=".npz with contacts (T, k); default: auto")
    parser.add_argument("--fps", type=float, help="of the result; default: the motion's own")
    parser.add_argument(
        "--up", nargs="?", choices=UPS, const="auto", default="auto", metavar="AXIS",
        help="axis of the file that is up: x, y, z, -x, -y or -z; default: auto, found from the person",
    )  # fmt: skip
    parser.add_argument("-x", "-y", "-z", dest="up", action=_Downwards, nargs=0, help=argparse.SUPPRESS)
    parser.add_argument("--body-model", type=Path, metavar="FILE", help="of SMPL-X, for its parameters: .npz")
    parser.add_argument(
        "--no-collision", action="store_true", help="leave out self-collision and the floor for other links"
    )
    parser.add_argument(
        "--dynamics", action="store_true", help="plan a CoM that flat soles can carry, and follow it above the hands"
    )
    add_output(parser, "--html", help="write the report as one page")
    parser.add_argument("--view", action="store_true", help="show it in a browser, the person beside the robot")
    parser.add_argument(
        "--seconds", type=float, metavar="S", help="with --view: stop after this time; default: on Ctrl-C"
    )
    parser.add_argument(
        "--no-browser", action="store_true", help="with --view: print the page's address, open no browser"
    )


def execute(arguments: argparse.Namespace) -> int:
    """Retarget, print the report, write the requested files."""
    from .retargeted import FORMATS
    from .retargeting import retarget

    robot = read_robot(arguments)
    if arguments.suggest_map:
        from .suggestion import suggest_map

        print(suggest_map(robot).toml(), end="")
        return 0
    if arguments.motion is None:
        raise DeclarationError("retarget", "no motion", allowed="a .bvh or .npz file")
    for path in arguments.output:
        if path.suffix.lower() not in FORMATS:
            raise DeclarationError("retarget", "unknown file type", value=str(path), allowed=", ".join(FORMATS))
    found = retarget(
        arguments.motion,
        robot,
        map=arguments.map,
        contacts=arguments.contacts,
        fps=arguments.fps,
        up=arguments.up,
        body_model=arguments.body_model,
        collision=not arguments.no_collision,
        dynamics=arguments.dynamics,
    )
    print(found)
    for path in arguments.output:
        print(f"written: {found.save(path)}")
    if arguments.html:
        print(f"report: {found.html(arguments.html)}")
    if arguments.view:
        _view(found, arguments)
    return 0


def _view(found: Retargeted, arguments: argparse.Namespace) -> None:
    page = found.view()
    print(f"open {page.url} (Ctrl-C ends)", flush=True)
    if not arguments.no_browser and sys.stdout.isatty():
        import webbrowser

        webbrowser.open(page.url)
    begin = time.monotonic()
    try:
        while arguments.seconds is None or time.monotonic() - begin < arguments.seconds:
            time.sleep(0.2)
    except KeyboardInterrupt:
        pass
    finally:
        page.close()
