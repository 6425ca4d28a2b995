"""Holding torques, for commands while no solution is usable (hqp/cpp/session/rest.hpp)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from hqp.arrays import Vec
from hqp.declare.robot import State

Holding: TypeAlias = Callable[[State], tuple[Vec, Vec]]
"""Holding torque in a state, and the inverse inertia of each motor, ``(n,)`` both; it may raise."""
