"""Coming to rest: what a session sends while no answer is usable."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from hqp.arrays import Vec
from hqp.loop.safety import Braking
from hqp.robot import Robot, State


class Rest(ABC):
    """Answers x that bring a robot to rest from the last good tick on; every number is finite."""

    @abstractmethod
    def begin(self, state: State | None, x: Vec, *, now: bool) -> None:
        """Start from the last good state, None where there was none, and the last x that was sent.

        now: whether the state is that of this tick, or of the one before, in which x was sent.
        """

    @abstractmethod
    def next(self) -> Vec:
        """x of the next tick."""


class SlowDown(Rest):
    """Velocity level: x shrinks by a common factor, so that J x = 0 of contacts stays true, and joints stop at limits.

    x+ = x max(0, 1 - a dt / max_i |x_i|) over the joints; a joint whose estimated position would pass its limit stops
    there.
    """

    def __init__(self, robot: Robot, braking: Braking, dt: float) -> None:
        self._step, self._dt = braking.deceleration * dt, dt
        self._low, self._high = robot.lower, robot.upper
        self._joints = robot.actuated
        self._x = self._angles = np.zeros(robot.nv)

    def begin(self, state: State | None, x: Vec, *, now: bool) -> None:
        """Start from the last good state and x."""
        self._x = np.zeros(x.size) if state is None else x.copy()
        if state is not None:
            self._angles = state.angles if now else state.angles + self._dt * x

    def next(self) -> Vec:
        """x of the next tick ``(nv,)``."""
        x = self._x
        joints = x[self._joints]
        fastest = float(np.abs(joints if joints.any() else x).max(initial=0.0))
        x *= max(0.0, 1.0 - self._step / fastest) if fastest > self._step else 0.0
        # the last way to a limit and no further; back from beyond a limit is not its business
        down = np.minimum((self._low - self._angles) / self._dt, 0.0)
        up = np.maximum((self._high - self._angles) / self._dt, 0.0)
        np.clip(x, down, up, out=x)
        self._angles += self._dt * x
        return x.copy()


class Brake(Rest):
    """Acceleration level: qdd = -v min(1 / dt, a / max_i |v_i|), v estimated from the last good state on."""

    def __init__(self, robot: Robot, braking: Braking, dt: float) -> None:
        self._most, self._dt, self._joints = braking.deceleration, dt, robot.actuated
        self._v: Vec = np.zeros(robot.nv)

    def begin(self, state: State | None, x: Vec, *, now: bool) -> None:
        """Start from the last good state and x."""
        self._v = np.zeros(x.size) if state is None else state.v + (0.0 if now else self._dt) * x

    def next(self) -> Vec:
        """x of the next tick ``(nv,)``."""
        v = self._v
        joints = v[self._joints]
        fastest = float(np.abs(joints if joints.any() else v).max(initial=0.0))
        x = -v * min(1.0 / self._dt, self._most / fastest if fastest > 0.0 else 0.0)
        self._v = v + self._dt * x
        return x
