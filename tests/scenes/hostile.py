"""Hostile commands of a policy, and joints that move alone as the model of their servos."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from hqp.robots import Robot
from hqp.tasks import JointCoupling

DT = 0.002
KINDS = ("positions", "velocities", "torques")


class Plant:
    """Joints of a robot by Pinocchio in four steps a period: the base held under gravity, or adrift without it.

    Servos act within the period, by an implicit step; drives of velocities are ideal.
    """

    def __init__(self, robot: Robot, kind: str, session: Any) -> None:
        self.robot, self.kind = robot, kind
        self.q, self.v = robot.home.copy(), np.zeros(robot.nv)
        self.servos, self.step = session.declared.servos(robot, DT), 0.25 * DT
        self.load = np.zeros(robot.actuated.size)
        """Torques beside the motors [N m]."""
        self._model = pin.Model(robot.model)
        kp, kd = self.servos.kp, self.servos.kd
        self._model.armature[robot.actuated] += self.step * (kd + self.step * kp)
        self._stands = robot.floating and not session.declared.free(robot)
        if self._stands:  # a base that nothing moves
            self._model.armature[:6] = 1e9
        elif robot.floating:
            self._model.gravity = pin.Motion.Zero()
        self._data = self._model.createData()
        rows = [one.jacobian(robot.past(robot.home)) for one in robot.couplings if isinstance(one, JointCoupling)]
        self._coupled = np.vstack([np.zeros((0, robot.nv)), *rows])
        """Rows C of the file's couplings, C v = 0."""

    def move(self, command: Any) -> None:
        robot, own = self.robot, self.robot.actuated
        if self.kind == "velocities":
            self.v = np.zeros(robot.nv)
            self.v[own] = command
            self.q = robot.integrate(self.q, self.v, DT)
            return
        for _ in range(4):
            tau, v = np.zeros(robot.nv), self.v[own]
            tau[own] = command
            if self.kind == "positions":
                angles = robot.past(self.q).angles[own]
                tau[own] = self.servos.torque(command, angles + self.step * v, v)
            tau[own] += self.load
            self.v = self.v + self.step * self._acceleration(tau)
            self.v[: 6 * self._stands] = 0.0
            self.q = pin.integrate(robot.model, self.q, self.step * self.v)

    def _acceleration(self, tau: Any) -> Any:
        """Acceleration with the couplings, by Gauss's principle."""
        free = pin.aba(self._model, self._data, self.q, self.v, tau)
        if not len(self._coupled):
            return free
        mobility = np.array(pin.computeMinverse(self._model, self._data, self.q))
        mobility = np.triu(mobility) + np.triu(mobility, 1).T
        C = self._coupled
        return free - mobility @ C.T @ np.linalg.solve(C @ mobility @ C.T, C @ free)


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
