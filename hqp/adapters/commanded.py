"""Joints as commanded, in many worlds: targets of position servos, and states for the sessions."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.arrays import Mat


class Commanded:
    """Angles and rates of driven joints, integrated from commands.

    The base is measured, joints are as commanded: the lag of servos is no error of the stack.
    places, columns: indices of the driven joints in q and v.  order: 1 for velocity commands, 2 for accelerations.
    """

    def __init__(self, count: int, places: Any, columns: Any, order: int, dt: float) -> None:
        self._places, self._columns = np.asarray(places), np.asarray(columns)
        self._order, self._dt = order, dt
        self.angles, self.rates = (np.zeros((count, self._places.size)) for _ in range(2))

    def begin(self, worlds: Any, Q: Mat) -> None:
        """Start from the measured joints of these worlds, at rest."""
        self.angles[worlds] = Q[worlds][:, self._places]
        self.rates[worlds] = 0.0

    def seen(self, Q: Mat, V: Mat) -> tuple[Mat, Mat]:
        """Return measured states ``(count, nq)``, ``(count, nv)`` with the joints as commanded."""
        Q, V = Q.copy(), V.copy()
        Q[:, self._places], V[:, self._columns] = self.angles, self.rates
        return Q, V

    def take(self, commands: Mat, worlds: Any) -> None:
        """Carry out a command for a period in these worlds."""
        given = commands[worlds]
        self.rates[worlds] = given if self._order == 1 else self.rates[worlds] + self._dt * given
        self.angles[worlds] += self._dt * self.rates[worlds]
