"""Tasks that stay unmet although a known posture meets them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Vec
from hqp.declare.element import Task
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.explanation.notes import Note
from hqp.explanation.words import BINDS, OUT_OF_REACH, PRICE
from hqp.loop.tick import Stuck
from hqp.problem import Status

if TYPE_CHECKING:
    from hqp.loop.line import Line
    from hqp.loop.tick import Tick
    from hqp.search.sessions import Sessions
    from hqp.search.ways_out import Query

PERIOD, PATIENCE = 0.05, 0.5
"""Period of the check, and least duration of the error and of rest [s]."""

OFF = 0.01, 0.05
"""A task that is nearer than this is not stuck [m, rad]."""

STILL = 0.2
"""Joints and a base that move by less are nearly at rest [rad/s, m/s]."""

LACKING = 0.9
"""Share of the demand that a task must lack to count as blocked."""

FALLING = 0.01
"""A task that comes nearer by this share within the patience is on its way."""

NEAR = 0.02
"""A joint this near to a limit is at it [rad, m]."""

NAMED = 4
"""Largest number of named joints at a limit."""

PROGRESS, WAIT = 0.05, 1.0
"""A task that lacks most of its demand and comes nearer by less than this share in this time [s] is held."""


NOTHING = "", 0.0, ""
"""No task: its name, how far it is off, and the unit."""


class StuckWatch:
    """Note tasks with a reference that stay unmet with the robot at rest; checked twenty times a second.

    After half a second a thread searches for a posture that meets the task's level without loss above it; with one,
    every tick has a note while the robot rests.  A task without such a posture that comes less than 5 % nearer in a
    second has a note with the rows that hold it.  sessions: make the sessions of the search.  on: False disables it.
    """

    def __init__(self, stack: Stack, dt: float, sessions: Sessions, on: bool) -> None:
        self._tasks = {
            task.name: (level, task)
            for level, elements in enumerate(stack.levels)
            for task in elements
            if on and isinstance(task, Task) and task.quantity == "motion" and not task.is_contact and not task.demands
        }
        self._stack, self._sessions, self._period = stack, sessions, max(1, round(PERIOD / dt))
        self._patience = math.ceil(PATIENCE / (self._period * dt))
        self.due = self._period if self._tasks else math.inf
        """The tick of the next look; 0 while there is a note."""
        self._next, self._looks, self._name, self._begin = self._period, 0, "", 0.0
        self._query: Query | None = None
        self._note: Note | None = None
        self._slow, self._since, self._from, self._waits = "", 0, 0.0, 0
        self._holding: Note | None = None

    def look(self, line: Line, tick: Tick) -> None:
        """Check the latest tick, and give it a note if a task is stuck."""
        count = tick.count
        if count >= self._next:
            self._next = count + self._period
            if line.transition is None and tick.status.solved:
                self._decide(line, tick)
            self.due = self._next if self._note is None else 0
        if self._note is not None:
            tick.add((self._note,))

    def _decide(self, line: Line, tick: Tick) -> None:
        """Set or clear the note: a way out if one is known, else the rows that hold the task."""
        lacking = self._off(line, tick)
        self._decide_stuck(line, tick, *(lacking if self._rests(line, tick) else NOTHING))
        held = self._held(line, tick, *lacking)
        if not isinstance(self._note, Stuck):
            self._note = held

    def _held(self, line: Line, tick: Tick, name: str, off: float, unit: str) -> Note | None:
        """A note on a task that has come no nearer for a second, with the rows in its way; None before."""
        if name != self._slow or off < (1.0 - PROGRESS) * self._from:
            self._slow, self._since, self._from = name, tick.count, off
        waits = int((tick.count - self._since) * line.dt / WAIT) if name else 0
        if waits != self._waits:
            self._waits, self._holding = waits, None
            holders = _holders(line, tick, name) if waits else ""
            if holders:
                nearer = max(100.0 * (1.0 - off / self._from), 0.0)
                far = f"{off:.2g} {unit} from its target and came {nearer:.1f} % nearer in {waits * WAIT:g} s"
                self._holding = Note(name, Status.OPTIMAL, f"HELD: {name} is {far}; {holders}")
        return self._holding

    def _decide_stuck(self, line: Line, tick: Tick, name: str, off: float, unit: str) -> None:
        if not name or name != self._name:
            self._name, self._looks, self._begin, self._note = name, 0, off, None
            return
        self._looks += 1
        if off < (1.0 - FALLING) * self._begin:
            self._looks, self._begin, self._note = 0, off, None
            return
        if self._looks % self._patience == 0:
            self._begin = off
        if self._looks < self._patience:
            return
        if self._query is None or self._query.outdated(tick.state.q, line.last_references):
            self._note = None
            if self._query is None or self._query.done:
                from hqp.search.ways_out import Query

                references, level = line.last_references, self._tasks[name][0]
                self._query = Query(self._stack, line.robot, tick.state.q, references, level, self._sessions)
            return
        if self._query.posture is not None:
            text = (f"STUCK: {name} is at rest {off:.2g} {unit} from its target", *at_limits(line.robot, tick.state))
            self._note = Stuck(name, Status.OPTIMAL, "; ".join(text), self._query.posture)

    def _off(self, line: Line, tick: Tick) -> tuple[str, float, str]:
        """The first task by level that is off and lacks most of its demand, how far [m or rad], its unit."""
        solved = tick.solved()
        if solved is None:
            return NOTHING
        w, given = solved[0], frozenset(line.names)
        program = line.program
        starts = np.cumsum([0, *(rows.m for rows in program.problem.levels)]).tolist()
        for name, (_, task) in self._tasks.items():
            if name not in given or name not in program.places:
                continue
            place = program.places[name]
            begin, member = starts[place.level], program.assembly.members[name]
            demand = program.assembly.lower[member.part]
            lacks = w[begin + place.part.start : begin + place.part.stop]
            if float(lacks @ lacks) < LACKING**2 * float(demand @ demand):
                continue
            error = member.views.error
            for part, most, unit in zip(parts(task, error), OFF, ("m", "rad"), strict=True):
                far = math.sqrt(float(part @ part))
                if far > most:
                    return name, far, unit
        return NOTHING

    @staticmethod
    def _rests(line: Line, tick: Tick) -> bool:
        v = tick.x if line.velocity else tick.state.v
        return bool(np.abs(v).max(initial=0.0) < STILL)


AT_BOUND = 1e-4
"""A row this near to its bound, relative to its size, is at it: a price keeps answers that near."""


def parts(task: Task, error: Vec) -> tuple[Vec, Vec]:
    """Split an error into its lengths and its angles."""
    if task.units == ("rad",):
        return error[:0], error
    first = task.rotation_rows
    return (error, error[:0]) if first is None else (error[:first], error[first:])


def at_limits(robot: Robot, state: State) -> tuple[str, ...]:
    """Describe the joints at a position limit."""
    angles = state.angles
    room = np.minimum(angles - robot.lower, robot.upper - angles)
    nearest = [int(i) for i in np.argsort(room, kind="stable") if room[i] < NEAR]
    text = ", ".join(
        f"{robot.joint_name(i)} at its {'lower' if angles[i] - robot.lower[i] < NEAR else 'upper'} limit"
        for i in nearest[:NAMED]
    )
    return (text + (f" and {len(nearest) - NAMED} more" if len(nearest) > NAMED else ""),) if text else ()


def _holders(line: Line, tick: Tick, name: str) -> str:
    """Elements that hold a task, with their rows at a bound, as text; "" if another note already reports none."""
    account = line.account(tick)
    losses = [loss for loss in account.losses(name) if loss.share >= BINDS and loss.element != PRICE][:NAMED]
    if not losses:
        noted = any(note.element == name for note in tick.notes)
        return "" if noted else OUT_OF_REACH if account.cause(name) == "out of reach" else "no other element holds it"
    solved = tick.solved()
    assert solved is not None
    return "held by " + ", ".join(str(replace(loss, rows=_at_bounds(line, loss.element, solved[1]))) for loss in losses)


def _at_bounds(line: Line, name: str, x: Vec) -> tuple[str, ...]:
    """Rows of an inequality that an answer x brings to a bound, by name and side; none of other elements."""
    place = line.program.places.get(name)
    if place is None or place.element.equality:
        return ()
    rows, names = line.program.problem.levels[place.level], place.element.row_names(line.robot)
    value, low, high = rows.dense(x.size)[place.part] @ x, rows.lower[place.part], rows.upper[place.part]
    near = AT_BOUND * (1.0 + np.abs(value))
    sides = np.where(value > high - near, " upper", np.where(value < low + near, " lower", "")).tolist()
    return tuple((names[i] if i < len(names) else f"row {i}") + side for i, side in enumerate(sides) if side)
