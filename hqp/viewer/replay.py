"""A recording in the viewer: its ticks as they were, in real time, again and again."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.commands.arguments import formulation
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot
from hqp.errors import HqpError
from hqp.explanation.counters import Counters
from hqp.loop.session import Controller, Note, Tick
from hqp.problem import Hierarchy, Solution, Status
from hqp.recorder import RecordedTick, Recording
from hqp.web.doors import LOOPBACK

from .session_view import View


@dataclass(frozen=True)
class _Shown:
    """Interface of a tick for the page."""

    state: RecordedTick
    command: Any
    solution: Solution | None
    status: Status
    notes: tuple[Note, ...]
    times: None = None
    line: None = None


class ReplayView(View):
    """A page that shows recorded ticks; the session is there for its description only."""

    steers = False
    _tick: RecordedTick | None = None
    _recorded: Counters | None = None

    def __enter__(self) -> ReplayView:
        return self

    def of(self, recording: Recording) -> None:
        """Show the counters of this recording."""
        self._recorded = recording.counters

    def show_recorded(self, tick: RecordedTick) -> None:
        """Show a tick of the recording."""
        self._tick = tick
        notes = tuple(Note(element, Status[status], text) for element, status, text in tick.notes)
        shown: Any = _Shown(tick, tick.command, tick.solution, tick.status, notes)
        given = {r["name"]: r["value"] for r in tick.references if r.get("value") is not None}
        references = [Reference(name, np.array(value, dtype=np.float64)) for name, value in given.items()]
        self.show(shown.state, shown, *references)

    def _numbers(self, tick: Tick) -> dict[str, Any]:
        return {"status": tick.status.name, "counters": self._recorded}

    def _problem(self) -> Hierarchy:
        assert self._tick is not None
        return self._tick.problem

    def _row_names(self) -> dict[str, tuple[str, ...]]:
        assert self._tick is not None
        return self._tick.row_names

    def _fast(self, tick: Tick) -> frozenset[str]:
        return frozenset()

    def _contact_forces(self, tick: Tick) -> dict[str, Any]:
        return {}


def replay(
    recording: Recording,
    robot: Robot,
    *,
    host: str = LOOPBACK,
    port: int = 0,
    password: str | None = None,
    seconds: float | None = None,
    speed: float = 1.0,
    started: Callable[[ReplayView, int], None] | None = None,
) -> int:
    """Show a recording until interrupted or for some seconds of the clock; returns the number of ticks shown.

    host, port, password: arguments of View.  speed: 1 is real time.  started: called with the view and how many ticks
    are left out, those of another stack than the recording's.  Raises HqpError where the recording has no stack as text
    or its robot is another.
    """
    from hqp import serial

    about = recording.about
    if not about["toml"]:
        raise HqpError("the recording's stack has custom elements: use hqp replay, the viewer cannot show it")
    if list(robot.joint_names) != about["robot"]["joints"]:
        raise HqpError(f"the recording is of {about['robot']['name']}, whose joints are not those of {robot.name}")
    dt = float(about["dt"])
    session = Controller(serial.loads(about["toml"]), formulation(recording[0].kind)).session(robot, dt)
    rows = _rows(session.program.problem)
    ticks = [tick for tick in recording if _rows(tick.problem) == rows]
    if not ticks:
        raise HqpError("no tick of the recording has its stack")
    count = 0
    title = f"{robot.name}, recorded {about['made'][:16]}"
    with ReplayView(session, control=True, host=host, port=port, password=password, title=title) as view:
        view.of(recording)
        if started is not None:
            started(view, len(recording) - len(ticks))
        start = due = time.perf_counter()
        try:
            while seconds is None or time.perf_counter() - start < seconds:
                view.wait()
                view.show_recorded(ticks[count % len(ticks)])
                count += 1
                due = max(due + dt / speed, time.perf_counter())
                time.sleep(max(0.0, due - time.perf_counter()))
        except KeyboardInterrupt:
            pass
    return count


def _rows(problem: Hierarchy) -> tuple[int, ...]:
    """Variables, and rows of each level."""
    return problem.n, *(rows.m for rows in problem.levels)
