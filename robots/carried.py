"""Centres of mass and momenta of a robot with its loads: point masses on frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Mat, Vec

if TYPE_CHECKING:
    from hqp.declare.robot import Load

    from .state import State


def position(state: State, load: Load) -> Vec:
    """Position of the load, ``(3,)`` [m]."""
    return state.position(load[0]) + _arm(state, load)


def jacobian(state: State, load: Load) -> Mat:
    """Jacobian of its position, ``(3, nv)``."""
    J = state.jacobian(load[0])
    return np.asarray(J[:3] - _skew(_arm(state, load)) @ J[3:], dtype=np.float64)


def drift(state: State, load: Load) -> Vec:
    """dJ/dt v ``(3,)`` of its position."""
    a, turn, arm = state.drift(load[0]), _skew(state.velocity(load[0])[3:]), _arm(state, load)
    return np.asarray(a[:3] + _skew(a[3:]) @ arm + turn @ (turn @ arm), dtype=np.float64)


def mean(state: State, subtree: int, own: Vec, of: Callable[[State, Load], Vec]) -> Vec:
    """Mean by mass of a quantity of a subtree's own bodies and that of the loads on them."""
    model = state.robot.model
    mass = sum(model.inertias[j].mass for j in model.subtrees[subtree] if j > 0)
    total = mass * own
    for load in state.loads:
        if model.frames[state.robot.frame(load[0])].parentJoint in model.subtrees[subtree]:
            total = total + load[1] * of(state, load)
            mass += load[1]
    return np.asarray(total / mass, dtype=np.float64)


def momentum(state: State, A: Mat, rate: Vec) -> tuple[Mat, Vec]:
    """The centroidal momentum matrix ``(6, nv)`` and its dJ/dt v ``(6,)``, about the centre of mass with the loads."""
    loads, state.loads = state.loads, ()
    try:
        before = state.com()
    finally:
        state.loads = loads
    centre = state.com()
    found, drifts = A.copy(), rate.copy()
    parts = [(before, A[:3], rate[:3])]
    for load in loads:
        parts.append((position(state, load), load[1] * jacobian(state, load), load[1] * drift(state, load)))
        found[:3] += parts[-1][1]
        drifts[:3] += parts[-1][2]
    for point, J, a in parts:
        found[3:] += _skew(point - centre) @ J
        drifts[3:] += np.cross(point - centre, a)
    return found, drifts


def _arm(state: State, load: Load) -> Vec:
    return np.asarray(state.rotation(load[0]) @ load[2], dtype=np.float64)


def _skew(a: Vec) -> Mat:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
