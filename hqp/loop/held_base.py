"""Warning for a floating base that nothing holds: targets would pull the robot through the air."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.declare.robot import Robot
from hqp.declare.stack import Stack

AWAY = 0.3
"""Displacement of the joints from home for the check of rows: at home itself a joint may have no effect [m, rad]."""

STEP = 1e-3
"""Displacement of the base to find the errors that depend on it [m, rad]."""

ROUNDING = 1e-9
"""Entries of a Jacobian below this, relative to its largest, are rounding."""


def adrift(stack: Stack, robot: Robot) -> str:
    """Return a warning if tasks pull a floating base that nothing holds, else ``""``.

    A contact holds it, or an equality of ``subject_to`` with the base's motion in its rows, or a task on the base
    itself: its error changes with the base, and no joint moves it.
    """
    if not robot.floating or any(element.is_contact for element in stack):
        return ""
    here, there = robot.copy(), robot.copy()
    q = here.integrate(here.home, np.random.default_rng(0).uniform(-AWAY, AWAY, robot.nv), 1.0)
    here.state(q)
    there.state(there.integrate(q, np.where(np.arange(robot.nv) < 6, STEP, 0.0), 1.0))
    pulled = []
    for element in stack:
        if not element.equality or element.quantity != "motion":
            continue
        try:
            base, joints, noticed = _entries(element, here, there)
        except Exception:  # a user's faulty element: the tick reports it
            return ""
        if (base and element in stack.subject_to) or (noticed and not joints):
            return ""
        if noticed:
            pulled.append(element.name)
    if not pulled:
        return ""
    name = robot.name or "the robot"
    return (
        f"no contact and no task holds the floating base of {name}: {_listed(pulled)} will move it through the air. "
        "Declare contacts in subject_to or a task on the base, or load the robot with a fixed base "
        "(floating=False, --fixed)"
    )


def _entries(element: Any, here: Robot, there: Robot) -> tuple[bool, bool, bool]:
    """Return true if the base is in the rows, if a joint is, and if the error changes with the base."""
    now, then = here.current, there.current
    hold = element.hold(now).value
    J = np.abs(np.atleast_2d(element.jacobian(now, hold) if element.steered else element.jacobian(now)))
    largest = float(J.max(initial=0.0))
    entered = ROUNDING * largest < J
    base = bool(entered[:, :6].any())
    change = np.abs(np.asarray(element.error(then, hold)) - np.asarray(element.error(now, hold))) if base else 0.0
    return base, bool(entered[:, 6:].any()), bool(np.any(change > ROUNDING))


def _listed(names: list[str], most: int = 3) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
