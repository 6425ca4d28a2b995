"""`hqp export`: write a stack on a robot as a plan file."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from hqp.commands.arguments import add_output, add_stack, read_stack

DESCRIPTION = """Compile a stack from a TOML file for a robot and write its plan file.  hqp::load in C++ and hqp.load in
Python load it without the robot's model."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options: stack, robot, path of the file."""
    add_stack(parser)
    parser.add_argument(
        "--deadline", type=float, metavar="S", help="deadline of a tick [s], 0 for none; default 0.8 dt"
    )
    parser.add_argument(
        "--max-age", type=float, metavar="S", help="largest age of a state [s]: steps then need its time"
    )
    parser.add_argument("--key", metavar="FILE", help="file with the key of the site, to sign the plan")
    add_output(parser, "--output", "-o", metavar="FILE.hqp", required=True, help="plan file to write")


def execute(arguments: argparse.Namespace) -> int:
    """Write the file; return 0."""
    from hqp import serial
    from hqp.loop.controller import Controller

    stack, robot, formulation = read_stack(arguments)
    deadline = None if arguments.deadline is None else arguments.deadline or math.inf
    session = Controller(stack, formulation, deadline=deadline).session(robot, arguments.dt, max_age=arguments.max_age)
    key = None if arguments.key is None else Path(arguments.key).read_bytes()
    session.export(arguments.output, serial.load_phases(arguments.stack), key=key)
    print(f"{arguments.output}: {len(tuple(session.stack))} elements on {robot.name}")
    return 0
