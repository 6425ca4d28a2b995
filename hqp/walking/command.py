"""The command `hqp walk`."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hqp.commands.arguments import add_output, add_robot, read_robot
from hqp.numbers import number
from hqp.walking.keys import HELP as KEYS
from hqp.walking.keys import Keys

if TYPE_CHECKING:
    from hqp.walking.walker import Walker

DESCRIPTION = f"""Simulate a biped that stands for 1 s, walks at the given velocity, and stops, on its estimated state.
With --view a browser shows it, and keys in the terminal steer it: {KEYS}.  With --output the model predicts the walk
without a simulation, and the command writes it as arrays."""

STAND = 1.0
"""Duration of standing before the walk [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    add_robot(parser, "--robot", default="talos")
    parser.add_argument(
        "--soles", nargs=2, metavar="FRAME", help="left and right; default: the catalogue's, or the lowest shapes"
    )
    parser.add_argument(
        "--rotors",
        type=float,
        metavar="I",
        help="reflected inertia of each motor whose file gives none [kg m^2]; default min(0.01, effort limit / 5000)",
    )
    for name, default, unit in (("forward", 0.2, "m/s"), ("left", 0.0, "m/s"), ("turn", 0.0, "rad/s")):
        parser.add_argument(f"--{name}", type=float, default=default, metavar="V", help=f"[{unit}], default {default}")
    parser.add_argument("--seconds", type=float, default=8.0, metavar="S", help="default 8; with --view until Ctrl-C")
    add_output(parser, "--output", "-o", metavar="FILE.npz", help="write q, v and contacts there")
    parser.add_argument("--fps", type=float, default=50.0, help="frames a second of the file, default 50")
    parser.add_argument("--view", action="store_true", help="show it in a browser, steered by keys")


def execute(arguments: argparse.Namespace) -> int:
    """Walk; returns 1 for a fall, and for a walk that the robot refuses."""
    from hqp.walking.walker import Walker

    number("walk", "seconds", arguments.seconds, 0.0, strict=True, unit="s")
    number("walk", "fps", arguments.fps, 0.0, strict=True, unit="1/s")
    robot, soles = _biped(arguments)
    walker = Walker(robot, soles=soles)
    wanted = arguments.forward, arguments.left, arguments.turn
    if arguments.output is not None:
        walker.go(*wanted)
        if not walker.walking:
            print(*walker.why, sep="\n")
            return 1
        motion = walker.plan(arguments.seconds, arguments.fps)
        motion.save(arguments.output)
        print(f"{motion}; written to {arguments.output}")
        return 0
    if not arguments.view:
        return _simulate(walker, wanted, arguments.seconds)
    from hqp.viewer.session_view import View

    with View(walker.session, title=f"{robot.name} walks") as view, Keys() as keys:
        print(f"{view.url}\n{KEYS}")
        view.open()
        due = time.perf_counter()

        def each(state: Any, tick: Any) -> None:
            nonlocal due
            view.show(state, tick)
            command = keys.command()
            if command is not None:
                walker.stop() if command == (0.0, 0.0, 0.0) else _go(walker, command)
            due = max(due + walker.dt, time.perf_counter())
            time.sleep(max(0.0, due - time.perf_counter()))

        with contextlib.suppress(KeyboardInterrupt):
            return _simulate(walker, None, float("inf"), each)
    return 0


def _biped(arguments: argparse.Namespace) -> tuple[Any, tuple[str, ...] | None]:
    """The robot, its base free, and the frames of its soles; None for those of the catalogue."""
    from hqp.robots.soles import feet

    if arguments.floating is None:
        arguments.floating = True
    robot = read_robot(arguments, rotors=True if arguments.rotors is None else arguments.rotors)
    if arguments.soles is not None:
        return robot, tuple(arguments.soles)
    if robot.landmarks.get("soles"):
        return robot, None
    robot, soles = feet(robot)
    print(f"soles of {robot.name}: left {soles[0]}, right {soles[1]}")
    return robot, soles


def _go(walker: Walker, wanted: tuple[float, ...]) -> None:
    """Walk at a velocity, and print the reasons of the walker."""
    walker.go(*wanted)
    print(*walker.why, sep="\n", end="\n" if walker.why else "")


def _simulate(
    walker: Walker, wanted: tuple[float, ...] | None, seconds: float, each: Callable[[Any, Any], None] | None = None
) -> int:
    from hqp.walking.course import Course

    robot, course = walker.robot, Course(walker)
    plant = course.plant
    stops, since, begun, refused = STAND + seconds, 0.0, False, False
    while plant.time < stops or walker.phase != "stand" or plant.time < since + STAND:
        if wanted is not None and not begun and plant.time >= STAND:
            _go(walker, wanted)
            begun, refused = True, not walker.walking
        elif begun and not refused and not walker.walking and plant.time < stops:
            print(*walker.why, sep="\n")
            refused = True
        if refused:
            stops = min(stops, plant.time)
        if plant.time >= stops:
            walker.stop()
        tick = course.step()
        if walker.event:
            since = plant.time
            x, y, _ = plant.com().round(2)
            capture = walker.capture_point.round(2)
            print(f"{plant.time:7.2f} s  {walker.phase:6}  CoM {x:5.2f} {y:5.2f}  capture point {capture}")
        if each is not None:
            each(course.state, tick)
        if course.fallen:
            print(f"{plant.time:7.2f} s  {robot.name} fell")
            return 1
    return int(refused)
