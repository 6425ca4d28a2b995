"""One step of inverse kinematics, for those who keep the loop to themselves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real

import numpy as np

from hqp.arrays import Vec
from hqp.declare.element import Element
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot
from hqp.declare.stack import Level, Stack
from hqp.errors import DeclarationError
from hqp.loop.session import Controller, Session
from hqp.programs.formulation import Velocity

from .kept import Kept

_SESSIONS: Kept[Session] = Kept(16)


def solve_ik(
    robot: Robot,
    q: Vec,
    levels: Stack | Sequence[Level],
    dt: float,
    *references: Reference,
    subject_to: Sequence[Element] = (),
    solver: str = "",
    fresh: bool = False,
) -> Vec:
    """The generalised velocity ``(nv,)`` [rad/s, m/s] of one step of ``levels`` at q, ``(nq,)``.

    levels: a Stack, or its levels under ``subject_to``.  dt [s]: step of ``robot.integrate(q, v, dt)``, at most 1.
    A session is kept for each robot, stack, dt and solver: elements without a reference hold their value of its
    first call, the acceleration window of ``JointLimits`` counts from the velocity of its last; fresh starts anew.
    Raises NotSolved without a usable answer, DeclarationError and ModelError for invalid input.
    """
    if not hasattr(robot, "nq"):
        raise DeclarationError("solve_ik", "not a robot", value=robot, allowed='hqp.robots.load("panda")')
    if not isinstance(levels, (Stack, Sequence)) or isinstance(levels, (str, bytes)):
        raise DeclarationError("solve_ik", "levels", value=levels, allowed="a Stack, or a list of Level(...)")
    if not isinstance(dt, Real) or not 0.0 < dt <= 1.0:
        raise DeclarationError("solve_ik", "dt", value=dt, unit="s", allowed="0 < dt <= 1")
    if q is not None:
        q = numbers("solve_ik", "q", q, (robot.nq,))
    stack = levels if isinstance(levels, Stack) else Stack(*levels, subject_to=subject_to)
    key = stack, float(dt), solver
    if fresh:
        _SESSIONS.drop(robot, key)
    session = _SESSIONS.get(robot, key, lambda copy: _session(copy, stack, dt, solver))
    tick = session.step(session.robot.state(q), *references)
    if not tick.status.usable:
        tick.unwrap()
    return np.array(tick.x)


def _session(robot: Robot, stack: Stack, dt: float, solver: str) -> Session:
    return Session(Controller(stack, Velocity(), solver=solver, deadline=math.inf), robot, float(dt))
