"""`daqp`: the hierarchical mode of DAQP itself, all levels in one dual active set."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import daqp
import numpy as np

from hqp.arrays import Vec
from hqp.errors import BackendError
from hqp.problem import Shape, Stats
from hqp.solvers.external import External, ExternalWorkspace


@dataclass(frozen=True)
class Daqp(External):
    """lexmin of all levels at once through ``daqp.solve(..., break_points=...)`` (Arnstrom et al. 2022).

    DAQP scales every row to length 1, which would change the norm of a level's slack.  One more variable s, fixed to
    zero by a level of its own above all others, undoes this: row i becomes [a_i, sqrt(r^2 - |a_i|^2)] with r the
    largest row norm of its level, so that all rows of a level are scaled alike.  Its options are those of External;
    tolerance is DAQP's primal one.
    """

    name: ClassVar[str] = "daqp"

    tolerance: float = 1e-6
    max_iterations: int = 1000

    def exact(self, shape: Shape) -> DaqpWorkspace:
        """A workspace for hierarchies without prices."""
        return DaqpWorkspace(self, shape)


class DaqpWorkspace(ExternalWorkspace):
    """The rows in DAQP's layout: the fixed variable's row first, then all levels, then the completion."""

    def __init__(self, solver: Daqp, shape: Shape) -> None:
        super().__init__(solver, shape, trusted=max(1e-7, solver.tolerance))
        self.solver = solver
        M = self.flat.A.shape[0]
        self._A = np.zeros((M + 1, shape.n + 1))
        self._A[0, -1] = 1.0
        self._lower, self._upper = np.zeros(M + 1), np.zeros(M + 1)
        self._sense = np.zeros(M + 1, dtype=np.int32)
        self._breaks = np.array([0, 1, *(stop + 1 for stop in self.flat.stops)], dtype=np.int32)

    def find(self, began: float) -> tuple[Vec, Stats, str]:
        """x of all levels at once."""
        self._fill()
        built = perf_counter()
        x, iterations, complaint = self._solve_qp()
        return x, Stats(iterations, 0, built - began, perf_counter() - built), complaint

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
        """DAQP's x, its iterations, and its complaint."""
        settings = {"primal_tol": self.solver.tolerance, "iter_limit": self.solver.max_iterations}
        arguments = (None, None, self._A, self._upper, self._lower, self._sense)
        try:
            x, _, flag, info = daqp.solve(*arguments, break_points=self._breaks, **settings)
        except Exception as error:
            raise BackendError(f"daqp: {error}") from error
        x = np.array(x)[:-1]
        if not np.isfinite(x).all():
            return np.zeros(x.size), int(info["iterations"]), "daqp found no solution"
        return x, int(info["iterations"]), "" if flag > 0 else f"daqp ended with exit flag {flag}"
