"""Plausible misreadings of the paper as elements: absolute Jacobians, rolling along the axle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.robot import State
from hqp.tasks import Com, OmniWheelContact, Position


@dataclass(frozen=True, kw_only=True)
class RollingAlongAxle(OmniWheelContact):
    """The rolling row in the direction of the wheel's axle, as the paper words it below eq. (9)."""

    _picked: ClassVar[tuple[int, ...]] = (1, 2)


@dataclass(frozen=True, kw_only=True)
class AbsoluteCom(Com):
    """Com relative to a heading, with a Jacobian that omits the goal's motion."""

    def jacobian(self, state: State) -> Mat:
        return _heading(state, self.relative_to) @ state.com_jacobian(state.robot.subtree(str(self.subtree)))

    def drift(self, state: State) -> Vec:
        return _heading(state, self.relative_to) @ state.com_drift(state.robot.subtree(str(self.subtree)))


@dataclass(frozen=True, kw_only=True)
class AbsolutePosition(Position):
    """Position relative to a heading, with a Jacobian that omits the goal's motion."""

    def jacobian(self, state: State) -> Mat:
        return _heading(state, self.relative_to, 3) @ state.jacobian(self.frame)[:3]

    def drift(self, state: State) -> Vec:
        return _heading(state, self.relative_to, 3) @ state.drift(self.frame)[:3]


def _heading(state: State, frame: str | None, rows: int = 2) -> Mat:
    x = state.rotation(str(frame))[:, 0]
    length = math.hypot(x[0], x[1])
    c, s = x[0] / length, x[1] / length
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])[:rows]
