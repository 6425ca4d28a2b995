"""Rates of joints from noisy measurements and the motion that the last command causes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare.reference import numbers
from hqp.declare.robot import Robot
from hqp.kinds import require_robot
from hqp.numbers import number

NOISE = 0.12
"""Largest difference between an estimated rate and its measurement [rad/s], six times the noise of a good encoder."""


class RateObserver:
    """Rates of joints without their noise and without the lag of a low-pass filter, a Luenberger observer.

    A share s of the measured rate corrects the rate predicted from the last command and an acceleration a that no model
    knows, as that of a load or a soft contact:

        v = v+ + s (v_measured - v+),    a += s^2 / (2 period) (v_measured - v+),
        v+ = v + period (qdd(tau) + a),    s = 1 - exp(-bandwidth period),

    so a command changes from tick to tick by s times the noise times its gains.  The poles are those of a Butterworth
    filter.  The base's twist stays as measured.

    period [s].  bandwidth [1/s]: errors of v+, as after an impact, fade at this rate; above the gains of contacts, for
    stability.  most [rad/s, m/s]: largest difference between estimate and measurement.
    Raises DeclarationError for a bad period, bandwidth or difference.
    """

    def __init__(self, robot: Robot, period: float, *, bandwidth: float = 100.0, most: float = NOISE) -> None:
        require_robot("observer", robot)
        period = number("observer", "period", period, 0.0, strict=True, unit="s")
        bandwidth = number("observer", "bandwidth", bandwidth, 0.0, strict=True, unit="1/s")
        most = number("observer", "most", most, 0.0, strict=True, unit="rad/s", infinite=True)
        from hqp import _session  # a package without compiled parts imports this room

        self._nv: int = robot.nv
        columns = [int(column) for column in robot.actuated]
        self._native = _session.RateObserver(columns, robot.nv, math.exp(-bandwidth * period), most)

    def update(self, v: Vec, tick: Any = None) -> Vec:
        """The estimate ``(nv,)`` [rad/s, m/s] from measured rates; tick: the last one, None for the first.

        Call it before the robot's next state.  A tick without a solution predicts no change; rates that are not finite
        are returned as they are and forgotten.
        """
        if tick is None:
            self.forget()
        elif tick.solution is not None:
            self.expect(tick.advance()[1])
        return self.correct(v)

    def expect(self, v: Vec) -> None:
        """Predict the next rates ``(nv,)``, as ``update`` does by a tick."""
        self._native.expect(numbers("observer", "v", v, (self._nv,)))

    def correct(self, v: Vec) -> Vec:
        """The estimate ``(nv,)`` from measured rates and those predicted, measured ones if none are."""
        found = numbers("observer", "v", v, (self._nv,))
        if np.isfinite(found).all():
            self._native.update(found)
        return found

    def forget(self) -> None:
        """Predict nothing: the next estimate is as measured."""
        self._native.forget()
