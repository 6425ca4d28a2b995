"""Targets of forces hold from their first tick, also in the first tick of a session and as elements switch."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, Stack
from hqp.tasks import (
    Com,
    ContactForce,
    FrictionCone,
    JointTorque,
    Orientation,
    PointContact,
    Position,
    UnilateralContact,
)


@pytest.mark.parametrize("seed", range(4))
def test_a_target_of_a_force_holds_at_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = hqp.robots.load("solo12")
    feet = robot.landmarks["feet"]
    held: list[Any] = [PointContact(frame=foot) for foot in feet]
    held += [f(contact=foot, **k) for foot in feet for f, k in ((UnilateralContact, {}), (FrictionCone, {"mu": 0.6}))]
    unload = ContactForce(contact=feet[0], components=("fz",), name="unload")
    extra = Position(frame=feet[0], axes="z", law=PD(10.0), name="extra")
    com, trunk = Com(law=PD(40.0)), Orientation(frame="base_link", law=PD(40.0))
    stack = Stack(Level(com, trunk), Level(unload), Level(extra), Level(JointTorque()), subject_to=held)
    session = hqp.Controller(stack, hqp.Torque(), deadline=math.inf, price=0).session(robot, 0.002)
    for k in range(12):
        given = float(rng.uniform(1.0, 6.0))
        presence = extra.off() if rng.random() < 0.5 else extra.at()
        tick = session.step(robot.state(robot.home), unload.at([given]), presence)
        found = session.program.contact_forces(tick.x)[feet[0]][2]  # type: ignore[attr-defined]
        assert found == pytest.approx(given, abs=1e-6), k
