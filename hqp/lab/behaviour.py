"""Behaviour of the robot in a closed loop, from its states alone: equal figures for every solver and every library."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference
from hqp.declare.stack import Stack


@dataclass(frozen=True)
class Behaviour:
    """Tick by tick, from the state that the tick began with.

    tracked: elements with a reference; errors ``(k, tracked)``: their distance from it [m], or [rad] where they are no
    positions; NaN where the reference is not finite.  drift ``(k,)``: largest displacement of a contact since the start
    [m, rad].  over ``(k,)``: largest excess of a joint over its range [rad].  speeding ``(k,)``: over its speed
    limit [rad/s].
    """

    tracked: tuple[str, ...]
    errors: Mat
    drift: Vec
    over: Vec
    speeding: Vec


def behaviour(
    robot: Any, stack: Stack, trajectory: Callable[[float], tuple[Reference, ...]], q: Mat, v: Mat, dt: float
) -> Behaviour:
    """Judge states ``(k, nq)`` and velocities ``(k, nv)``, dt [s] apart, against the references of their time."""
    k = len(q)
    first = robot.state(q[0], v[0])
    elements: list[Any] = list(stack)
    contacts = [(e, e.value(first)) for e in elements if e.is_contact and e.equality and hasattr(e, "value")]
    tracked = tuple(r.name for r in trajectory(0.0) if r.value is not None)
    errors, drift = np.full((k, len(tracked)), np.nan), np.zeros(k)
    over, speeding = np.zeros(k), np.zeros(k)
    joints = [c for c in range(robot.nv) if np.isfinite(robot.lower[c]) or np.isfinite(robot.upper[c])]
    lower, upper = robot.lower[joints], robot.upper[joints]
    for i in range(k):
        if not (np.all(np.isfinite(q[i])) and np.all(np.isfinite(v[i]))):
            errors[i], drift[i], over[i], speeding[i] = np.inf, np.inf, np.inf, np.inf
            continue
        state = robot.state(q[i], v[i])
        for j, reference in enumerate(r for r in trajectory(i * dt) if r.name in tracked):
            element: Any = stack.find(reference.name)
            if reference.value is not None and np.all(np.isfinite(reference.value)):
                errors[i, j] = _length(element, element.error(state, reference.value))
        drift[i] = max((_largest(e.error(state, start)) for e, start in contacts), default=0.0)
        angles = state.angles[joints]
        over[i] = max(0.0, _largest(angles - upper, signed=True), _largest(lower - angles, signed=True))
        speeding[i] = max(0.0, _largest(np.abs(v[i]) - robot.velocity_limit, signed=True))
    return Behaviour(tracked, errors, drift, over, speeding)


def _length(element: Any, error: Vec) -> float:
    """Norm of an error; for a pose the part in metres."""
    metres = error[:3] if element.units[:1] == ("m",) and len(element.units) > 1 else error
    return float(np.sqrt(metres @ metres))


def _largest(values: Vec, signed: bool = False) -> float:
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return 0.0
    return float((finite if signed else np.abs(finite)).max())
