"""Coming to rest: what a session sends while no answer is usable (hqp/cpp/session/rest.hpp)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from hqp.arrays import Vec
from hqp.declare.robot import Robot, State
from hqp.declare.safety import Braking
from hqp.programs.envelope import native

Holding: TypeAlias = Callable[[State], tuple[Vec, Vec]]
"""What holds the robot up in a state, and the inverse inertia that each motor feels, ``(n,)`` both; it may raise."""


class Rest:
    """Answers x that bring a robot to rest from the last good tick on; every number is finite."""

    def __init__(self, answers: Any, size: int, holding: Holding | None = None) -> None:
        self._answers, self._size, self._holding = answers, size, holding

    def begin(self, state: State | None, x: Vec, *, now: bool) -> None:
        """Start from the last good state, None where there was none, and the last x that was sent.

        now: whether the state is that of this tick, or of the one before, in which x was sent.
        """
        if state is None:
            self._answers.begin(None, None, None, None, x, now)
        else:
            self._answers.begin(state.angles, state.v, *self._held(state), x, now)

    def _held(self, state: State) -> tuple[Vec | None, Vec | None]:
        if self._holding is None:
            return None, None
        try:
            return self._holding(state)
        except Exception:  # whatever broke the tick, an element of the user's perhaps, may break this as well
            return None, None

    def next(self) -> Vec:
        """x of the next tick."""
        x = np.empty(self._size)
        self._answers.next(x)
        return x


def slow_down(robot: Robot, braking: Braking, dt: float) -> Rest:
    """Velocity level: a common factor, so that contacts hold; joints stop at their limits."""
    limits = robot.lower.tolist(), robot.upper.tolist()
    return Rest(native.SlowDown(*limits, robot.actuated.tolist(), braking.deceleration, dt), robot.nv)


def brake(robot: Robot, braking: Braking, dt: float) -> Rest:
    """Acceleration level: against the velocity, estimated from the last good state on."""
    return Rest(native.Brake(robot.nv, robot.actuated.tolist(), braking.deceleration, dt), robot.nv)


def hold(robot: Robot, braking: Braking, dt: float, holding: Holding) -> Rest:
    """Torque level: holding torque with damping, within the effort limits."""
    limit, motors = robot.effort_limit[robot.actuated].tolist(), robot.actuated.tolist()
    return Rest(native.Hold(limit, motors, braking.damping, dt), len(motors), holding)
