"""Coming to rest: commands of a session while no solution is usable (hqp/cpp/session/rest.hpp)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from hqp.arrays import Vec
from hqp.declare.robot import Robot, State
from hqp.declare.safety import Braking
from hqp.programs.envelope import native

Holding: TypeAlias = Callable[[State], tuple[Vec, Vec]]
"""Holding torque in a state, and the inverse inertia of each motor, ``(n,)`` both; it may raise."""

Start: TypeAlias = "tuple[Vec, Vec, Vec | None, Vec | None]"
"""Angles and v ``(nv,)`` of a state to come to rest from, and its Holding where that is known."""


class Rest:
    """Brings a robot to rest from the last good tick; answers: native, every number is finite."""

    def __init__(self, answers: Any, holding: Holding | None = None) -> None:
        self.answers, self._holding = answers, holding

    def start(self, state: State | None) -> Start | None:
        """Data of the last good state, None without one."""
        return None if state is None else (state.angles, state.v, *self._held(state))

    def _held(self, state: State) -> tuple[Vec | None, Vec | None]:
        if self._holding is None:
            return None, None
        try:
            return self._holding(state)
        except Exception:  # the cause of the failed tick, such as a user's element, may fail here as well
            return None, None


def slow_down(robot: Robot, braking: Braking, dt: float) -> Rest:
    """Velocity level: a common factor, so that contacts hold; joints stop at their limits."""
    limits = robot.lower.tolist(), robot.upper.tolist()
    return Rest(native.SlowDown(*limits, robot.actuated.tolist(), braking.deceleration, dt))


def brake(robot: Robot, braking: Braking, dt: float) -> Rest:
    """Acceleration level: against the velocity, estimated from the last good state on."""
    return Rest(native.Brake(robot.nv, robot.actuated.tolist(), braking.deceleration, dt))


def hold(robot: Robot, braking: Braking, dt: float, holding: Holding) -> Rest:
    """Torque level: holding torque with damping, within the effort limits."""
    limit, motors = robot.effort_limit[robot.actuated].tolist(), robot.actuated.tolist()
    return Rest(native.Hold(limit, motors, braking.damping, dt), holding)
