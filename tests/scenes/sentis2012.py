"""Sentis, Petersen, Philippsen 2012, eqs. (48) to (59) as a stack: balance > hand > posture on wheels."""

from __future__ import annotations

from collections.abc import Sequence

from hqp import PD, Level, Stack
from hqp.declare.element import Element
from hqp.tasks import Com, JointCoupling, OmniWheelContact, Orientation, Position, Posture

WHEELS = ("wheel_0", "wheel_1", "wheel_2")
CONTACTS = tuple(OmniWheelContact(wheel=name) for name in WHEELS)
COUPLING = JointCoupling({"torso_hip": 1.0, "torso_thorax": -1.0}, name="biarticular")
HELD = (COUPLING, *CONTACTS)
"""Elements with a reaction force."""

COM = Com(axes="xy", subtree="torso_yaw", relative_to="base", heading=True, law=PD(400.0, 40.0), name="com")
HAND = Position(frame="hand", relative_to="base", heading=True, law=PD(30.0, 11.0), name="hand")
POSTURE = Posture(joints="upper_body", law=PD(100.0, 20.0))

EXACT = PD(0.0, 0.0)
"""Law of the biarticular coupling: J qdd + dJ/dt v = 0 without feedback (eq. 4)."""


def paper_stack(
    limits: Sequence[Element] = (),
    *,
    com: Com = COM,
    hand: Position = HAND,
    posture: Posture = POSTURE,
    yaw: Orientation | None = None,
    contacts: Sequence[OmniWheelContact] = CONTACTS,
) -> Stack:
    """Balance, hand, posture; ``yaw`` adds a level below balance that the paper does not have."""
    levels = [Level(com, name="balance"), Level(hand, name="hand"), Level(posture, name="posture")]
    if yaw is not None:
        levels.insert(1, Level(yaw, name="heading"))
    return Stack(*levels, subject_to=[COUPLING, *contacts, *limits])
