"""Whether constraints hold more than joints can follow: rows that are dependent wherever they are met."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec, rank
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.loop.soundness import twin_of

STEP = 0.05
"""How far from home the largest coordinate goes, along what the rows leave free there [m, rad]."""

STEPS = 12
"""Of Newton's method; where it nears a double root each step halves the way that is left."""

LOST = 1e-4
"""A singular value below this, relative to the largest, is none."""

PART = 0.1
"""Share of the dependent combinations of rows from which on an element is named."""


def overconstrained(stack: Stack, robot: Robot) -> str:
    """A warning where rows of ``subject_to`` are dependent at all poses near home that meet them, "" elsewhere.

    At nearby poses that do not meet them they are independent.  So they leave a direction free that violates them to
    second order, as two flat feet on legs of five joints do: the robot cannot move that way, and the sign of the error
    of a contact decides which way commands go.
    """
    out = stack.out_of(None)
    held = [e for e in stack.subject_to if e.equality and e.quantity == "motion" and e.name not in out]
    if not held:
        return ""
    try:
        with twin_of(robot) as twin:
            return _told(held, twin)
    except Exception:  # a user's own element: what it does wrong is told by the tick
        return ""


def _told(held: Sequence[Any], twin: Robot) -> str:
    home = twin.state(twin.home)
    holds = [element.hold(home).value for element in held]
    J = _rows(held, home, holds)[0]
    independent = rank(J, LOST)
    if independent in J.shape:  # of all rows, or of all motion
        return ""
    free = np.linalg.svd(J)[2][independent:]
    for k in (1, 2):
        direction = _scattered(free.shape[0], k) @ free
        q = twin.integrate(twin.home, STEP * direction / np.abs(direction).max(), 1.0)
        apart, met = _rows(held, twin.state(q), holds)[0], _met(held, twin, holds, q)
        if rank(apart, LOST) <= rank(met, LOST):
            return ""
    lost = np.linalg.svd(met)[0][:, rank(met, LOST) :]
    ends = np.cumsum([element.rows(twin) for element in held])[:-1]
    shares = [float(np.linalg.norm(part)) for part in np.split(lost, ends)]
    names = [element.name for element, share in zip(held, shares, strict=True) if share > PART]
    return (
        f"{', '.join(names)}: overconstrained. Only {independent} of {J.shape[0]} rows are independent near home; "
        "motion that satisfies these soon violates the others, so that commands alternate. Remove a contact, or "
        "replace one by an EdgeContact or a PointContact"
    )


def _scattered(n: int, k: int) -> Vec:
    """So many numbers from -1 to 1 without a pattern, the same ones every time."""
    return np.asarray(np.cos(k * np.arange(1.0, n + 1.0) ** 2))


def _met(held: Sequence[Any], twin: Robot, holds: Sequence[Any], q: Vec) -> Mat:
    """The Jacobian at a pose near q that meets the rows."""
    for _ in range(STEPS):
        J, e = _rows(held, twin.state(q), holds)
        step = np.linalg.pinv(J, rcond=1e-9) @ e
        q = twin.integrate(q, -step * min(1.0, STEP / max(float(np.abs(step).max()), 1e-300)), 1.0)
    return _rows(held, twin.state(q), holds)[0]


def _rows(held: Sequence[Any], state: State, holds: Sequence[Any]) -> tuple[Mat, Vec]:
    blocks = [e.jacobian(state, hold) if e.steered else e.jacobian(state) for e, hold in zip(held, holds, strict=True)]
    errors = [np.asarray(e.error(state, hold)) for e, hold in zip(held, holds, strict=True)]
    return np.vstack(blocks), np.concatenate(errors)
