"""Stacks of five robots for comparison of files with Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import hqp
import hqp.tasks as t
from hqp import PD, Level, Stack
from tests.scenes.sentis2012 import HELD

ROBOTS = ("ur5", "cbi", "talos", "g1", "dreamer")

FORMULATIONS: dict[str, Callable[[], Any]] = {
    "velocity": hqp.Velocity,
    "acceleration": hqp.Acceleration,
    "torque": lambda: hqp.Torque(contact_law=PD(0.0, 40.0)),
}

Given = Callable[[int], tuple[hqp.Reference, ...]]


def scene(name: str, formulation: str = "velocity", price: float | None = None) -> tuple[hqp.Session, Given]:
    """A session without a deadline, because cut answers cannot be compared, and the references of its ticks."""
    robot = hqp.robots.load(name)
    marks = robot.landmarks
    points = marks.get("feet", ())  # of a quadruped, which moves its base
    own = marks.get("base", robot.frame_names[1:2]) if points else ()
    frame = (marks.get("palms") or marks.get("tools") or own or robot.frame_names[-1:])[-1]
    hand = t.Position(frame=frame, name="hand")
    feet: list[Any] = [t.FixedContact(frame=sole) for sole in marks.get("soles", ())]
    feet += [t.PointContact(frame=foot) for foot in points]
    balance = [t.Com(axes="xy", name="balance")] if feet else []
    held: list[hqp.Element] = [t.JointLimits(), *feet, *robot.couplings, *(HELD if name == "dreamer" else ())]
    if formulation == "torque":
        held += [t.FrictionCone(contact=foot.name, mu=0.7) for foot in feet]
        held += [t.UnilateralContact(contact=foot.name) for foot in feet]
    levels = [[hand, *balance], [t.Orientation(frame=frame, name="turn")], [t.Posture(name="posture")]]
    stack = Stack(*(Level(*level, price=price) for level in levels), subject_to=held)
    controller = hqp.Controller(stack, FORMULATIONS[formulation](), deadline=np.inf)
    start = robot.state(robot.home).position(frame)

    def given(i: int) -> tuple[hqp.Reference, ...]:
        if i % 50 > 44:
            return ()
        way = np.array((0.2, 0.15, 0.25)) * np.sin(0.02 * i + np.arange(3))
        rate = 10.0 * np.array((0.2, 0.15, 0.25)) * np.cos(0.02 * i + np.arange(3)) if i % 3 else None
        return (hand.at(start + (3.0 if i > 90 else 1.0) * way, velocity=rate),)

    return controller.session(robot, dt=0.002), given
