"""ProxQP through proxsuite, with a kept workspace that starts from its previous answer (Bambade et al. 2022)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from proxsuite import proxqp  # pyright: ignore[reportMissingImports]

from hqp.arrays import Mat, Vec
from hqp.errors import BackendError
from hqp.solvers.backends.base import QpAnswer


@dataclass(frozen=True)
class Proxqp:
    """Dense ProxQP at an absolute tolerance.

    feasible: the programs are feasible and bounded by construction; at degenerate points ProxQP doubts it.
    """

    tolerance: float
    max_iterations: int
    feasible: bool = True

    def workspace(self, n: int, m: int) -> ProxqpWorkspace:
        """Allocate for n variables and m two-sided rows."""
        return ProxqpWorkspace(self, n, m)


class ProxqpWorkspace:
    """One proxqp.dense.QP, updated in place from the second solve on."""

    def __init__(self, options: Proxqp, n: int, m: int) -> None:
        self._qp = proxqp.dense.QP(n, 0, m)
        settings = self._qp.settings
        settings.eps_abs, settings.eps_rel = options.tolerance, 0.0
        settings.max_iter = options.max_iterations
        if options.feasible:
            settings.eps_primal_inf = settings.eps_dual_inf = 1e-14
        settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._started = False

    def solve(self, H: Mat, g: Vec, C: Mat, lower: Vec, upper: Vec) -> QpAnswer:
        """As QpWorkspace.solve."""
        qp = self._qp
        try:
            (qp.update if self._started else qp.init)(H, g, None, None, C, lower, upper)
            self._started = True
            qp.solve()
        except Exception as error:
            raise BackendError(f"proxqp: {error}") from error
        info = qp.results.info
        solved = info.status == proxqp.QPSolverOutput.PROXQP_SOLVED
        return QpAnswer(np.array(qp.results.x), np.array(qp.results.z), solved, int(info.iter), info.status.name)
