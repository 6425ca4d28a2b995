"""Arguments that the subcommands of `hqp` share, and what they stand for."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hqp.formulation import Formulation
    from hqp.robot import Robot
    from hqp.stack import Stack

FORMULATIONS = ("velocity", "acceleration", "torque")


def add_stack(parser: argparse.ArgumentParser) -> None:
    """A stack's file, a robot, a formulation and a control period."""
    parser.add_argument("stack", metavar="STACK.toml", help="the stack, see docs/quickstart.md for the format")
    parser.add_argument("--robot", required=True, metavar="NAME", help="a name from `hqp robots`, a URDF or MJCF file")
    parser.add_argument("--formulation", choices=FORMULATIONS, default="velocity", help="default: velocity")
    parser.add_argument("--dt", type=float, default=0.002, metavar="S", help="control period [s], default 0.002")


def read_stack(arguments: argparse.Namespace) -> tuple[Stack, Robot, Formulation]:
    """The stack, robot and formulation that the arguments name; raises HqpError for what does not load."""
    from hqp import robots, serial

    return serial.load(arguments.stack), robots.load(arguments.robot), formulation(arguments.formulation)


def formulation(name: str) -> Formulation:
    """A formulation with its defaults, by name; contacts at torque level are fed back so that feet do not drift."""
    import hqp
    from hqp.law import PD

    if name == "torque":
        return hqp.Torque(contact_law=PD(0.0, 40.0))
    return hqp.Acceleration() if name == "acceleration" else hqp.Velocity()
