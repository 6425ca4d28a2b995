"""`daqp`: the hierarchical mode of DAQP itself, all levels in one dual active set."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import daqp
import numpy as np

from hqp.arrays import Vec
from hqp.errors import BackendError
from hqp.problem import Hierarchy, Shape, Solution, Stats
from hqp.solvers.base import Solver, Workspace, check_fields
from hqp.solvers.conclude import conclude
from hqp.solvers.flat import Flat
from hqp.solvers.refine import Refiner
from hqp.solvers.stages import StagedWorkspace
from hqp.tolerances import RANK_TOLERANCE


@dataclass(frozen=True)
class Daqp(Solver):
    """lexmin of all levels at once through ``daqp.solve(..., break_points=...)`` (Arnstrom et al. 2022).

    DAQP scales every row to length 1, which would change the norm of a level's slack.  That is undone here by one more
    variable s, fixed to zero by a level of its own above all others: row i becomes [a_i, sqrt(r^2 - |a_i|^2)] with r
    the largest row norm of its level, so that all rows of a level are scaled alike.
    tolerance: DAQP's primal tolerance, absolute, on rows of length 1.  max_iterations, rank_tolerance, refine,
    exchanges: as in cascade.
    """

    name: ClassVar[str] = "daqp"
    accuracy: ClassVar[float] = 1e-8
    priced: ClassVar[bool] = True

    tolerance: float = 1e-6
    max_iterations: int = 1000
    rank_tolerance: float = RANK_TOLERANCE
    refine: bool = True
    exchanges: int = 100

    def __post_init__(self) -> None:
        check_fields(self, shares=("tolerance", "rank_tolerance"), counts=("max_iterations", "exchanges"))

    def workspace(self, shape: Shape) -> Workspace:
        """Allocate."""
        self.require(shape)
        if shape.priced:
            return StagedWorkspace(shape, self.workspace)
        return DaqpWorkspace(self, shape)


class DaqpWorkspace:
    """The rows in DAQP's layout: the fixed variable's row first, then all levels, then the completion."""

    def __init__(self, solver: Daqp, shape: Shape) -> None:
        self.solver = solver
        self.flat = Flat(shape, complete=True)
        self.refiner = Refiner(self.flat, solver.rank_tolerance, solver.exchanges) if solver.refine else None
        M = self.flat.A.shape[0]
        self._A = np.zeros((M + 1, shape.n + 1))
        self._A[0, -1] = 1.0
        self._lower, self._upper = np.zeros(M + 1), np.zeros(M + 1)
        self._sense = np.zeros(M + 1, dtype=np.int32)
        self._breaks = np.array([0, 1, *(stop + 1 for stop in self.flat.stops)], dtype=np.int32)

    def reset(self) -> None:
        """Nothing is kept between solves."""

    def solve(self, problem: Hierarchy) -> Solution:
        """The solution, exact where it could be confirmed; NOT_CERTIFIED, naming the level, where it could not."""
        began = perf_counter()
        flat = self.flat
        unusable = flat.load(problem)
        if unusable:
            return flat.refuse(problem, Stats(build_s=perf_counter() - began), unusable)
        self._fill()
        built = perf_counter()
        x, iterations, complaint = self._solve_qp()
        stats = Stats(iterations, 0, built - began, perf_counter() - built)
        nearness = max(1e-7, self.solver.tolerance)
        return conclude(problem, flat, self.refiner, x, nearness, self.solver.accuracy, stats, complaint)

    def _fill(self) -> None:
        flat = self.flat
        squares = np.einsum("ij,ij->i", flat.A, flat.A)
        start = 0
        for stop in flat.stops:
            part = squares[start:stop]
            self._A[1 + start : 1 + stop, -1] = np.sqrt(part.max(initial=0.0) - part)
            start = stop
        self._A[1:, :-1] = flat.A
        self._lower[1:], self._upper[1:] = flat.lower, flat.upper

    def _solve_qp(self) -> tuple[Vec, int, str]:
        """DAQP's x, its iterations, and what it complains of."""
        settings = {"primal_tol": self.solver.tolerance, "iter_limit": self.solver.max_iterations}
        arguments = (None, None, self._A, self._upper, self._lower, self._sense)
        try:
            x, _, flag, info = daqp.solve(*arguments, break_points=self._breaks, **settings)
        except Exception as error:
            raise BackendError(f"daqp: {error}") from error
        x = np.array(x)[:-1]
        if not np.isfinite(x).all():
            return np.zeros(x.size), int(info["iterations"]), "daqp found no answer"
        return x, int(info["iterations"]), "" if flag > 0 else f"daqp ended with exit flag {flag}"
