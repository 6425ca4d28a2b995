"""Limits of joints by the marks of their rows: which alternate and how often, and which give way to the window."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from hqp.arrays import Mask, Signs, Vec
from hqp.declare.element import Inequality, has
from hqp.declare.robot import Robot, State
from hqp.explanation.notes import Note
from hqp.explanation.questions import overrun_notes
from hqp.problem import EQUALITY
from hqp.programs.formulation import Program

SPAN = 0.2
"""Alternations are counted over this time, in the mean [s]."""

OFTEN = 20.0
"""Alternations a second from which on a joint is restless: four or so within SPAN, which no reference asks for."""

OVER = 1e-6
"""A position limit that is passed by less gives way to nothing but rounding [rad, m]."""


class Watched:
    """Which rows of a program are limits of joints: parts of each level, parts of all rows, and their names."""

    def __init__(self, program: Program, robot: Robot) -> None:
        starts = np.concatenate(([0], np.cumsum([rows.m for rows in program.problem.levels]))).astype(int).tolist()
        names: list[str] = []
        self.parts: list[slice] = []
        self.own: list[tuple[int, slice]] = []
        self.elements: list[Inequality] = []
        for place in program.places.values():
            element = place.element
            if element.equality or element.selection(robot) is None:
                continue
            rows = element.row_names(robot)
            if len(rows) != place.part.stop - place.part.start:
                continue
            start = starts[place.level]
            self.own.append((place.level, place.part))
            self.parts.append(slice(start + place.part.start, start + place.part.stop))
            names += rows
            if isinstance(element, Inequality) and has(element, "overrun"):
                self.elements.append(element)
        self.names = tuple(names)
        self._robot = robot

    def overruns(self, state: State, v: Vec, dt: float) -> tuple[tuple[str, float, str], ...]:
        """Joints that will pass a position limit, by how much, and its unit; v: as ``Inequality.overrun``."""
        found = []
        for element in self.elements:
            picked, over = element.selection(self._robot), element.overrun(state, v, dt)
            for i in np.flatnonzero(over > OVER).tolist():
                assert picked is not None  # as above
                unit = "rad" if self._turning[picked[i]] else "m"
                found.append((element.row_names(self._robot)[i], float(over[i]), unit))
        return tuple(found)

    @cached_property
    def _turning(self) -> Mask:
        twin = self._robot.copy()
        twin.state(twin.home).kinematics()
        return np.asarray((twin.joint_twists[3:] != 0.0).any(axis=0), dtype=np.bool_)


class LimitWatch:
    """Counts how often each limit binds on the one side and then on the other, by the marks of its rows.

    The rate of a row is sum exp(-age / SPAN) / SPAN over its alternations, in the mean their number a second.
    """

    def __init__(self, watched: Watched, dt: float) -> None:
        self.parts, self._own, self._names, self._dt = watched.parts, watched.own, watched.names, dt
        self._watched = watched
        self._side, self._rate = np.zeros(len(self._names), dtype=np.int8), np.zeros(len(self._names))
        self._last, self._tick, self._seen, self._peak = bytearray(), 0, 0, 0.0
        self.busy = False
        """Whether a rate has still to fade, or bounds meet."""
        self.meet = False
        """Whether the bounds of a joint meet: its limits are outside the window of what it can do."""

    def overrun_notes(self, state: State, v: Vec) -> tuple[Note, ...]:
        """Notes on joints that will pass a position limit; v: the velocity around which the window stands."""
        return overrun_notes(self._watched.overruns(state, v, self._dt))

    def record(self, record: bytearray, begin: int, tick: int) -> tuple[tuple[str, float], ...]:
        """As ``look``, for marks of all rows as bytes from ``begin`` on; needed where they changed, or busy."""
        self._tick = tick
        parts = self.parts
        if len(parts) == 1:
            marks = record[begin + parts[0].start : begin + parts[0].stop]
        else:
            marks = bytearray().join(record[begin + part.start : begin + part.stop] for part in parts)
        return self._take(marks)

    def look(self, active: Sequence[Signs], tick: int) -> tuple[tuple[str, float], ...]:
        """Names and rates [1/s] of limits that alternate, from the marks of each level; tick: its number."""
        self._tick = tick
        if not self.parts or not len(active):  # a solver that marks nothing
            return ()
        marks = bytearray().join(active[level][part].tobytes() for level, part in self._own)
        return self._take(marks)

    def _take(self, marks: bytearray) -> tuple[tuple[str, float], ...]:
        if marks == self._last:
            return self._restless() if self.busy else ()
        self._last = marks
        self.meet = EQUALITY in marks
        return self._update(np.frombuffer(marks, np.int8))

    def _update(self, marks: Signs) -> tuple[tuple[str, float], ...]:
        turned = marks * self._side == -1
        np.copyto(self._side, marks, where=(marks == 1) | (marks == -1))
        if turned.any():
            self._fade()
            self._rate[turned] += 1.0 / SPAN
            self._peak = float(self._rate.max())
            self.busy = True
        self.busy |= self.meet
        return self._restless() if self.busy else ()

    def _faded(self) -> float:
        return math.exp(-(self._tick - self._seen) * self._dt / SPAN)

    def _fade(self) -> None:
        factor = self._faded()
        self._rate *= factor
        self._peak *= factor
        self._seen = self._tick

    def _restless(self) -> tuple[tuple[str, float], ...]:
        peak = self._peak * self._faded()
        self.busy = peak > 0.1 * OFTEN or self.meet
        if peak <= OFTEN:
            return ()
        self._fade()
        rates: Vec = self._rate
        return tuple((self._names[i], float(rates[i])) for i in np.flatnonzero(rates > OFTEN))
