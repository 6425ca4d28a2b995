"""Whether anything holds a floating base: without it targets pull the robot through the air."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.declare.robot import Robot
from hqp.declare.stack import Stack

AWAY = 0.3
"""How far from home joints are where rows are looked at: home may be a pose where a joint does not enter [m, rad]."""

STEP = 1e-3
"""How far the base is moved to see which errors notice [m, rad]."""

ROUNDING = 1e-9
"""Entries of a Jacobian below this, relative to its largest, are rounding."""


def adrift(stack: Stack, robot: Robot) -> str:
    """What is said where tasks pull a floating base that nothing holds, ``""`` elsewhere.

    What holds it: a contact, an equality of ``subject_to`` that its motion enters, or a task on the base itself, whose
    error changes with the base and which no joint moves.
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
        except Exception:  # a user's own element: what it does wrong is told by the tick
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
    """Whether the base enters the rows, whether a joint does, and whether the error changes with the base."""
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
