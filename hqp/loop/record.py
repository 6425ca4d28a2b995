"""Record of a native tick: numbers behind one another, then marks of rows and a byte (hqp/cpp/session/live.hpp)."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import FLOAT, Vec
from hqp.explanation.notes import STATUSES
from hqp.problem import Solution, Stats, Status
from hqp.solvers.second_opinion import STUCK

if TYPE_CHECKING:
    from hqp.declare.robot import Robot
    from hqp.programs.formulation import Program

ANSWERED, STAGED = 1, 2
"""Bits of the last byte: the solver gave an answer, and it is that of stages."""


class Layout:
    """Layout of the records of one program."""

    def __init__(self, program: Program, robot: Robot, *, moves: bool) -> None:
        """moves: true if a record holds the next q."""
        problem, motors = program.problem, robot.actuated.size
        n, rows = problem.n, [level.m for level in problem.levels]
        sizes = (motors, n, n, sum(rows), 6, robot.nq, robot.nv, robot.nq if moves else 0)
        ends = list(accumulate(sizes))
        parts = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
        self._command, self._x, self._answer, self._slack, self._counts, self._q, self._v, self._moved = parts
        self._numbers, self._moves = ends[-1], moves
        level_ends = [0, *accumulate(rows)]
        self._rows = [slice(a, b) for a, b in pairwise(level_ends)]
        self._total, self._n = level_ends[-1], n
        self._picks = None if program.kind == "torque" else robot.actuated
        self.width = motors
        """Numbers of the command, the first of a record."""
        self.q_shape, self.v_shape = (robot.nq,), (robot.nv,)
        self.rest, self.zero = np.zeros(robot.nv), np.zeros(n)
        self.zero.setflags(write=False)

    def _part(self, record: bytearray, part: slice) -> Vec:
        return np.frombuffer(record, FLOAT, part.stop - part.start, 8 * part.start)

    def x(self, record: bytearray) -> Vec:
        """The sent x ``(n,)``, read-only."""
        x = self._part(record, self._x)
        x.setflags(write=False)
        return x

    def answer(self, record: bytearray) -> Vec:
        """The x of the solver ``(n,)``."""
        return self._part(record, self._answer)

    def slacks(self, record: bytearray) -> Vec:
        """Slacks of all rows at the solver's x."""
        return self._part(record, self._slack)

    def state(self, record: bytearray) -> tuple[Vec, Vec]:
        """q and v of the tick."""
        return self._part(record, self._q).copy(), self._part(record, self._v).copy()

    def moved(self, record: bytearray) -> tuple[Vec, Vec] | None:
        """q and v one period later, at velocity level."""
        if not self._moves:
            return None
        return self._part(record, self._moved).copy(), self._part(record, self._x).copy()

    def seconds(self, record: bytearray) -> tuple[float, float, float]:
        """Start of the native call on the clock of ``perf_counter``, and the time for rows and for the solver [s]."""
        begin, rows, solve, *_ = self._part(record, self._counts).tolist()
        return begin, rows, solve

    def send(self, record: bytearray, x: Vec) -> None:
        """Write another x and its command."""
        self._part(record, self._x)[:] = x
        self._part(record, self._command)[:] = x if self._picks is None else x[self._picks]

    def solution(self, record: bytearray) -> Solution | None:
        """Answer of the solver, None if it did not run."""
        if not record[-1] & ANSWERED:
            return None
        _, _, solve, iterations, factorisations, severity = self._part(record, self._counts).tolist()
        points = None
        if record[-1] & STAGED:
            count = len(self._rows)
            points = np.frombuffer(record, FLOAT, count * self._n, 8 * self._numbers).reshape(count, self._n).copy()
        marks = np.frombuffer(record, np.int8, self._total, len(record) - 1 - self._total)
        slack, status = self.slacks(record), STATUSES[int(severity)]
        for shared in (answer := self.answer(record), slack, marks):
            shared.setflags(write=False)
        return Solution(
            answer,
            status,
            tuple(slack[part] for part in self._rows),
            tuple(marks[part] for part in self._rows),
            Stats(int(iterations), int(factorisations), 0.0, solve),
            STUCK if status is Status.NOT_CERTIFIED else "",
            stage_points=points,
        )


def staged(record: bytearray) -> bool:
    """Return true if the answer has stage points."""
    return record[-1] > ANSWERED
