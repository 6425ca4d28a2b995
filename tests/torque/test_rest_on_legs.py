"""Legged robots in MuJoCo stand through stops and bad states, also if their stack changes meanwhile."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD
from hqp.tasks import Position
from tests.scenes.changes import DT
from tests.scenes.changes import stack as stack_of

JUMP = 10.0
"""Largest change of a torque in a tick [N m]."""

STOP, RESUME = ("stop",), ("resume",)
Event = tuple[Any, ...]
EVENTS: dict[str, dict[int, Event]] = {
    "stopped in a change": {200: ("change", False, 0.2), 220: STOP, 320: RESUME},
    "changed at rest": {200: STOP, 220: ("change", False, 0.2), 320: RESUME},
    "changed twice at rest": {200: STOP, 220: ("change", False, 0.0), 240: ("change", True, 0.2), 320: RESUME},
    "blind in a change": {200: ("change", False, 0.2), 210: ("blind",), 215: ("change", True, 0.1), 230: ("sees",)},
    "changed blindly": {200: ("blind",), 205: ("change", False, 0.0), 215: ("change", True, 0.1), 230: ("sees",)},
}
"""Ticks of events; a change is to the stack with the hand or without it, in seconds."""


@pytest.mark.slow
@pytest.mark.parametrize("events", EVENTS)
@pytest.mark.parametrize("name", ["g1", "talos"])
def test_legs_stand(name: str, events: str) -> None:
    from hqp.robots.on_mujoco import Plant

    robot = hqp.robots.load(name)
    plant, whole = Plant(robot), stack_of(robot, "torque")
    hand = next(e for e in whole if isinstance(e, Position))
    stacks = {True: whole, False: whole.without(hand.name)}
    session = hqp.Controller(whole, hqp.Torque(contact_law=PD(0.0, 15.0)), deadline=np.inf).session(robot, DT)
    q, v = plant.reset(robot.home.copy())
    height, start = q[2], robot.state(q, v).position(hand.frame)
    commands, blind, rested = [], False, 0
    for k in range(800):
        event = EVENTS[events].get(k, ("",))
        if event[0] == "change":
            session.change(stacks[event[1]], over=event[2])
        elif event == STOP:
            session.stop("test")
        elif event == RESUME:
            session.resume()
        elif event[0]:
            blind = event[0] == "blind"
        goal = hand.at(start + np.array([0.1, 0.0, 0.05]) * min(1.0, k / 300))
        tick = session.step(
            robot.state(np.full_like(q, np.nan) if blind else q, v), *([goal] if hand.name in session else [])
        )
        rested += tick.held > 0
        commands.append(tick.command.copy())
        plant.step(tick.command, steps=round(DT / plant.timestep))
        q, v = plant.state()
        assert q[2] > 0.9 * height, f"{name} falls at tick {k}"
    assert rested >= 20
    assert np.abs(np.diff(commands, axis=0)).max() < JUMP
