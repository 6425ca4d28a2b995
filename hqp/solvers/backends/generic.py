"""Every other back end, through qpsolvers: nothing is kept between solves but the previous answer as a start."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import qpsolvers

from hqp.arrays import Mat, Vec
from hqp.errors import BackendError, DeclarationError
from hqp.solvers.backends.base import QpAnswer

_TOLERANCES: dict[str, Callable[[float], dict[str, float]]] = {
    "clarabel": lambda t: {"tol_feas": t, "tol_gap_abs": t, "tol_gap_rel": t},
    "daqp": lambda t: {"primal_tol": t, "dual_tol": t},
    "piqp": lambda t: {"eps_abs": t, "eps_rel": 0.0, "eps_duality_gap_abs": t, "eps_duality_gap_rel": 0.0},
    "qpswift": lambda t: {"ABSTOL": t, "RELTOL": 0.0},
    "scs": lambda t: {"eps_abs": t, "eps_rel": 0.0},
}
"""Option names of each package for an absolute tolerance; one that is missing here runs at its default."""

_RIDGE = {"daqp": 1e-9, "quadprog": 1e-9}
"""Addition to the diagonal of H for packages that need it positive definite, relative to its largest entry."""

_SPARSE = {"clarabel", "highs", "qpalm", "scs"}


@dataclass(frozen=True)
class Generic:
    """A solver of qpsolvers by name."""

    name: str
    tolerance: float
    max_iterations: int

    def __post_init__(self) -> None:
        if self.name not in qpsolvers.available_solvers:
            known = ", ".join(sorted({"proxqp", "osqp", *qpsolvers.available_solvers}))
            raise DeclarationError("cascade", "unknown back end", value=self.name, allowed=known)

    def workspace(self, n: int, m: int) -> GenericWorkspace:
        """Hold the previous answer for n variables and m rows."""
        return GenericWorkspace(self)


class GenericWorkspace:
    """The options, and the answer to start from."""

    def __init__(self, options: Generic) -> None:
        self._name = options.name
        self._ridge = _RIDGE.get(options.name, 0.0)
        spell = _TOLERANCES.get(options.name)
        self._tolerances: dict[str, Any] = spell(options.tolerance) if spell else {}
        self._start: Vec | None = None

    def solve(self, H: Mat, g: Vec, C: Mat, lower: Vec, upper: Vec) -> QpAnswer:
        """As QpWorkspace.solve; two-sided rows become two."""
        if self._ridge:
            H = H + self._ridge * H.diagonal().max(initial=0.0) * np.eye(H.shape[0])
        above, below = np.isfinite(upper), np.isfinite(lower)
        G, h = np.concatenate([C[above], -C[below]]), np.concatenate([upper[above], -lower[below]])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # packages recommend sparse matrices
                problem = qpsolvers.Problem(*self._matrices(H, g, G), h)
                found = qpsolvers.solve_problem(problem, self._name, initvals=self._start, **self._tolerances)
        except Exception as error:
            raise BackendError(f"{self._name}: {error}") from error
        if found.x is None or not np.isfinite(found.x).all():
            raise BackendError(f"{self._name} found no solution")
        multipliers = np.zeros(C.shape[0])
        if found.z is not None and found.z.size == h.size:
            count = int(np.count_nonzero(above))
            multipliers[above] += found.z[:count]
            multipliers[below] -= found.z[count:]
        self._start = np.array(found.x)
        iterations = int((found.extras or {}).get("iter", 0) or 0)
        return QpAnswer(self._start, multipliers, bool(found.found), iterations, "solved" if found.found else "stopped")

    def _matrices(self, H: Mat, g: Vec, G: Mat) -> tuple[Any, Vec, Any]:
        if self._name not in _SPARSE:
            return H, g, G
        from scipy import sparse

        return sparse.csc_matrix(H), g, sparse.csc_matrix(G)
