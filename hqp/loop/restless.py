"""Limits of joints among the rows of a program: which alternate and how often, and which give way to the window.

hqp/cpp/session/limit_watch.hpp counts.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Mask, Vec
from hqp.declare.element import Element
from hqp.declare.robot import Robot, State
from hqp.explanation.notes import Note
from hqp.problem import Status
from hqp.programs.envelope import native
from hqp.programs.formulation import Program

if TYPE_CHECKING:
    from hqp._session import LimitWatch


class Watched:
    """Which rows of a program are limits of joints: parts of all rows, and their names."""

    def __init__(self, program: Program, robot: Robot) -> None:
        starts = np.concatenate(([0], np.cumsum([rows.m for rows in program.problem.levels]))).astype(int).tolist()
        self.names: list[str] = []
        self.parts: list[tuple[int, int]] = []
        self.elements: list[Element] = []
        for place in program.places.values():
            element, start = place.element, starts[place.level]
            if element.equality or element.selection(robot) is None:
                continue
            rows = element.row_names(robot)
            if len(rows) == place.part.stop - place.part.start:
                self.elements.append(element)
                self.parts.append((start + place.part.start, start + place.part.stop))
                self.names += rows
        self._robot, self._assembly = robot, program.assembly

    def watch(self, dt: float) -> LimitWatch:
        """What counts how often they alternate."""
        found: LimitWatch = native.LimitWatch(self.parts, self.names, dt)
        return found

    def overrun_notes(self, state: State, v: Vec) -> tuple[Note, ...]:
        """Notes on joints that will pass a position limit; v: the velocity around which the window stands."""
        found: list[Note] = []
        passed = native.LimitWatch.passed
        for element in self.elements:
            over = self._assembly.overrun(element.name, state.q, v)
            if over:  # of native limits alone
                rows = zip(element.row_names(self._robot), over, self.units(element), strict=True)
                found += [Note(name, Status.OPTIMAL, why) for name, far, unit in rows if (why := passed(far, unit))]
        return tuple(found)

    def units(self, element: Element) -> list[str]:
        """Of the joint of each row."""
        picked = element.selection(self._robot)
        assert picked is not None  # as above
        return ["rad" if turns else "m" for turns in self._turning[picked].tolist()]

    @cached_property
    def _turning(self) -> Mask:
        twin = self._robot.copy()
        twin.state(twin.home).kinematics()
        return np.asarray((twin.joint_twists[3:] != 0.0).any(axis=0), dtype=np.bool_)
