"""The path of a foot in the air: smooth, to a goal that may move, then down until it finds the ground."""

from __future__ import annotations

import math

import numpy as np

from hqp.angles import wrapped
from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.walking.gait import check

RISE = 0.45
"""Share of the swing time at the foot's highest point."""

SCUFF = 0.4
"""Share of the remaining time in which a scuffed foot rises again."""

LEAD = 0.03
"""Time before the landing at which the foot is above its goal [s]."""

FOLLOWS = 0.06
"""Shortest time to a moved goal [s]."""

HASTENS = 3.0
"""Downward acceleration of a foot without contact at its landing time [m/s^2]."""


State = tuple[float, float, float]
"""Position, velocity and acceleration along one axis."""


def quintic(start: State, goal: float, duration: float, after: float, rate: float = 0.0) -> State:
    """Position, velocity and acceleration ``after`` [s] on the quintic from ``start`` to (goal, rate, 0).

    after is at most duration [s].
    """
    (x, v, a), T, t = start, duration, min(after, duration)
    h, dv = goal - x - v * T - 0.5 * a * T * T, rate - v - a * T
    c3 = (20.0 * h - 8.0 * dv * T - a * T * T) / (2.0 * T**3)
    c4 = (-30.0 * h + 14.0 * dv * T + 2.0 * a * T * T) / (2.0 * T**4)
    c5 = (12.0 * h - 6.0 * dv * T - a * T * T) / (2.0 * T**5)
    return (
        x + t * (v + t * (0.5 * a + t * (c3 + t * (c4 + t * c5)))),
        v + t * (a + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5))),
        a + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5)),
    )


class Swing:
    """Position and yaw of a foot from lift-off to touch-down: each tick a polynomial from where it is to its goal.

    start, goal: (x, y, z, yaw) ``(4,)`` [m, rad].  duration [s].  height: above the higher of start and goal [m].
    search: speed downwards at the goal, which grows after it, until ``depth`` below it [m/s, m].  The foot takes the
    shorter turn to the yaw of its goal.  The path is twice continuously differentiable while the goal stays where it
    is; if the goal moves (``retarget``), position, velocity and acceleration stay continuous.
    Raises DeclarationError for fields.
    """

    def __init__(
        self, start: Vec, goal: Vec, duration: float, height: float, *, search: float = 0.1, depth: float = 0.06
    ) -> None:
        check("swing", "duration", duration, 2.0 * LEAD, strict=True, unit="s")
        check("swing", "height", height, 0.0, unit="m")
        check("swing", "search", search, 0.0, unit="m/s")
        check("swing", "depth", depth, 0.0, unit="m")
        self.x = _four("start", start)
        self.goal = self._seen("goal", goal, self.x)
        self.v, self.a = np.zeros(4), np.zeros(4)
        self.duration, self.time, self.search, self.depth = duration, 0.0, search, depth
        self._moved = -FOLLOWS
        self._peak, self._height_above = -math.inf, height
        self._top = max(float(self.x[2]), float(self.goal[2])) + height

    def retarget(self, goal: Vec, fastest: float, dt: float) -> None:
        """Move the goal ``(4,)`` towards another one, over ground, up and in yaw by at most ``fastest`` dt each."""
        most = fastest * dt
        off = self._seen("goal", goal, self.goal) - self.goal
        if off.any():
            off[:2] = within(off[:2], most)
            self.goal, self._moved = self.goal + np.append(off[:2], off[2:].clip(-most, most)), self.time

    def clear(self, z: float) -> None:
        """Rise again, from wherever the path is, to the swing's height above z [m]: the foot has scuffed there."""
        self._top = max(self._top, z + self._height_above)
        self._peak = max(self._peak, self.time + SCUFF * max(self.left - LEAD, 0.0))

    @staticmethod
    def _seen(what: str, given: Vec, before: Vec) -> Vec:
        """Checked, with the yaw within half a turn of that of ``before``."""
        found = _four(what, given)
        found[3] = before[3] + wrapped(float(found[3] - before[3]))
        return found

    @property
    def left(self) -> float:
        """Time until it is to land [s], negative afterwards."""
        return self.duration - self.time

    def step(self, dt: float) -> tuple[Vec, Vec, Vec]:
        """One tick on: (x, y, z, yaw), its velocity and acceleration, ``(4,)`` each."""
        left = max(self.left - LEAD, self._moved + FOLLOWS - self.time)
        x, y, z, yaw = zip(self.x.tolist(), self.v.tolist(), self.a.tolist(), strict=True)
        x_goal, y_goal, z_goal, yaw_goal = self.goal.tolist()
        level = (x, x_goal), (y, y_goal), (yaw, yaw_goal)
        x, y, yaw = (quintic(now, to, left, dt) if left >= dt else (to, 0.0, 0.0) for now, to in level)
        z = self._height(z, z_goal, dt)
        self.time += dt
        self.x, self.v, self.a = np.array([x, y, z, yaw]).T.copy()
        return self.x.copy(), self.v.copy(), self.a.copy()

    def _height(self, now: State, goal: float, dt: float) -> State:
        """z, its velocity and acceleration after dt: up to the top, down to the goal, and on."""
        up, left = max(RISE * self.duration, self._peak) - self.time, self.left
        if up >= dt:
            return quintic(now, self._top, up, dt)
        if up > 0.0:  # over the top within this tick
            return quintic((self._top, 0.0, 0.0), goal, left - up, dt - up, -self.search)
        if left >= dt:
            return quintic(now, goal, left, dt, -self.search)
        late = min(dt, dt - left)
        z, v = (goal, -self.search) if left > 0.0 else now[:2]
        z, lowest = z + v * late - 0.5 * HASTENS * late * late, goal - self.depth
        return (z, v - HASTENS * late, -HASTENS) if z > lowest else (lowest, 0.0, 0.0)


def within(x: Vec, length: float) -> Vec:
    """The vector, shortened to a length: bounds by axis would know the heading."""
    size = math.hypot(*x.tolist())
    return x if size <= length else x * (length / size)


def _four(what: str, given: Vec) -> Vec:
    found = np.array(given, dtype=np.float64)
    if found.shape != (4,) or not all(map(math.isfinite, found.tolist())):
        raise DeclarationError("swing", f"bad {what}", value=given, allowed="(x, y, z, yaw), finite")
    return found
