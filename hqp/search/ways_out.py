"""A posture that takes a task out of a trap, found by a thread beside the loop."""

from __future__ import annotations

import time
from contextlib import suppress
from threading import Thread, main_thread

import numpy as np

from hqp.arrays import Vec
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot
from hqp.declare.stack import Stack
from hqp.errors import HqpError

from .newton import Search
from .sessions import Sessions
from .starts import starts

TOLERANCE = 1e-3
"""Tolerance of a posture's target [m, rad]."""

STEPS, BUDGET = 40, 1.0
"""Largest number of steps of a start, and the time for all [s]."""

PAUSE = 2.0
"""After a search in vain the next one waits for so long [s]."""

MOVED = 0.02
"""A target that moves by this starts a new search [m, rad]."""


class Query:
    """Looks for a posture that meets a level and leaves all above it no worse than they are.

    It starts from where the robot is, from its home, from both turned about the vertical where the base is free, and
    from random configurations.  done: true once the search has ended.  posture: its result, None without one.
    """

    def __init__(
        self,
        stack: Stack,
        robot: Robot,
        q: Vec,
        references: tuple[Reference, ...],
        level: int,
        sessions: Sessions,
    ) -> None:
        self._stack, self._q, self._references, self._level = stack, q.copy(), references, level
        self._sessions = sessions
        self.done, self._ended = False, 0.0
        self.posture: Vec | None = None
        self._robot = robot.copy()
        Thread(target=self._run, name="hqp way out").start()  # a daemon would be killed inside of native code

    def outdated(self, q: Vec, references: tuple[Reference, ...]) -> bool:
        """Return true if the search has ended for other targets, or failed a while ago."""
        if not self.done:
            return False
        if self.posture is None:
            return time.monotonic() - self._ended > PAUSE
        demand = {r.name: r.value for r in self._references}
        for reference in references:
            old = demand.get(reference.name)
            new = reference.value
            if (old is None) != (new is None) or (
                old is not None and new is not None and (old.shape != new.shape or np.abs(old - new).max() > MOVED)
            ):
                return True
        return False

    def _run(self) -> None:
        with suppress(HqpError, np.linalg.LinAlgError):
            self.posture = self._search()
        self._ended = time.monotonic()
        self.done = True

    def _search(self) -> Vec | None:
        robot, end = self._robot, time.perf_counter() + BUDGET
        apart = [element.name for element in self._stack if element.quantity != "motion"]
        search = Search(self._stack.without(*apart) if apart else self._stack, robot, self._sessions)
        search.aim(self._q, self._references)
        _, errors = search.step(self._q, whole=True)
        allowed = [*search.merit(errors, TOLERANCE)[: self._level + 1], 1.0]
        for start in starts(robot, self._q):
            found = search.descend(start, TOLERANCE, STEPS, end)
            if all(a <= b for a, b in zip(found.merit, allowed, strict=False)):
                return found.q
            if time.perf_counter() > end or not main_thread().is_alive():
                return None
            time.sleep(0.0)  # the loop comes first
        return None
