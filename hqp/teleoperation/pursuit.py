"""A reference that goes after a moving target: without lag, with bounded speed and acceleration, without steps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Mask, Vec

from .spaces import Space

RATE = 40.0
"""Rate at which the reference closes in on its target, thrice [1/s]."""

BRAKING = 0.6
"""Share of the acceleration that is counted on for braking."""

STEP = 0.004
"""Longest step of the integration [s]."""


class Pursuit:
    """Value, velocity and acceleration of a reference that follows a target with known derivatives.

    jerk = 3 p (a* - a),    a* = a_d + p (u - v) held under the largest acceleration,
    u = v_d - s(e) held under the largest speed,    e = x - x_d,

    s = p e / 3 near the target, of a size of sqrt(2 b (|e| - e0/2)), from which it can still be braked at b, farther
    away.  Near the target that is (d/dt + p)^3 e = 0: a target that accelerates evenly is followed without lag.

    speeds, accelerations: of rows that are lengths [m/s, m/s^2] and of those that are angles [rad/s, rad/s^2].
    """

    def __init__(
        self, space: Space, start: Any, speeds: tuple[float, float], accelerations: tuple[float, float]
    ) -> None:
        k = space.minus(start, start).size
        turns = space.turns(k)
        self.value = start
        self.v, self.a = np.zeros(k), np.zeros(k)
        self._space = space
        self._parts: list[tuple[slice, float, float]] = [
            (_slice(rows), speed, most)
            for rows, speed, most in zip((~turns, turns), speeds, accelerations, strict=True)
            if rows.any()
        ]
        self.held_under = False
        """Whether the target was faster than the reference may be, in the latest step."""

    def step(self, dt: float, target: Any, speed: Vec, acceleration: Vec) -> None:
        """Go on for dt [s] towards where the target is after it, with its velocity and acceleration ``(k,)``."""
        count = max(1, math.ceil(dt / STEP - 1e-9))
        h = dt / count
        for i in range(count):
            left = (count - 1 - i) * h
            e = self._space.minus(self.value, target) + h * self.v + left * (speed - 0.5 * left * acceleration)
            self._step(h, e, speed - left * acceleration, acceleration)

    def stop(self, dt: float) -> None:
        """Go on for dt [s] and come to rest where that is soonest."""
        still = np.zeros_like(self.v)
        self.step(dt, self.value, still, still)

    def _step(self, h: float, e: Vec, speed: Vec, acceleration: Vec) -> None:
        """e, speed, acceleration: the error after the step as it goes on, and how the target moves then."""
        wanted = np.empty_like(e)
        self.held_under = False
        for part, most_speed, most in self._parts:
            off, braking = e[part], BRAKING * most
            far = math.sqrt(float(off @ off))
            near = braking * (3.0 / RATE) ** 2
            s = RATE / 3.0 if far <= near else math.sqrt(2.0 * braking * (far - 0.5 * near)) / far
            u = speed[part] - s * off
            fast = math.sqrt(float(u @ u))
            if fast > most_speed:
                u = (most_speed / fast) * u
                self.held_under = True
            a = acceleration[part] + RATE * (u - self.v[part] - h * self.a[part])
            size = math.sqrt(float(a @ a))
            wanted[part] = (most / size) * a if size > most else a
        new = self.a + (1.0 - math.exp(-3.0 * RATE * h)) * (wanted - self.a)
        v = self.v + 0.5 * h * (self.a + new)
        self.value = self._space.plus(self.value, 0.5 * h * (self.v + v))
        self.v, self.a = v, new


def _slice(rows: Mask) -> slice:
    found = np.flatnonzero(rows)
    return slice(int(found[0]), int(found[-1]) + 1)
