"""Unloaded wheels: released from the controller's traction, and held at their rolling speed."""

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
        """Bounds as set."""
        return self.lower, self.upper


class ReleasedWheels:
    """Release wheels that bear less than ``least`` [N], or spin, from the controller, and return them.

    Traction spins up a wheel in the air, and the wheel throws the robot when it lands.  The bounds of a released
    wheel's torque hold it at the rolling speed, so that other motors compensate; on the ground its bounds widen to the
    motor's over BACK.  A release takes several ticks, because rollers bounce.
    """

    OFF, ON, BACK = 0.01, 0.004, 0.02
    """Time without load before a release, with load before the return, and of the bounds' widening [s]."""
    SPINS, ROLLS = 0.3, 0.1
    """Speed beyond rolling above which a wheel is released, and below which it may return [m/s]."""
    HELD = 30.0
    """Braking force at the rim per speed beyond rolling [N s/m]."""

    def __init__(self, robot: Any, limits: MovingLimits, least: float, period: float) -> None:
        self._limits, self._least, self._period = limits, least, period
        self._wheels = slice(robot.actuated.size - len(robot.wheels), None)
        self._most = limits.upper[self._wheels].copy()
        self._gain = self.HELD * np.array([wheel.radius for wheel in robot.wheels.values()])
        self._waited = np.zeros(len(robot.wheels))
        self._share = np.ones(len(robot.wheels))
        self.bearing = [True] * len(robot.wheels)
        """True for wheels that are not released."""

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
