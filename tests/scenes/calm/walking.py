"""Torque control with all constraints of feet, and a hand target that moves one metre out of reach."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from hqp import Level, Stack
from hqp.declare.element import Element
from hqp.declare.reference import Reference
from hqp.tasks import (
    CenterOfPressure,
    Com,
    FrictionCone,
    JointLimits,
    Orientation,
    Position,
    Posture,
    TorqueLimits,
    UnilateralContact,
)
from tests.scenes.calm.robots import Subject, subject
from tests.scenes.calm.scenes import RADIUS, RATE, Scene, Targets, law, reach

FRICTION, LOAD = 0.3, 20.0
"""Friction coefficient; least force on each foot [N]."""

PACE = 0.5
"""Speed of the hand's target [m/s]."""

SOLES: Mapping[str, tuple[float, float, float, float]] = {
    "cbi": (-0.065, 0.18, -0.04, 0.04),
    "talos": (-0.1, 0.1, -0.06, 0.06),
    "g1": (-0.08, 0.08, -0.03, 0.03),
}
"""Rectangles that every foot of the robot covers (x_min, x_max, y_min, y_max) [m]."""


def walking(name: str, limits: Mapping[str, Any]) -> Scene:
    """Friction 0.3, centre of pressure, 20 N on each foot, torque and joint limits; the hand's target moves away."""
    who, of = subject(name), partial(law, "torque")
    hard: list[Element] = [*who.contacts, TorqueLimits(), JointLimits(**limits)]
    for contact in who.contacts:
        hard += [
            UnilateralContact(contact=contact.name, minimum=LOAD),
            FrictionCone(contact=contact.name, mu=FRICTION),
            CenterOfPressure(contact=contact.name, rectangle=SOLES[name]),
        ]
    hand = Position(frame=who.hands[0], law=of(5.0), name="hand")
    stack = Stack(
        Level(Com(axes="xy", law=of(5.0), name="com"), name="balance"),
        Level(hand, name="hand"),
        Level(Orientation(frame=who.base or "", law=of(2.0), name="base"), name="base"),
        Level(Posture(law=of(1.0)), name="posture"),
        subject_to=hard,
    )
    return Scene("walking hand", who, "torque", stack, _walk(name, who, hand), above=("com",))


def _walk(name: str, who: Subject, hand: Position) -> Targets:
    start, far = who.robot.state(who.robot.home).position(who.hands[0]), reach(name) + 1.0

    def at(t: float) -> tuple[Reference, ...]:
        sway = RADIUS * np.array((0.0, np.sin(RATE * t), 1.0 - np.cos(RATE * t)))
        return (hand.at(start + min(PACE * t, far) * who.ahead + sway),)

    return at
