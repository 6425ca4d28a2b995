"""Holding torques, for commands while no solution is usable (hqp/cpp/session/rest.hpp)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from hqp.arrays import Vec
from hqp.declare.robot import State

Holding: TypeAlias = Callable[[State], tuple[Vec, Vec]]
"""The torques of a state ``(n,)`` that hold gravity [N m] and momentum [N m s]; it may raise."""
