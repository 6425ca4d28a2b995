"""Points and rotations relative to another frame: values, Jacobians and drifts.

A frame o with origin p_o and axes R turns with Omega = H omega_o: H = I for the frame itself, H = z h^T for its
heading, where h gives the rate of yaw.  A point x at d = x - p_o is at R^T d in it
and moves with R^T (dx/dt - dp_o/dt - Omega x d).
"""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.robot import State

UPRIGHT = 1e-3  # a frame whose x axis is nearer than this to the vertical [rad] has its heading rate held at the bound

Triple = tuple[float, float, float]


def skew(a: Vec) -> Mat:
    """[a]x ``(3, 3)`` with [a]x b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def heading_axes(x: Triple) -> tuple[float, float, float, Triple]:
    """Cosine and sine of yaw, horizontal length rho^2, and h with d yaw/dt = h . omega, of an x axis."""
    ax, ay, az = x
    square = ax * ax + ay * ay
    length = math.sqrt(square)
    c, s = (ax / length, ay / length) if length > 0.0 else (1.0, 0.0)
    square = max(square, UPRIGHT**2)
    return c, s, square, (-az * ax / square, -az * ay / square, 1.0)


class View:
    """One state relative to a frame, or to its heading; natively this is cpp/rows/relative_frame.hpp."""

    def __init__(self, state: State, frame: str, heading: bool = False) -> None:
        self.state, self.frame, self.heading = state, frame, heading
        self.origin = state.position(frame)
        self.rotation = state.rotation(frame)
        self.H: Mat = np.eye(3)
        if heading:
            self._x = self.rotation[:, 0].copy()
            c, s, self._square, h = heading_axes((self._x[0], self._x[1], self._x[2]))
            self.rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            self.H = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], h])

    def point(self, point: Vec) -> Vec:
        """R^T (x - p_o) ``(3,)``."""
        return self.rotation.T @ (point - self.origin)

    def point_jacobian(self, point: Vec, J: Mat) -> Mat:
        """R^T (J - J_o + [d]x H J_omega) ``(3, nv)`` of a point with world Jacobian J."""
        J_o = self.state.jacobian(self.frame)
        return self.rotation.T @ (J - J_o[:3] + skew(point - self.origin) @ (self.H @ J_o[3:]))

    def point_drift(self, point: Vec, velocity: Vec, drift: Vec) -> Vec:
        """Rate of the relative velocity at zero generalised acceleration, ``(3,)``.

        R^T (a - a_o - dOmega/dt x d - 2 Omega x dd/dt + Omega x (Omega x d)).
        """
        d, moving = point - self.origin, velocity - self.state.velocity(self.frame)[:3]
        turn, turn_rate = self._turning()
        apparent = drift - self.state.drift(self.frame)[:3] - skew(turn_rate) @ d
        return self.rotation.T @ (apparent - 2.0 * skew(turn) @ moving + skew(turn) @ skew(turn) @ d)

    def turn_jacobian(self, J: Mat) -> Mat:
        """R^T (J - H J_omega) ``(3, nv)`` of a body with world angular Jacobian J."""
        return self.rotation.T @ (J - self.H @ self.state.jacobian(self.frame)[3:])

    def turn_drift(self, velocity: Vec, drift: Vec) -> Vec:
        """R^T (alpha - dOmega/dt - Omega x (omega - Omega)) ``(3,)``."""
        turn, turn_rate = self._turning()
        return self.rotation.T @ (drift - turn_rate - skew(turn) @ (velocity - turn))

    def _turning(self) -> tuple[Vec, Vec]:
        """Omega and its rate at zero generalised acceleration."""
        omega, alpha = self.state.velocity(self.frame)[3:], self.state.drift(self.frame)[3:]
        turn = self.H @ omega
        if not self.heading:
            return turn, alpha
        x = self._x  # yaw rate = (x dy - y dx) / rho^2, differentiated once more
        dx = skew(omega) @ x
        ddx = skew(alpha) @ x + skew(omega) @ dx
        rate = (x[0] * ddx[1] - x[1] * ddx[0] - 2.0 * turn[2] * (x[0] * dx[0] + x[1] * dx[1])) / self._square
        return turn, np.array([0.0, 0.0, rate])
