"""The path of a foot in the air: smooth, to a goal that may move, then down until it finds the ground."""

from __future__ import annotations

import numpy as np

from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.walking.gait import check

RISE = 0.45
"""Share of the time after which the foot is highest."""

LEAD = 0.03
"""The foot is above its goal this long before it lands [s]."""

FOLLOWS = 0.06
"""A goal that moved is reached in no less [s]."""

HASTENS = 3.0
"""A foot that has not found the ground in time goes down faster and faster [m/s^2]."""


def quintic(x: Vec, v: Vec, a: Vec, goal: Vec, duration: float, after: float, rate: Vec) -> tuple[Vec, Vec, Vec]:
    """Position, velocity, acceleration ``(k,)`` each ``after`` [s] on the quintic from (x, v, a) to (goal, rate, 0).

    after is at most duration [s].
    """
    T, t = duration, min(after, duration)
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
    search: speed downwards at the goal, which grows after it, until ``depth`` below it [m/s, m].
    The path is twice continuously differentiable while the goal stays where it is; with a goal that moves
    (``retarget``) position, velocity and acceleration go on from what they were.  Raises DeclarationError for fields.
    """

    def __init__(
        self, start: Vec, goal: Vec, duration: float, height: float, *, search: float = 0.1, depth: float = 0.06
    ) -> None:
        check("swing", "duration", duration, 2.0 * LEAD, strict=True, unit="s")
        check("swing", "height", height, 0.0, unit="m")
        check("swing", "search", search, 0.0, unit="m/s")
        check("swing", "depth", depth, 0.0, unit="m")
        self.x = _four("start", start)
        self.goal = _four("goal", goal)
        self.v, self.a = np.zeros(4), np.zeros(4)
        self.duration, self.time, self.search, self.depth = duration, 0.0, search, depth
        self._moved = -FOLLOWS
        self._top = max(float(self.x[2]), float(self.goal[2])) + height

    def retarget(self, goal: Vec, fastest: float, dt: float) -> None:
        """Move the goal ``(4,)`` towards another one, by at most ``fastest`` dt [m/s, rad/s] each."""
        most = fastest * dt
        before = self.goal
        self.goal = before + np.clip(_four("goal", goal) - before, -most, most)
        if not np.array_equal(self.goal, before):
            self._moved = self.time

    @property
    def left(self) -> float:
        """Time until it is to land [s], negative afterwards."""
        return self.duration - self.time

    def step(self, dt: float) -> tuple[Vec, Vec, Vec]:
        """One tick on: (x, y, z, yaw), its velocity and acceleration, ``(4,)`` each."""
        level, still = [0, 1, 3], np.zeros(3)
        left = max(self.left - LEAD, self._moved + FOLLOWS - self.time)
        if left >= dt:
            x, v, a = quintic(self.x[level], self.v[level], self.a[level], self.goal[level], left, dt, still)
        else:
            x, v, a = self.goal[level], still, still
        z, vz, az = self._height(dt)
        self.time += dt
        for into, of_level, of_z in ((self.x, x, z), (self.v, v, vz), (self.a, a, az)):
            into[level], into[2] = of_level, of_z
        return self.x.copy(), self.v.copy(), self.a.copy()

    def _height(self, dt: float) -> tuple[float, float, float]:
        """z, its velocity and acceleration after dt: up to the top, down to the goal, and on."""
        up, left, down = RISE * self.duration - self.time, self.left, np.array([-self.search])
        now, top, goal = (self.x[2:3], self.v[2:3], self.a[2:3]), np.array([self._top]), self.goal[2:3]
        if up >= dt:
            found = quintic(*now, top, up, dt, np.zeros(1))
        elif up > 0.0:  # over the top within this tick
            found = quintic(top, np.zeros(1), np.zeros(1), goal, left - up, dt - up, down)
        elif left >= dt:
            found = quintic(*now, goal, left, dt, down)
        else:
            lowest, late = float(self.goal[2]) - self.depth, min(dt, dt - left)
            from_here, before = (float(goal[0]), -self.search) if left > 0.0 else (float(self.x[2]), float(self.v[2]))
            z = from_here + before * late - 0.5 * HASTENS * late * late
            return (z, before - HASTENS * late, -HASTENS) if z > lowest else (lowest, 0.0, 0.0)
        z, vz, az = (float(part[0]) for part in found)
        return z, vz, az


def _four(what: str, given: Vec) -> Vec:
    found = np.array(given, dtype=np.float64)
    if found.shape != (4,) or not np.isfinite(found).all():
        raise DeclarationError("swing", f"bad {what}", value=given, allowed="(x, y, z, yaw), finite")
    return found
