"""Whether constraints hold more than joints can follow: rows that depend on each other where they are met."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack

STEP = 0.05
"""How far from home the largest coordinate goes, along what the rows leave free there [m, rad]."""

STEPS = 12
"""Of Newton's method; where it nears a double root each step halves the way that is left."""

LOST = 1e-4
"""A singular value below this, relative to the largest, is none."""

PART = 0.1
"""Share of the dependent combinations of rows from which an element takes part in them."""


def overconstrained(stack: Stack, twin: Robot) -> str:
    """What is said where rows of ``subject_to`` depend on each other at home and wherever they are met, but not beside.

    They leave directions free that break them to second order, as two flat feet on legs of five joints do: no robot
    goes there, and what it is off by decides which way commands go.  twin: of the robot, to be moved.
    """
    out = stack.out_of(None)
    held = [e for e in stack.subject_to if e.equality and e.quantity == "motion" and e.name not in out]
    try:
        return _told(held, twin) if held else ""
    except Exception:  # a user's own element: what it does wrong is told by the tick
        return ""


def _told(held: Sequence[Any], twin: Robot) -> str:
    home = twin.state(twin.home)
    holds = [element.hold(home).value for element in held]
    J = _rows(held, home, holds)[0]
    rank = _rank(J)
    if rank == J.shape[0]:
        return ""
    free = np.linalg.svd(J)[2][rank:]
    for k in (1, 2):
        direction = _scattered(free.shape[0], k) @ free
        q = twin.integrate(twin.home, STEP * direction / np.abs(direction).max(), 1.0)
        apart, met = _rank(_rows(held, twin.state(q), holds)[0]), _met(held, twin, holds, q)
        if apart <= _rank(met):
            return ""
    U, values, _ = np.linalg.svd(met)
    lost = U[:, np.append(values, np.zeros(U.shape[0] - values.size)) <= LOST * values[0]]
    ends = np.cumsum([element.rows(twin) for element in held])[:-1]
    shares = [float(np.linalg.norm(part)) for part in np.split(lost, ends)]
    names = [element.name for element, share in zip(held, shares, strict=True) if share > PART]
    return (
        f"{', '.join(names)}: more is held than joints can follow. {rank} of {J.shape[0]} rows are independent, and "
        "motion that keeps these soon breaks the others, so that commands alternate. Hold less: an EdgeContact or a "
        "PointContact in place of one, or one contact fewer"
    )


def _scattered(n: int, k: int) -> Vec:
    """So many numbers from -1 to 1 without a pattern, the same ones every time."""
    return np.asarray(np.cos(k * np.arange(1.0, n + 1.0) ** 2))


def _met(held: Sequence[Any], twin: Robot, holds: Sequence[Any], q: Vec) -> Mat:
    """The Jacobian where the rows are met next to q."""
    for _ in range(STEPS):
        J, e = _rows(held, twin.state(q), holds)
        step = np.linalg.pinv(J, rcond=1e-9) @ e
        q = twin.integrate(q, -step * min(1.0, STEP / max(float(np.abs(step).max()), 1e-300)), 1.0)
    return _rows(held, twin.state(q), holds)[0]


def _rows(held: Sequence[Any], state: State, holds: Sequence[Any]) -> tuple[Mat, Vec]:
    blocks = [e.jacobian(state, hold) if e.steered else e.jacobian(state) for e, hold in zip(held, holds, strict=True)]
    errors = [np.asarray(e.error(state, hold)) for e, hold in zip(held, holds, strict=True)]
    return np.vstack(blocks), np.concatenate(errors)


def _rank(J: Mat) -> int:
    values = np.linalg.svd(J, compute_uv=False)
    return int(np.count_nonzero(values > LOST * values[0]))
