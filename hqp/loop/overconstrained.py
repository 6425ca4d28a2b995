"""Find constraints that hold more than joints can follow: dependent rows where they are met, loops that cannot move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.arrays import Index, Mat, Vec, rank
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.loop.soundness import twin_of
from hqp.tasks import Ball, Hinge, Weld

STEP = 0.05
"""Displacement of the largest coordinate from home, along the free directions there [m, rad]."""

STEPS = 12
"""Iterations of Newton's method; near a double root each halves the remaining distance."""

LOST = 1e-4
"""Threshold of a zero singular value, relative to the largest."""

PART = 0.1
"""Share of the dependent combinations of rows from which on an element is named."""

STILL = 1e-6
"""Share of a unit motion of all joints: joints of a loop that move less are locked."""


def overconstrained(stack: Stack, robot: Robot) -> str:
    """A warning if rows of ``subject_to`` are dependent at all poses near home that meet them, or lock a loop; else "".

    At nearby poses that do not meet them they are independent.  So they leave a direction free that violates them to
    second order, as two flat feet on legs of five joints do: the robot cannot move that way, and the sign of the error
    of a contact decides which way commands go.  A closure locks a loop if its joints have no motion in the null space
    of all rows.
    """
    out = stack.out_of(None)
    held = [e for e in stack.subject_to if e.equality and e.quantity == "motion" and e.name not in out]
    if not held:
        return ""
    try:
        with twin_of(robot) as twin:
            return _locked(held, twin) or _told(held, twin)
    except Exception:  # a user's faulty element: the tick reports it
        return ""


def _told(held: Sequence[Any], twin: Robot) -> str:
    home = twin.state(twin.home)
    holds = [element.hold(home).value for element in held]
    J = _rows(held, home, holds)[0]
    independent = rank(J, LOST)
    if independent in J.shape:  # full row or column rank
        return ""
    for k in (1, 2):
        q = _beside(J, twin, k)
        apart, met = _rows(held, twin.state(q), holds)[0], _rows(held, _met(held, twin, holds, q), holds)[0]
        if rank(apart, LOST) <= rank(met, LOST):
            return ""
    lost = np.linalg.svd(met)[0][:, rank(met, LOST) :]
    ends = np.cumsum([element.rows(twin) for element in held])[:-1]
    shares = [float(np.linalg.norm(part)) for part in np.split(lost, ends)]
    named = [element for element, share in zip(held, shares, strict=True) if share > PART]
    cure = "Remove a contact, or replace one by an EdgeContact or a PointContact"
    if looser := [_looser(held, twin, element) for element in named if isinstance(element, Weld | Hinge)]:
        cure = ". ".join(filter(None, looser)) or "Remove a closure"
    return (
        f"{', '.join(element.name for element in named)}: overconstrained. Only {independent} of {J.shape[0]} rows are "
        "independent near home; motion that satisfies these soon violates the others, so that commands alternate. "
        f"{cure}"
    )


def _locked(held: Sequence[Any], twin: Robot) -> str:
    """Name the Weld or Hinge whose loop of two joints or more has no motion left at poses that meet all rows."""
    closures = [element for element in held if isinstance(element, Weld | Hinge)]
    if not closures:
        return ""
    home = twin.state(twin.home)
    holds = [element.hold(home).value for element in held]
    start = _rows(held, home, holds)[0]
    found = dict.fromkeys(element.name for element in closures)
    for k in (1, 2):
        state = _met(held, twin, holds, _beside(start, twin, k))
        J = _rows(held, state, holds)[0]
        free = np.linalg.svd(J)[2][rank(J, LOST) :]
        still = [
            e.name for e in closures if len(_loop(e, state)) > 1 and np.all(abs(free[:, _columns(e, state)]) < STILL)
        ]
        found = {name: None for name in found if name in still}
    told = []
    for element in (e for e in closures if e.name in found):
        if looser := _looser(held, twin, element):
            joints = ", ".join(_loop(element, twin.state(twin.home)))
            told.append(f"{element.name}: holds all motion of {joints}. {looser}")
    return ". ".join(told)


def _looser(held: Sequence[Any], twin: Robot, element: Any) -> str:
    """A sentence on closures with fewer rows that let the loop of an element move, "" if none does."""
    home = twin.state(twin.home)
    loose = [_ball(e) if isinstance(e, Weld | Hinge) else e for e in held]
    holds, whole = [e.hold(home).value for e in loose], Weld(frame=element.frame, relative_to=element.relative_to)
    start = _rows(loose, home, holds)[0]
    axes: list[Vec] = []
    for k in (1, 2):
        state = _met(loose, twin, holds, _beside(start, twin, k))
        J = _rows(loose, state, holds)[0]
        free = np.linalg.svd(J)[2][rank(J, LOST) :]
        columns = _columns(element, state)
        motions = rank(free[:, columns] * (abs(free[:, columns]) > STILL), LOST)
        if not motions:
            return ""
        turns = whole.jacobian(state)[3:] @ free.T
        if rank(turns, LOST) == 1:
            axes.append(np.linalg.svd(turns)[0][:, 0])
    ends = f"frame={element.frame!r}, relative_to={element.relative_to!r}"
    ways = [f"Ball({ends})"]
    if isinstance(element, Weld) and len(axes) == 2 and abs(axes[0] @ axes[1]) > 1.0 - STILL:
        axis = axes[0] * np.sign(axes[0][np.argmax(abs(axes[0]))])
        ways.insert(0, f"Hinge({ends}, axis=({', '.join(f'{x + 0.0:.6g}' for x in axis.round(9))}))")
    return (
        f"If the loop closes in a bearing, declare {' or '.join(ways)}, with both frames at the bearing (in an MJCF: "
        f"connect), instead of the {type(element).__name__}: the loop then has {motions} motion{'s' * (motions > 1)}"
    )


def _ball(element: Weld | Hinge) -> Ball:
    """The point of a closure alone."""
    assert element.relative_to is not None
    return Ball(frame=element.frame, relative_to=element.relative_to, closed=element.closed, name=element.name)


def _columns(element: Any, state: State) -> Index:
    """Tangent coordinates that move the frames of a closure against each other."""
    whole = Weld(frame=element.frame, relative_to=element.relative_to).jacobian(state)
    return np.flatnonzero(abs(whole).max(axis=0) > STILL)


def _loop(element: Any, state: State) -> list[str]:
    """Joints that move the frames of a closure against each other."""
    columns = set(_columns(element, state).tolist())
    robot = state.robot
    return [robot.joint_name(first) for _, first, count, *_ in robot.bodies if columns & {*range(first, first + count)}]


def _beside(J: Mat, twin: Robot, k: int) -> Vec:
    """A configuration near home, along a free direction of the rows; home without one."""
    free = np.linalg.svd(J)[2][rank(J, LOST) :]
    if not len(free):
        return twin.home
    direction = _scattered(free.shape[0], k) @ free
    return twin.integrate(twin.home, STEP * direction / np.abs(direction).max(), 1.0)


def _scattered(n: int, k: int) -> Vec:
    """A reproducible sequence of n irregular numbers from -1 to 1."""
    return np.asarray(np.cos(k * np.arange(1.0, n + 1.0) ** 2))


def _met(held: Sequence[Any], twin: Robot, holds: Sequence[Any], q: Vec) -> State:
    """The state at a pose near q that meets the rows."""
    for _ in range(STEPS):
        J, e = _rows(held, twin.state(q), holds)
        step = np.linalg.pinv(J, rcond=1e-9) @ e
        q = twin.integrate(q, -step * min(1.0, STEP / max(float(np.abs(step).max()), 1e-300)), 1.0)
    return twin.state(q)


def _rows(held: Sequence[Any], state: State, holds: Sequence[Any]) -> tuple[Mat, Vec]:
    blocks = [e.jacobian(state, hold) if e.steered else e.jacobian(state) for e, hold in zip(held, holds, strict=True)]
    errors = [np.asarray(e.error(state, hold)) for e, hold in zip(held, holds, strict=True)]
    return np.vstack(blocks), np.concatenate(errors)
