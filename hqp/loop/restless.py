"""Limits of joints among the rows of a program (hqp/cpp/session/limit_watch.hpp counts how often they alternate)."""

from __future__ import annotations

from hqp.arrays import Mask
from hqp.declare.robot import Robot
from hqp.loop.soundness import twin_of
from hqp.programs.formulation import Program


def turning(robot: Robot) -> Mask:
    """Mask ``(nv,)`` of the coordinates that turn; the others slide."""
    with twin_of(robot) as twin:
        twin.state(twin.home).kinematics()
        found: Mask = (twin.joint_twists[3:] != 0.0).any(axis=0)
    return found


def units_of(program: Program, robot: Robot) -> dict[str, list[str]]:
    """Unit of each row's joint, by the name of elements with rows that limit joints."""
    found: dict[str, list[str]] = {}
    turns = turning(robot)
    for name, place in program.places.items():
        element = place.element
        picked = None if element.equality else element.selection(robot)
        if picked is not None and len(element.row_names(robot)) == place.part.stop - place.part.start:
            found[name] = ["rad" if turn else "m" for turn in turns[picked].tolist()]
    return found
