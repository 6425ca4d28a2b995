"""Wheels that bear no load: released from the controller's traction, and held at the speed at which they would roll."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare.robot import State
from hqp.tasks import TorqueLimits

MOTORS = "motors"
"""Name of the torque limits in a stack whose wheels may be released."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingLimits(TorqueLimits):
    """Bounds of all motors' torques that are set between ticks, ``(n_actuated,)`` [N m]."""

    lower: Vec
    upper: Vec

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("lower", "upper"):
            object.__setattr__(self, name, np.array(getattr(self, name)))

    def bounds(self, state: State) -> tuple[Vec, Vec]:
        """As set."""
        return self.lower, self.upper


class ReleasedWheels:
    """Takes wheels that bear less than ``least`` [N], or spin, from the controller, and gives them back.

    A wheel in the air answers the traction that is asked of it by spinning up, and throws the robot when it lands.  A
    released wheel's torque is bounded to what holds it at the rolling speed, so that the other motors make up for it;
    back on the ground its bounds widen to the motor's over BACK.  No tick is judged alone: rollers bounce.
    """

    OFF, ON, BACK = 0.01, 0.004, 0.02
    """For how long a load has to be missing, and to be there again; how long the bounds take to widen [s]."""
    SPINS, ROLLS = 0.3, 0.1
    """Beyond how much faster than rolling a wheel is released, and below how much it may come back [m/s]."""
    HELD = 30.0
    """Force at the rim for each m/s beyond rolling [N s/m]."""

    def __init__(self, robot: Any, limits: MovingLimits, least: float, period: float) -> None:
        self._limits, self._least, self._period = limits, least, period
        self._wheels = slice(robot.actuated.size - len(robot.wheels), None)
        self._most = limits.upper[self._wheels].copy()
        self._gain = self.HELD * np.array([wheel.radius for wheel in robot.wheels.values()])
        self._waited = np.zeros(len(robot.wheels))
        self._share = np.ones(len(robot.wheels))
        self.bearing = [True] * len(robot.wheels)
        """Which wheels are not released."""

    def update(self, loads: Vec, spinning: Vec) -> None:
        """Set the bounds for the next tick: loads ``(wheels,)`` [N], rims' speed beyond rolling ``(wheels,)`` [m/s]."""
        now, spin = np.array(self.bearing), np.abs(spinning)
        bears = np.where(
            now, (loads > self._least) & (spin < self.SPINS), (loads > 3.0 * self._least) & (spin < self.ROLLS)
        )
        self._waited = np.where(bears == now, 0.0, self._waited + self._period)
        now = np.where(self._waited > np.where(now, self.OFF, self.ON) - 1e-9, bears, now)
        self.bearing = now.tolist()
        self._share = np.where(now, np.minimum(self._share + self._period / self.BACK, 1.0), 0.0)
        held = -(1.0 - self._share) * np.minimum(np.maximum(self._gain * spinning, -self._most), self._most)
        self._limits.lower[self._wheels] = held - self._share * self._most
        self._limits.upper[self._wheels] = held + self._share * self._most
