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

    speeds, accelerations: limits of rows that are lengths [m/s, m/s^2] and of rows that are angles [rad/s, rad/s^2].
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
        """True if the target was faster than the reference may be, in the latest step."""

    def step(self, dt: float, target: Any, speed: Vec, acceleration: Vec) -> None:
        """Go on for dt [s] towards where the target is after it, with its velocity and acceleration ``(k,)``."""
        count = max(1, math.ceil(dt / STEP - 1e-9))
        h = dt / count
        for i in reversed(range(count)):
            e, u = self._space.minus(self.value, target) + h * self.v, speed
            if left := i * h:
                e, u = e + left * (speed - 0.5 * left * acceleration), speed - left * acceleration
            self._step(h, e, u, acceleration)

    def stop(self, dt: float) -> None:
        """Go on for dt [s] and come to rest where that is soonest."""
        still = np.zeros_like(self.v)
        self.step(dt, self.value, still, still)

    def _step(self, h: float, e: Vec, speed: Vec, acceleration: Vec) -> None:
        """e, speed, acceleration: the error after the step as it goes on, and how the target moves then."""
        off, speeds, known = e.tolist(), speed.tolist(), acceleration.tolist()
        v, a = self.v.tolist(), self.a.tolist()
        share, half = 1.0 - math.exp(-3.0 * RATE * h), 0.5 * h
        self.held_under = False
        for rows, most_speed, most in self._parts:
            far, braking = math.hypot(*off[rows]), BRAKING * most
            near = braking * (3.0 / RATE) ** 2
            s = RATE / 3.0 if far <= near else math.sqrt(2.0 * braking * (far - 0.5 * near)) / far
            u = [x - s * y for x, y in zip(speeds[rows], off[rows], strict=True)]
            fast = math.hypot(*u)
            if fast > most_speed:
                u = [most_speed / fast * x for x in u]
                self.held_under = True
            samples = zip(known[rows], u, v[rows], a[rows], strict=True)
            wanted = [x + RATE * (y - z - h * b) for x, y, z, b in samples]
            size = math.hypot(*wanted)
            cut = most / size if size > most else 1.0
            a[rows] = [b + share * (cut * x - b) for b, x in zip(a[rows], wanted, strict=True)]
        new = np.array(a)
        v_new = self.v + half * (self.a + new)
        self.value = self._space.plus(self.value, half * (self.v + v_new))
        self.v, self.a = v_new, new


def _slice(rows: Mask) -> slice:
    found = np.flatnonzero(rows)
    return slice(int(found[0]), int(found[-1]) + 1)
