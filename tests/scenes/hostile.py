"""Hostile commands of a policy, and joints that move alone as the model of their servos."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from hqp.robots import Robot

DT = 0.002
KINDS = ("positions", "velocities", "torques")


class Plant:
    """Joints that move alone, each by its servo and its inertia at home; the base is fixed."""

    def __init__(self, robot: Robot, kind: str, session: Any) -> None:
        self.robot, self.kind = robot, kind
        self.q, self.v = robot.home.copy(), np.zeros(robot.nv)
        self.servos = session.declared.servos(robot, DT)

    def move(self, command: Any) -> None:
        own, servos = self.robot.actuated, self.servos
        angles, v = self.robot.state(self.q).angles[own], self.v[own]
        if self.kind == "velocities":
            after = command
        elif self.kind == "torques":
            after = v + DT * command / servos.inertia
        else:
            after = servos.velocity(command, angles, v)
        self.v = np.zeros(self.robot.nv)
        self.v[own] = after
        self.q = self.robot.integrate(self.q, self.v, DT)


class Coupled(Plant):
    """Joints of a robot on a fixed base under gravity, by Pinocchio in four steps a period; the command are torques."""

    def move(self, command: Any) -> None:
        model, h = self.robot.model, 0.25 * DT
        data = model.createData()
        for _ in range(4):
            self.v = self.v + h * pin.aba(model, data, self.q, self.v, command)
            self.q = pin.integrate(model, self.q, h * self.v)


def hostile(rng: np.random.Generator, kind: str, robot: Robot, i: int) -> Any:
    """Random, saturated, alternating, huge, NaN, infinite, in stretches of 40 ticks."""
    n, own = robot.actuated.size, robot.actuated
    centre = robot.state(robot.home).angles[own] if kind == "positions" else np.zeros(n)
    width = {"positions": 2.0, "velocities": 30.0, "torques": 200.0}[kind]
    way = (i // 40) % 6
    if way == 0:
        return centre + width * rng.normal(size=n)
    if way == 1:
        return centre + width * np.sign(np.sin(np.arange(n) + i // 40))
    if way == 2:
        return centre + width * (-1.0) ** i
    if way == 3:
        return np.full(n, 1e300 * (-1.0) ** (i // 20))
    if way == 4:
        return np.where(rng.uniform(size=n) < 0.5, math.nan, centre + 0.1)
    return np.full(n, math.inf)
