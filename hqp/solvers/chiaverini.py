"""`chiaverini`: the prioritised inverse of Mistry 2008 exactly as printed; strict for the first level alone."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.numbers import set_numbers
from hqp.problem import Hierarchy, Shape, Solution, Stats, Status
from hqp.solvers.base import Solver
from hqp.solvers.flat import Flat
from hqp.solvers.recursion import Recursion
from hqp.tolerances import MET_TOLERANCE, RANK_TOLERANCE


@dataclass(frozen=True)
class Chiaverini(Solver):
    """x = J_A^+ x_A + N_A J_B^+ x_B + N_AB J_E^+ x_E + ..., N_AB = I - [J_A; J_B]^+ [J_A; J_B] (Mistry 2008, 16-17).

    Each task is inverted by itself and then projected (Chiaverini 1997), so that only the first level reaches its
    optimum for certain: strict is False, and a lower level whose residual is not zero marks the answer NOT_STRICT.
    Constraints that a stack is subject to are the first level ("critical"), the next one is B. damping: lambda of
    footnote 3, N_A N_AB^lambda in place of N_AB from the third level on, 0 as printed in (16). rank_tolerance,
    ignore_inequalities: see Nullspace.
    """

    name: ClassVar[str] = "chiaverini"
    inequalities: ClassVar[bool] = False
    strict: ClassVar[bool] = False
    metric: ClassVar[bool] = False
    accuracy: ClassVar[float] = 1e-8

    damping: float = 0.0
    rank_tolerance: float = RANK_TOLERANCE
    ignore_inequalities: bool = False

    def __post_init__(self) -> None:
        set_numbers(self, "chiaverini", ("rank_tolerance",), 0.0, strict=True, below=1.0)
        set_numbers(self, "chiaverini", ("damping",), 0.0)

    def workspace(self, shape: Shape) -> ChiaveriniWorkspace:
        """Allocate; raises UnsupportedProblem for inequalities, metric and origin."""
        self.require(shape)
        return ChiaveriniWorkspace(self, shape)


class ChiaveriniWorkspace:
    """Buffers of one shape; there is no warm start."""

    def __init__(self, solver: Chiaverini, shape: Shape) -> None:
        self.flat = Flat(shape)
        self.above = Recursion(shape.n, solver.rank_tolerance)
        self.alone = Recursion(shape.n, solver.rank_tolerance)
        self.damping = solver.damping

    def reset(self) -> None:
        """Nothing is kept between solves."""

    def solve(self, problem: Hierarchy) -> Solution:
        """The sum of projected inverses; OPTIMAL where every level below the first is met, else NOT_STRICT."""
        began = perf_counter()
        flat = self.flat
        unusable = flat.load(problem)
        if unusable:
            return flat.refuse(problem, Stats(build_s=perf_counter() - began), unusable)
        A, b, stops = flat.equations()
        built = perf_counter()
        x = np.zeros(problem.n)
        uncertain, start = False, 0
        self.above.solve(A, b, stops)
        for k, stop in enumerate(stops):
            if stop > start:
                self.alone.solve(A[start:stop], b[start:stop], [stop - start], least=self.above.least)
                uncertain |= self.alone.uncertain
                x += self._project(self.alone.point(), k, A[:start])
            start = stop
        status, detail = Status.OPTIMAL, ""
        if not self._met(x, self.flat.stops[0] if self.flat.stops else 0):
            status, detail = Status.NOT_STRICT, "equation (16) does not minimise the levels below the first"
        elif uncertain or self.above.uncertain:
            status, detail = Status.RANK_UNCERTAIN, "a pivot is near rank_tolerance"
        return flat.finish(problem, x, status, Stats(0, len(stops) + 1, built - began, perf_counter() - built), detail)

    def _project(self, v: Vec, k: int, J: Mat) -> Vec:
        """N v for level k: I, N_A, N_AB, ..., or N_A N_AB^lambda from the third level on (footnote 3)."""
        if self.damping == 0.0 or k < 2:
            return self.above.project(v, k)
        inner = J @ J.T
        inner[np.diag_indices_from(inner)] += self.damping**2
        return self.above.project(v - J.T @ np.linalg.solve(inner, J @ v), 1)

    def _met(self, x: Vec, first: int) -> bool:
        """Return true if all equalities below the first level and all inequalities have a negligible residual."""
        flat = self.flat
        w = np.abs(flat.slack(x))
        w[:first] *= flat.inequality[:first]
        bound = np.where(flat.equality, np.abs(flat.lower), 1.0)
        return bool(np.all(w <= MET_TOLERANCE * (np.abs(flat.A) @ np.abs(x) + bound)))
