"""Points and rotations as another frame sees them: values, relative Jacobians and drifts.

A frame o with origin p_o and axes R turns with Omega = H omega_o: H = I for the frame itself, H = z h^T for its
heading, where h gives the rate of yaw.  A point x at d = x - p_o is seen at R^T d and moves with
R^T (dx/dt - dp_o/dt - Omega x d).
"""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.robot import Robot, State

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
    """One state as seen from a frame; computes what is asked for, readably.  The reference for the fast writers."""

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
        """Rate of the seen velocity at zero generalised acceleration, ``(3,)``.

        R^T (a - a_o - dOmega/dt x d - 2 Omega x dd/dt + Omega x (Omega x d)).
        """
        d, moving = point - self.origin, velocity - self.state.velocity(self.frame)[:3]
        turn, turn_rate = self._turning()
        apparent = drift - self.state.drift(self.frame)[:3] - np.cross(turn_rate, d)
        return self.rotation.T @ (apparent - 2.0 * np.cross(turn, moving) + np.cross(turn, np.cross(turn, d)))

    def turn_jacobian(self, J: Mat) -> Mat:
        """R^T (J - H J_omega) ``(3, nv)`` of a body with world angular Jacobian J."""
        return self.rotation.T @ (J - self.H @ self.state.jacobian(self.frame)[3:])

    def turn_drift(self, velocity: Vec, drift: Vec) -> Vec:
        """R^T (alpha - dOmega/dt - Omega x (omega - Omega)) ``(3,)``."""
        turn, turn_rate = self._turning()
        return self.rotation.T @ (drift - turn_rate - np.cross(turn, velocity - turn))

    def _turning(self) -> tuple[Vec, Vec]:
        """Omega and its rate at zero generalised acceleration."""
        omega, alpha = self.state.velocity(self.frame)[3:], self.state.drift(self.frame)[3:]
        turn = self.H @ omega
        if not self.heading:
            return turn, alpha
        x = self._x  # yaw rate = (x dy - y dx) / rho^2, differentiated once more
        dx = np.cross(omega, x)
        ddx = np.cross(alpha, x) + np.cross(omega, dx)
        rate = (x[0] * ddx[1] - x[1] * ddx[0] - 2.0 * turn[2] * (x[0] * dx[0] + x[1] * dx[1])) / self._square
        return turn, np.array([0.0, 0.0, rate])


class Observer:
    """A frame bound for the hot path: its axes as plain numbers, and the twist rows its motion carries."""

    def __init__(self, robot: Robot, frame: str, heading: bool = False) -> None:
        index = robot.frame(frame)
        self.position, self.rotation = robot.placement(index)
        self.support = robot.support(index)
        self.heading = heading

    def axes(self) -> tuple[Triple, Triple, Triple]:
        """World directions of the axes x, y, z."""
        (a, b, c), (d, e, f), (g, h, i) = self.rotation.tolist()
        if self.heading:
            c, s, _, _ = heading_axes((a, d, g))
            return (c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)
        return (a, d, g), (b, e, h), (c, f, i)

    def carried(self, flat: Vec, at: int, u: Triple, point: list[float]) -> None:
        """Write at ``flat[at:at+6]`` the row t with t X_o v = u . (dp_o/dt + Omega x d) for a point."""
        if not self.heading:
            moment_row(flat, at, u, point)
            return
        ux, uy, _ = u
        x, y, z = self.position.tolist()
        moment_row(flat, at, u, (x, y, z))
        (ax, _, _), (ay, _, _), (az, _, _) = self.rotation.tolist()
        _, _, _, (hx, hy, _) = heading_axes((ax, ay, az))
        lever = (point[0] - x) * uy - (point[1] - y) * ux
        flat[at + 3] += lever * hx
        flat[at + 4] += lever * hy
        flat[at + 5] += lever


def moment_row(flat: Vec, at: int, u: Triple, point: Triple | list[float]) -> None:
    """Write [u, p x u] at ``flat[at:at+6]``: times a world twist, the velocity along u of the body's point at p."""
    ux, uy, uz = u
    x, y, z = point
    flat[at] = ux
    flat[at + 1] = uy
    flat[at + 2] = uz
    flat[at + 3] = y * uz - z * uy
    flat[at + 4] = z * ux - x * uz
    flat[at + 5] = x * uy - y * ux
