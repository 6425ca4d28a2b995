"""Points and observing frames bound to live placements: what writers need of the kinematics, as plain numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from hqp.arrays import Vec
from hqp.robot import Placement, Robot, State

from .relative import UPRIGHT, Triple, heading_axes

Numbers = Sequence[float]


class Point:
    """A point fixed in a frame."""

    def __init__(self, robot: Robot, frame: str, offset: Triple = (0.0, 0.0, 0.0)) -> None:
        index = robot.frame(frame)
        self._frame, self._offset = frame, offset
        self._position, self._rotation = robot.placement(index)
        self.support = robot.support(index)
        self._off = any(offset)
        self.position: Callable[[], list[float]] = self._shifted if self._off else self._position.tolist

    def _arm(self) -> Triple:
        return turned(self._rotation.tolist(), self._offset)

    def _shifted(self) -> list[float]:
        x, y, z = self._position.tolist()
        a, b, c = self._arm()
        return [x + a, y + b, z + c]

    def velocity(self, state: State) -> Numbers:
        """World velocity ``(3,)`` [m/s]."""
        x, y, z, *omega = state.velocity(self._frame).tolist()
        if not self._off:
            return x, y, z
        a, b, c = cross(omega, self._arm())
        return x + a, y + b, z + c

    def drift(self, state: State) -> Numbers:
        """World acceleration ``(3,)`` at zero generalised acceleration [m/s^2]."""
        x, y, z, *alpha = state.drift(self._frame).tolist()
        if not self._off:
            return x, y, z
        arm, omega = self._arm(), state.velocity(self._frame)[3:].tolist()
        a, b, c = cross(alpha, arm)
        d, e, f = cross(omega, cross(omega, arm))
        return x + a + d, y + b + e, z + c + f


class Observer:
    """A frame, or its heading, from which others are seen; ``look`` first, once per tick.  Formulas in relative.py.

    axes: world directions of x, y, z.  position: world coordinates of the origin.
    """

    axes: tuple[Triple, Triple, Triple]
    position: list[float]

    def __init__(self, robot: Robot, frame: str, heading: bool = False) -> None:
        index = robot.frame(frame)
        self._frame, self._heading = frame, heading
        self._position, self.rotation = robot.placement(index)
        self.support = robot.support(index)
        self._x = self._h = (0.0, 0.0, 1.0)
        self._square = 1.0

    def look(self) -> None:
        """Read the placement of this tick."""
        self.position = self._position.tolist()
        (a, b, c), (d, e, f), (g, h, i) = self.rotation.tolist()
        if self._heading:
            self._x = (a, d, g)
            cos, sin, self._square, self._h = heading_axes(self._x)
            self.axes = (cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)
        else:
            self.axes = (a, d, g), (b, e, h), (c, f, i)

    def carried_row(self, flat: Vec, at: int, u: Triple, point: Numbers) -> None:
        """Write at ``flat[at:at+6]`` the row t with t X_o v = u . (dp_o/dt + Omega x d) for a world point."""
        if not self._heading:
            moment_row(flat, at, u, point)
            return
        ux, uy, uz = u
        x, y, z = self.position
        hx, hy, _ = self._h
        lever = (point[0] - x) * uy - (point[1] - y) * ux
        flat[at] = ux
        flat[at + 1] = uy
        flat[at + 2] = uz
        flat[at + 3] = y * uz - z * uy + lever * hx
        flat[at + 4] = z * ux - x * uz + lever * hy
        flat[at + 5] = x * uy - y * ux + lever

    def point_drift(self, state: State, point: Numbers, velocity: Numbers, drift: Numbers) -> Triple:
        """Drift of a world point as seen, along the axes."""
        vx, vy, vz, *omega = state.velocity(self._frame).tolist()
        ax, ay, az, *alpha = state.drift(self._frame).tolist()
        turn, turn_rate = self._turning(omega, alpha)
        x, y, z = self.position
        d = (point[0] - x, point[1] - y, point[2] - z)
        a, b, c = cross(turn_rate, d)
        e, f, g = cross(turn, cross(turn, d))
        i, j, k = cross(turn, (velocity[0] - vx, velocity[1] - vy, velocity[2] - vz))
        return self._along(
            drift[0] - ax - a - 2.0 * i + e, drift[1] - ay - b - 2.0 * j + f, drift[2] - az - c - 2.0 * k + g
        )

    def turn_drift(self, state: State, omega: Numbers, alpha: Numbers) -> Triple:
        """Drift of a body's angular velocity as seen, along the axes."""
        _, _, _, *own = state.velocity(self._frame).tolist()
        _, _, _, *own_alpha = state.drift(self._frame).tolist()
        turn, turn_rate = self._turning(own, own_alpha)
        a, b, c = cross(turn, (omega[0] - turn[0], omega[1] - turn[1], omega[2] - turn[2]))
        return self._along(alpha[0] - turn_rate[0] - a, alpha[1] - turn_rate[1] - b, alpha[2] - turn_rate[2] - c)

    def turn_velocity(self, state: State, omega: Numbers) -> Triple:
        """A body's angular velocity as seen, along the axes."""
        _, _, _, *own = state.velocity(self._frame).tolist()
        x, y, z = self._turning(own, own)[0]
        return self._along(omega[0] - x, omega[1] - y, omega[2] - z)

    def _along(self, x: float, y: float, z: float) -> Triple:
        (a, b, c), (d, e, f), (g, h, i) = self.axes
        return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z

    def _turning(self, omega: Numbers, alpha: Numbers) -> tuple[Numbers, Numbers]:
        """Omega and its rate."""
        if not self._heading:
            return omega, alpha
        hx, hy, _ = self._h
        rate = hx * omega[0] + hy * omega[1] + omega[2]
        x = self._x
        dx = cross(omega, x)
        a, b, _ = cross(alpha, x)
        c, d, _ = cross(omega, dx)
        turning = x[0] * (b + d) - x[1] * (a + c) - 2.0 * rate * (x[0] * dx[0] + x[1] * dx[1])
        return (0.0, 0.0, rate), (0.0, 0.0, turning / self._square)


class LiveFrame(NamedTuple):
    """A frame as native operations read it: live placement, its body and the coordinates that move it."""

    placement: Placement
    body: int
    columns: list[int]


class LiveObserver(NamedTuple):
    """A frame, or its heading, as native operations read an observer; upright: see UPRIGHT."""

    frame: LiveFrame
    heading: bool
    upright: float


def live_frame(robot: Robot, frame: str) -> LiveFrame:
    """The frame of that name; raises FrameNotFound."""
    index = robot.frame(frame)
    return LiveFrame(robot.placement(index), robot.body(index), np.flatnonzero(robot.support(index)).tolist())


def live_observer(robot: Robot, relative_to: str | None, heading: bool = False) -> LiveObserver | None:
    """The observer of that name, None for the world; raises FrameNotFound."""
    return None if relative_to is None else LiveObserver(live_frame(robot, relative_to), heading, UPRIGHT)


def live_view(robot: Robot, frame: str, relative_to: str | None = None, heading: bool = False) -> dict[str, Any]:
    """A frame and who sees it, as arguments of native operations; raises FrameNotFound.

    Coordinates that carry both move nothing that an observer sees, unless only its heading turns.
    """
    own, observer = live_frame(robot, frame), live_observer(robot, relative_to, heading)
    if observer is not None and not heading:
        other = observer.frame
        shared = {*own.columns} & {*other.columns}
        own, other = (f._replace(columns=[c for c in f.columns if c not in shared]) for f in (own, other))
        observer = observer._replace(frame=other)
    return {"frame": own, "observer": observer}


def turned(rows: list[list[float]], vector: Numbers) -> Triple:
    """R a, for the rows of R."""
    x, y, z = vector
    (a, b, c), (d, e, f), (g, h, i) = rows
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def cross(a: Numbers, b: Numbers) -> Triple:
    """a x b."""
    ax, ay, az = a
    bx, by, bz = b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def moment_row(flat: Vec, at: int, u: Triple, point: Numbers) -> None:
    """Write [u, p x u] at ``flat[at:at+6]``: times a world twist, the velocity along u of the body's point at p."""
    ux, uy, uz = u
    x, y, z = point
    flat[at] = ux
    flat[at + 1] = uy
    flat[at + 2] = uz
    flat[at + 3] = y * uz - z * uy
    flat[at + 4] = z * ux - x * uz
    flat[at + 5] = x * uy - y * ux
