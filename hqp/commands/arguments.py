"""Shared arguments of the subcommands of `hqp`, and their conversion."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hqp.errors import DeclarationError

if TYPE_CHECKING:
    from hqp.declare.robot import Robot
    from hqp.declare.stack import Stack
    from hqp.programs.formulation import Formulation

FORMULATIONS = ("velocity", "acceleration", "torque")


def add_stack(parser: argparse.ArgumentParser) -> None:
    """A stack's file, a robot, a formulation and a control period."""
    parser.add_argument("stack", metavar="STACK.toml", help="the stack, see docs/quickstart.md for the format")
    add_robot(parser, "--robot", required=True)
    parser.add_argument("--formulation", choices=FORMULATIONS, default="velocity", help="default: velocity")
    parser.add_argument("--dt", type=float, default=0.002, metavar="S", help="control period [s], default 0.002")


def add_robot(parser: argparse.ArgumentParser, name: str, **given: Any) -> None:
    """A robot under the name of an argument, ``robot`` or ``--robot``, and whether its base is free."""
    parser.add_argument(name, metavar="ROBOT", help="a name from `hqp robots`, a URDF or MJCF file", **given)
    base = parser.add_mutually_exclusive_group()
    base.add_argument("--floating", action="store_true", default=None, help="a free base; default: as in the file")
    base.add_argument(
        "--fixed", action="store_false", dest="floating", help="a fixed base, the default for a URDF file"
    )
    parser.add_argument(
        "--home",
        metavar="Q",
        help="start configuration: its name in the file, or one number per joint, 0,0.5,1 [rad, m]",
    )


def add_output(parser: argparse.ArgumentParser, *names: str, **given: Any) -> None:
    """Add the path of a file to write; one that cannot be written is refused before the work begins."""
    parser.add_argument(*names, type=_output, **{"metavar": "FILE", **given})


def _output(text: str) -> Path:
    path = Path(text)
    if path.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is a folder: give a file")
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"no folder {path.parent}: create it first")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise argparse.ArgumentTypeError(f"no permission to write {text}")
    return path


def read_robot(arguments: argparse.Namespace, rotors: bool | float = False) -> Robot:
    """The robot that the arguments name; raises HqpError if it does not load."""
    from hqp import robots

    robot = robots.load(arguments.robot, floating=arguments.floating, rotors=rotors)
    if arguments.home:
        robot.set_home(robot.configuration(_angles(arguments.home, robot)))
    return robot


def _angles(text: str, robot: Robot) -> Any:
    """The name of a configuration, or angles ``(nv,)`` of numbers for all joints but a free base."""
    try:
        numbers = [float(number) for number in text.split(",")]
    except ValueError:
        return text
    if len(numbers) != len(robot.actuated):
        allowed = f"{len(robot.actuated)} numbers, for {', '.join(robot.joint_names)}"
        raise DeclarationError("--home", f"{len(numbers)} numbers", value=text, allowed=allowed)
    angles = robot.state().angles.copy()
    angles[list(robot.actuated)] = numbers
    return angles


def read_stack(arguments: argparse.Namespace) -> tuple[Stack, Robot, Formulation]:
    """The stack, robot and formulation that the arguments name; raises HqpError if one does not load."""
    from hqp import serial

    return serial.load(arguments.stack), read_robot(arguments), formulation(arguments.formulation)


def formulation(name: str) -> Formulation:
    """A formulation with its defaults, by name; contacts at torque level are fed back so that feet do not drift."""
    import hqp
    from hqp.declare.law import PD

    if name == "torque":
        return hqp.Torque(contact_law=PD(0.0, 40.0))
    return hqp.Acceleration() if name == "acceleration" else hqp.Velocity()
