"""CBi under position servos in MuJoCo, target of the hand 1 m beyond reach."""

from __future__ import annotations

import numpy as np

from hqp.tasks import Position
from tests.scenes.calm.robots import subject
from tests.scenes.calm.scenes import DT, FORMULATIONS, default_stack, reach
from tests.scenes.calm.variants import Variant

COM = 0.01
"""Largest allowed CoM error [m]."""


def reaching(variant: Variant, seconds: float = 5.0) -> dict[str, float]:
    """CoM error, largest torque and tilt of the pelvis; commands are integrated and sent to stiff servos.

    Rows are evaluated at the measured state, the acceleration window stands around the last command.
    """
    from hqp.robots.on_mujoco import Plane, Plant

    who = subject("cbi")
    robot = who.robot
    stack = default_stack(who, "velocity", variant.limits)
    session = variant.of(stack, FORMULATIONS["velocity"]).session(robot, DT)
    plant = Plant(robot, actuation="position", terrain=Plane(friction=0.8))
    q, v = plant.reset()
    places = robot.positions(robot.actuated)
    assert places is not None  # CBi has no continuous joint
    command = q[places].copy()
    hand = stack.find("hand", Position)
    com = plant.com()[:2].copy()
    goal = plant.place(who.hands[0])[0] + (reach("cbi") + 1.0) * who.ahead
    ticks = round(seconds / DT)
    off, torque, jumps = np.zeros(ticks), np.zeros(ticks), np.zeros(ticks)
    last = np.zeros(len(robot.joint_names))
    for i in range(ticks):
        tick = session.step(robot.state(q, v), hand.at(goal))
        command = command + DT * tick.command
        plant.step(command, rate=tick.command, steps=round(DT / plant.timestep))
        q, v = plant.state()
        off[i] = np.linalg.norm(plant.com()[:2] - com)
        torque[i] = np.abs(plant.torque).max()
        jumps[i] = np.abs(tick.command - last).max()
        last = tick.command
    return {
        "com": float(off.max()),
        "torque": float(torque[ticks // 10 :].max()),
        "jump": float(jumps[1:].max()),
        "jump_p50": float(np.median(jumps)),
        "upright": float(q[2] / robot.home[2]),
    }
