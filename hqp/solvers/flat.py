"""A hierarchy as one block of rows, refilled each solve, and the solution computed back from that block."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from hqp.arrays import Mask, Mat, Signs, Vec, row_lengths
from hqp.problem import EQUALITY, Hierarchy, Selection, Shape, Solution, Stats, Status
from hqp.problem.completion import metric_factor
from hqp.solvers.base import UNSURE, check_shape, exceeded
from hqp.tolerances import ACTIVITY_TOLERANCE, FEASIBILITY_TOLERANCE, VIOLATION_TOLERANCE

_Array = TypeVar("_Array", Vec, Signs)


class Flat:
    """All rows of a hierarchy in order: A ``(M, n)``, lower, upper ``(M,)``; level k ends at stops[k].

    equality, inequality: ``(M,)`` marks of this tick; a row that is neither is left out of it. complete: append the
    tie-breaking objective as one or two more levels of n rows, see completion.
    """

    def __init__(self, shape: Shape, complete: bool = False) -> None:
        self.shape = shape
        extra = (1 + shape.metric) * complete
        self.sizes: list[int] = [*shape.rows, *[shape.n] * extra]
        self.stops: list[int] = [sum(self.sizes[: k + 1]) for k in range(len(self.sizes))]
        self.own = sum(shape.rows)
        M = sum(self.sizes)
        self.A: Mat = np.zeros((M, shape.n))
        self.lower: Vec = np.zeros(M)
        self.upper: Vec = np.zeros(M)
        self.equality = np.zeros(M, dtype=bool)
        self.inequality = np.zeros(M, dtype=bool)
        self.level = np.repeat(np.arange(len(self.sizes)), self.sizes)
        parts = [slice(a, z) for a, z in zip([0, *self.stops], self.stops, strict=False)]
        self._views = [(self.A[part], self.lower[part], self.upper[part]) for part in parts]
        self._completion = self._views[len(shape.rows) :]
        if self._completion:  # the least norm comes last, its rows never change
            self._completion[-1][0][:] = np.eye(shape.n)

    def load(self, problem: Hierarchy) -> str:
        """Take the numbers of this tick; return the reason if they are unusable, else "".

        Raises ProblemError for another shape than the workspace was made for.
        """
        check_shape(problem, self.shape)
        for rows, (A, lower, upper) in zip(problem.levels, self._views, strict=False):
            if isinstance(rows.A, Selection):
                A.fill(0.0)
                A[np.arange(rows.A.index.size), rows.A.index] = rows.A.scale
            else:
                A[...] = rows.A
            lower[...] = rows.lower
            upper[...] = rows.upper
        for name in ("metric", "origin"):
            value = getattr(problem, name)
            if value is not None and not np.isfinite(value).all():
                return f"the {name} is not finite"
        if self._completion:
            self._complete(problem)
        bounded = np.isfinite(self.lower)
        np.equal(self.lower, self.upper, out=self.equality)
        np.isfinite(self.upper, out=self.inequality)
        self.inequality |= bounded
        self.inequality &= ~self.equality
        return self._unusable(bounded)

    def equations(self) -> tuple[Mat, Vec, list[int]]:
        """(A, b, stops) of the equality rows alone."""
        marks = self.equality
        if marks.all():
            return self.A, self.lower, self.stops
        return self.A[marks], self.lower[marks], [int(np.count_nonzero(marks[:stop])) for stop in self.stops]

    def _complete(self, problem: Hierarchy) -> None:
        A, lower, upper = self._completion[0]
        if problem.metric is not None:
            A[...] = metric_factor(problem.metric)
            lower[...] = 0.0 if problem.origin is None else A @ problem.origin
            upper[...] = lower
        elif problem.origin is not None:
            lower[...] = upper[...] = problem.origin
        else:
            lower[...] = upper[...] = 0.0

    def _unusable(self, bounded: Mask) -> str:
        flat = self.A.ravel()
        if not math.isfinite(flat @ flat) and not np.isfinite(flat).all():
            return f"level {self.level[int(np.argmin(np.isfinite(self.A).all(axis=1)))]} is not finite"
        good = self.lower <= self.upper
        good &= bounded | ~self.equality  # inf <= x <= inf
        if not good.all():
            return f"level {self.level[int(np.argmin(good))]} has bounds that are NaN or lower > upper"
        return ""

    def slack(self, x: Vec) -> Vec:
        """w = A x - clip(A x, lower, upper), ``(M,)``."""
        value = self.A @ x
        return np.asarray(value - np.minimum(np.maximum(value, self.lower), self.upper))

    def refuse(self, problem: Hierarchy, stats: Stats, detail: str) -> Solution:
        """Return the solution of an unusable problem: x = 0, infinite residuals where they cannot be computed."""
        x = np.zeros(problem.n)
        with np.errstate(invalid="ignore"):
            w = self.slack(x)[: self.own]
        w[np.isnan(w)] = np.inf
        marks: Signs = np.zeros(w.size, dtype=np.int8)
        return Solution(x, Status.NOT_CERTIFIED, self._split(w), self._split(marks), stats, detail)

    def finish(self, problem: Hierarchy, x: Vec, status: Status, stats: Stats, detail: str = "") -> Solution:
        """Apply base.finish in one pass over the block."""
        if not np.isfinite(x).all():
            return self.refuse(problem, stats, "the numbers overflowed")
        own = self.own
        value, lower, upper = self.A[:own] @ x, self.lower[:own], self.upper[:own]
        nearest = np.minimum(np.maximum(value, lower), upper)
        w = value - nearest
        reach = np.abs(value)
        reach += 1.0
        reach *= ACTIVITY_TOLERANCE
        above, below = value >= upper - reach, value <= lower + reach
        marks: Signs = above.view(np.int8) - np.greater(below, above).view(np.int8)
        marks[self.equality[:own]] = EQUALITY
        if problem.constraints and status.solved:
            stop = self.stops[problem.constraints - 1]
            off = np.abs(w[:stop]) - VIOLATION_TOLERANCE * (1.0 + np.abs(nearest[:stop]))
            if np.any(off > 0.0):
                off -= FEASIBILITY_TOLERANCE * float(np.linalg.norm(x)) * row_lengths(self.A[:stop])
            if exceeded(problem, off, x):
                detail = detail or (UNSURE if status is Status.RANK_UNCERTAIN else "")
                status = Status.worst(status, Status.CONSTRAINTS_VIOLATED)
        return Solution(x, status, self._split(w), self._split(marks), stats, detail)

    def _split(self, values: _Array) -> tuple[_Array, ...]:
        ends: list[int] = self.stops[: len(self.shape.rows)]
        return tuple(values[a:z] for a, z in zip([0, *ends], ends, strict=False))
