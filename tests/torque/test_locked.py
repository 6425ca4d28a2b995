"""Torques of chains whose joints a contact locks: they stay below the weight."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import PD, Level, Stack
from hqp.declare.robot import Robot
from hqp.tasks import FixedContact, Position, Posture

LAW = PD(25.0, 10.0)


def chain(joints: int, seed: int, folder: Path) -> Robot:
    """Chain of drawn hinges without torque limits on a tilted base; file and robot have the same name."""
    rng = np.random.default_rng(seed)
    bodies = ""
    for i in range(joints):
        axis, place = rng.normal(size=3), rng.uniform(-0.3, 0.3, 3)
        bodies += (
            f'<body name="b{i}" pos="{place[0]} {place[1]} {place[2]}">'
            f'<joint name="j{i}" axis="{axis[0]} {axis[1]} {axis[2]}"/>'
            '<geom type="capsule" size="0.03" fromto="0 0 0 0.2 0 0" mass="1"/>'
        )
    bodies += '<site name="tip" pos="0.2 0 0"/>' + "</body>" * joints
    motors = "".join(f'<motor joint="j{i}"/>' for i in range(joints))
    tilt = rng.uniform(0.0, 60.0, 3)
    path = folder / f"chain{joints}_{seed}.xml"
    path.write_text(
        f'<mujoco><worldbody><body euler="{tilt[0]} {tilt[1]} {tilt[2]}">{bodies}</body></worldbody>'
        f"<actuator>{motors}</actuator></mujoco>",
        encoding="utf-8",
    )
    return hqp.robots.load(path)


@pytest.mark.parametrize("price", [hqp.Controller.price, 0.0], ids=["priced", "exact"])
@pytest.mark.parametrize("joints", [1, 3, 6, 8])
@pytest.mark.parametrize("seed", range(3))
def test_a_locked_chain_is_sent_no_more_than_it_weighs(joints: int, seed: int, price: Any, tmp_path: Path) -> None:
    robot = chain(joints, seed, tmp_path)
    weight = 9.81 * joints  # of links of 1 kg, with levers of at most 0.8 m each
    for held in {f"b{joints // 2}", "tip"}:
        point, posture = Position(frame=held, law=LAW, name="point"), Posture(law=LAW)
        stack = Stack(Level(point), Level(posture), subject_to=[FixedContact(frame=held)])
        session = hqp.Controller(stack, hqp.Torque(), deadline=np.inf, price=price).session(robot, 0.002, stuck=False)
        q, v = robot.home, np.zeros(robot.nv)
        state = robot.state(q)
        targets = point.at(point.value(state) + 0.05), posture.at(posture.value(state) + 0.1)
        for _ in range(5):
            tick = session.step(robot.state(q, v), *targets)
            q, v = tick.advance()
            accelerations = 4.0 * joints * 2.5  # of free joints: inertias of 4 kg m^2 at most, demand of 2.5 rad/s^2
            assert np.abs(tick.command).max() < 0.8 * joints * weight + accelerations, tick.command
        if held == "tip" and joints <= 6:
            assert np.abs(v).max() < 1e-9
