"""The control problem as a hierarchy in z = (qdd, f, tau), without elimination, built from Pinocchio alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from hqp import Hierarchy, Rows
from hqp.arrays import Mat, Vec
from hqp.robots import Robot

WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
NO_LIMIT = 1e30


@dataclass
class InverseDynamics:
    """Rows in z ``(nv + 6 feet + n,)``; f are wrenches of the ground on the feet in world axes at their frames."""

    robot: Robot
    q: Vec
    v: Vec
    feet: tuple[str, ...]

    def __post_init__(self) -> None:
        model = self.robot.model
        data: Any = model.createData()
        self.data = data
        pin.computeAllTerms(model, data, self.q, self.v)
        pin.centerOfMass(model, data, self.q, self.v, np.zeros(model.nv))
        pin.forwardKinematics(model, data, self.q, self.v, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        self.A = np.triu(data.M) + np.triu(data.M, 1).T
        self.bias = np.array(data.nle)
        self.nv, self.n, self.nf = model.nv, self.robot.actuated.size, 6 * len(self.feet)
        self.J = np.vstack([self.frame(f)[0] for f in self.feet])
        self.drift = np.concatenate([self.frame(f)[1] for f in self.feet])

    def frame(self, name: str) -> tuple[Mat, Vec]:
        """J ``(6, nv)`` and dJ/dt v ``(6,)``, world axes."""
        model, index = self.robot.model, self.robot.model.getFrameId(name)
        J = pin.computeFrameJacobian(model, model.createData(), self.q, index, WORLD)
        motion = pin.getFrameClassicalAcceleration(model, self.data, index, WORLD)
        return J, np.concatenate((motion.linear, motion.angular))

    def com(self) -> tuple[Mat, Vec]:
        """J ``(3, nv)`` and dJ/dt v of the centre of mass."""
        J = pin.jacobianCenterOfMass(self.robot.model, self.robot.model.createData(), self.q)
        return np.array(J), np.array(self.data.acom[0])

    def physics(self) -> Rows:
        """A qdd + b + g = U^T tau + J^T f and J qdd + dJ/dt v = 0."""
        motion = np.hstack((self.A, -self.J.T, -self.robot.actuation.T))
        still = np.hstack((self.J, np.zeros((self.nf, self.nf + self.n))))
        b = np.concatenate((-self.bias, -self.drift))
        # scaled so that newtons and accelerations have similar weights; the level is met exactly, its norm does not
        # matter
        scale = np.concatenate((1.0 / np.sqrt(np.diag(self.A)), np.ones(self.nf)))
        return Rows(np.vstack((motion, still)) * scale[:, None], b * scale, b * scale)

    def limits(self, mu: float, half: tuple[float, float]) -> Rows:
        """|tau| <= limit, eight-sided friction pyramids on level ground, centre of pressure in a rectangle."""
        rows, lower, upper = [], [], []
        limit = np.minimum(self.robot.effort_limit[self.robot.actuated], NO_LIMIT)
        for j in np.flatnonzero(limit < NO_LIMIT):
            row = np.zeros(self.nv + self.nf + self.n)
            row[self.nv + self.nf + j] = 1.0
            rows.append(row)
            lower.append(-limit[j])
            upper.append(limit[j])
        x, y = half
        for i, foot in enumerate(self.feet):
            R = on_level_ground(self.data.oMf[self.robot.model.getFrameId(foot)].rotation)
            local = np.zeros((6, self.nv + self.nf + self.n))
            at = self.nv + 6 * i
            local[:3, at : at + 3] = local[3:, at + 3 : at + 6] = R.T
            for k in range(8):
                b = np.pi / 8.0 + k * np.pi / 4.0
                rows.append(mu * np.cos(np.pi / 8.0) * local[2] - np.cos(b) * local[0] - np.sin(b) * local[1])
            rows += [x * local[2] + local[4], x * local[2] - local[4], y * local[2] + local[3], y * local[2] - local[3]]
            lower += [0.0] * 12
            upper += [np.inf] * 12
        return Rows(np.array(rows), np.array(lower), np.array(upper))

    def motion(self, *parts: tuple[Mat, Vec]) -> Rows:
        """A level of rows J qdd = d."""
        J = np.vstack([p[0] for p in parts])
        d = np.concatenate([p[1] for p in parts])
        return Rows(np.hstack((J, np.zeros((J.shape[0], self.nf + self.n)))), d, d)

    def hierarchy(self, limits: Rows | None, *levels: Rows) -> Hierarchy:
        """Physics, limits, then the levels of motion."""
        leading = (self.physics(),) if limits is None else (self.physics(), limits)
        return Hierarchy((*leading, *levels), constraints=len(leading))


def on_level_ground(rotation: Mat) -> Mat:
    """Axes of contact forces: x of the frame from above, y to its left, z up."""
    x = rotation[:, 0] * [1.0, 1.0, 0.0]
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross([0.0, 0.0, 1.0], x), [0.0, 0.0, 1.0]))
