"""Acceleration of coordinates that another controller moves, from their measured velocities."""

from __future__ import annotations

import numpy as np

from hqp.arrays import Index, Vec
from hqp.declare.robot import State

SLOW = 0.1
"""Time constant [s]: without it arms that shake a base follow their own shaking."""


class Acceleration:
    """a+ = a + min(dt / T, 1) ((v - v-) / dt - a) of these coordinates ``(k,)``, v- the velocity a tick before."""

    def __init__(self, columns: Index, dt: float) -> None:
        self._columns, self._dt = columns, dt
        self.begin()

    def begin(self) -> None:
        """Forget earlier velocities."""
        self._before: Vec | None = None
        self._now: Vec = np.zeros(self._columns.size)

    def update(self, state: State) -> Vec:
        """Return the acceleration [m/s^2, rad/s^2]; zero at first and without a valid state."""
        if not state.valid:
            self.begin()
            return self._now
        v = state.v[self._columns]
        if self._before is not None:
            self._now = self._now + min(self._dt / SLOW, 1.0) * ((v - self._before) / self._dt - self._now)
        self._before = v
        return self._now
