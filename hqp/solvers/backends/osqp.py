"""OSQP with a kept, warm-started workspace; first order: the iteration limit bounds its accuracy (Stellato 2020)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import osqp
from scipy import sparse

from hqp.arrays import Mat, Vec
from hqp.errors import BackendError
from hqp.solvers.backends.base import QpAnswer


@dataclass(frozen=True)
class Osqp:
    """OSQP at a tolerance, absolute and relative alike."""

    tolerance: float
    max_iterations: int

    def workspace(self, n: int, m: int) -> OsqpWorkspace:
        """Allocate for n variables and m two-sided rows."""
        return OsqpWorkspace(self, n, m)


class OsqpWorkspace:
    """One osqp.OSQP over full patterns, so that every later problem of the size is an update."""

    def __init__(self, options: Osqp, n: int, m: int) -> None:
        self._options = options
        self._solver: Any = None
        self._upper_triangle = np.triu_indices(n)
        order = np.lexsort(self._upper_triangle)  # columns first, as a compressed sparse column matrix stores them
        self._upper_triangle = (self._upper_triangle[0][order], self._upper_triangle[1][order])
        self._n, self._m = n, m

    def solve(self, H: Mat, g: Vec, C: Mat, lower: Vec, upper: Vec) -> QpAnswer:
        """As QpWorkspace.solve."""
        Px, Ax = H[self._upper_triangle], C.T.ravel()
        try:
            if self._solver is None:
                self._solver = self._setup(Px, g, Ax, lower, upper)
            else:
                self._solver.update(Px=Px, q=g, Ax=Ax, l=lower, u=upper)
            result = self._solver.solve(raise_error=False)
        except Exception as error:
            raise BackendError(f"osqp: {error}") from error
        solved = result.info.status == "solved"
        return QpAnswer(np.array(result.x), np.array(result.y), solved, int(result.info.iter), result.info.status)

    def _setup(self, Px: Vec, g: Vec, Ax: Vec, lower: Vec, upper: Vec) -> Any:
        n, m = self._n, self._m
        i, j = self._upper_triangle
        P = sparse.csc_matrix((Px, i, np.concatenate([[0], np.cumsum(np.bincount(j, minlength=n))])), shape=(n, n))
        A = sparse.csc_matrix((Ax, np.tile(np.arange(m), n), m * np.arange(n + 1)), shape=(m, n))
        solver = osqp.OSQP()
        solver.setup(
            P,
            g,
            A,
            lower,
            upper,
            verbose=False,
            eps_abs=self._options.tolerance,
            eps_rel=self._options.tolerance,
            max_iter=self._options.max_iterations,
        )
        return solver
