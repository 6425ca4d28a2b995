"""A contact-aided invariant extended Kalman filter, to compare with (Hartley, Ghaffari, Eustice, Grizzle 2020).

The state is (R, v, p, d_1 ... d_n), base and feet; the error is right-invariant: its propagation does not depend on
the estimate.  Measured are the feet in the base's axes, by encoders, and the vertical, by the IMU.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.estimation.rotations import exponential, quaternion_of, rotation_of

GRAVITY, UP = np.array([0.0, 0.0, -9.81]), np.array([0.0, 0.0, 1.0])
GYRO, ACCELEROMETER, VERTICAL, FOOT, CREEP = 0.01, 0.05, 0.002, 2e-3, 0.01
"""Deviations: sensors [rad/s, m/s^2, rad], of a foot in the base's axes [m], of a standing foot's speed [m/s]."""

LANDED = 0.02
"""Time with or without load after which a foot counts as standing or not [s]."""


class InvariantFilter:
    """``update`` as FeetEstimator's; least_load [N], period [s], q ``(nq,)`` at the start."""

    def __init__(self, robot: Any, feet: Sequence[str], period: float, q: Vec, *, least_load: float) -> None:
        self.robot, self.feet, self.dt, self.least = robot.copy(), tuple(feet), period, least_load
        state = self.robot.state(q)
        self.R = rotation_of(q[3:7])
        self.x = np.array([np.zeros(3), q[:3], *(state.position(f) for f in self.feet)])  # v, p, d_1, ...
        self.P = 1e-6 * np.eye(3 * (1 + len(self.x)))
        self.stands, self.contrary = [True] * len(self.feet), [0.0] * len(self.feet)

    def update(self, q: Vec, v: Vec, specific_force: Vec, load: Vec) -> tuple[Vec, Vec]:
        """(q, v) with the estimated base."""
        dt, gyro = self.dt, v[3:6]
        self._predict(gyro, specific_force)
        found_q, found_v = np.array(q, dtype=np.float64), np.array(v, dtype=np.float64)
        found_q[:7] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
        state = self.robot.state(found_q)
        for i, frame in enumerate(self.feet):
            h = np.array(state.position(frame))
            loaded = bool(load[i] > self.least)
            self.contrary[i] = 0.0 if loaded == self.stands[i] else self.contrary[i] + dt
            if self.contrary[i] >= LANDED:
                self.stands[i], self.contrary[i] = loaded, 0.0
                self._place(i, h)
            if self.stands[i]:
                H = np.zeros((3, len(self.P)))
                H[:, 6:9], H[:, 9 + 3 * i : 12 + 3 * i] = np.eye(3), -np.eye(3)
                self._correct(H, self.R @ h + self.x[1] - self.x[2 + i], FOOT**2)
        H = np.zeros((3, len(self.P)))
        H[:, :3] = -cross(UP)
        self._correct(H, self.R @ rotation_of(q[3:7]).T @ UP - UP, VERTICAL**2)
        found_q[:3], found_q[3:7], found_v[:3] = self.x[1], quaternion_of(self.R), self.R.T @ self.x[0]
        return found_q, found_v

    def _predict(self, gyro: Vec, force: Vec) -> None:
        """Strapdown integration; the error's covariance by the adjoint of the state."""
        dt, R = self.dt, self.R
        acceleration = R @ force + GRAVITY
        adjoint = np.kron(np.eye(1 + len(self.x)), R)
        for k, column in enumerate(self.x):
            adjoint[3 + 3 * k : 6 + 3 * k, :3] = cross(column) @ R
        A = np.eye(len(self.P))
        A[3:6, :3], A[6:9, 3:6] = dt * cross(GRAVITY), dt * np.eye(3)
        A[6:9, :3] = 0.5 * dt * dt * cross(GRAVITY)
        creeps = [CREEP if stands else 1.0 for stands in self.stands]
        Q = np.repeat([GYRO**2, ACCELEROMETER**2, 0.0, *np.square(creeps)], 3) * dt * dt
        self.P = A @ self.P @ A.T + adjoint @ (Q[:, None] * adjoint.T)
        self.x[1] += dt * self.x[0] + 0.5 * dt * dt * acceleration
        self.x[0] += dt * acceleration
        self.R = R @ exponential(dt * gyro)

    def _place(self, i: int, h: Vec) -> None:
        """Reset a foot that landed or left to its place by the encoders, with the base's error and theirs."""
        own = slice(9 + 3 * i, 12 + 3 * i)
        self.x[2 + i] = self.x[1] + self.R @ h
        self.P[own, :] = self.P[6:9, :]
        self.P[:, own] = self.P[:, 6:9]
        self.P[own, own] = self.P[6:9, 6:9] + FOOT**2 * np.eye(3)

    def _correct(self, H: Mat, off: Vec, variance: float) -> None:
        """xi = K off, the state moved by exp(-xi)."""
        S = H @ self.P @ H.T + variance * np.eye(3)
        K = np.linalg.solve(S, H @ self.P).T
        xi = -(K @ off)
        turn = exponential(xi[:3])
        self.R = turn @ self.R
        self.x = self.x @ turn.T + xi[3:].reshape(-1, 3) @ (np.eye(3) + 0.5 * cross(xi[:3])).T
        kept = np.eye(len(self.P)) - K @ H
        self.P = kept @ self.P @ kept.T + variance * (K @ K.T)


def cross(a: Vec) -> Mat:
    """[a]x ``(3, 3)``."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
