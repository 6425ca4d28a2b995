"""A stack on a robot whose commands are carried out exactly, in real time, with its page: the command `hqp view`."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np

from hqp.declare.robot import Robot
from hqp.declare.stack import Stack
from hqp.loop.session import Controller
from hqp.programs.formulation import Formulation
from hqp.solvers.base import Solver
from hqp.teleoperation.webxr import OperatorPage, operators
from hqp.web.doors import LOOPBACK

from .session_view import View


def run(
    stack: Stack,
    robot: Robot,
    *,
    formulation: Formulation,
    solver: str | Solver = "",
    dt: float = 0.002,
    host: str = LOOPBACK,
    port: int = 0,
    password: str | None = None,
    seconds: float | None = None,
    started: Callable[[View], None] | None = None,
    operator: Callable[[OperatorPage], None] | None = None,
) -> int:
    """Run until interrupted, or for some seconds of the clock; returns the number of ticks.

    Every element holds the value it has at home until it is dragged in the page.  A tick that is late is not made up
    for.  solver: argument of Controller.  host, port, password: arguments of View.  started: called with the view once
    the page is served.  operator: called with a page for an operator's headset or phone, served beside it, whose hands
    are followed.  Raises the errors of ``Controller.session`` and View.
    """
    session = Controller(stack, formulation, solver).session(robot, dt)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    count = 0
    follows = {} if operator is None else operators(stack)
    with ExitStack() as pages:
        view = pages.enter_context(View(session, control=True, host=host, port=port, password=password))
        if started is not None:
            started(view)
        if operator is not None:
            operator(pages.enter_context(OperatorPage(follows, doors=view.doors)))
        sources = list(dict.fromkeys(follows.values()))
        start = due = time.perf_counter()
        try:
            while seconds is None or time.perf_counter() - start < seconds:
                view.wait()
                state = robot.state(q, v)
                tick = view.step(state, *(source.reference(state) for source in sources))
                if tick.solution is not None:
                    q, v = tick.advance()
                count += 1
                due = max(due + dt, time.perf_counter())
                time.sleep(max(0.0, due - time.perf_counter()))
        except KeyboardInterrupt:
            pass
    return count
