"""Quadratic programs through third-party packages; a package is imported only by its adapter, on first use."""

from __future__ import annotations

from hqp.solvers.backends.base import Backend, QpAnswer, QpWorkspace

__all__ = ["Backend", "QpAnswer", "QpWorkspace", "load"]


def load(name: str, tolerance: float, max_iterations: int, feasible: bool = True) -> Backend:
    """The back end of that name: ProxQP and OSQP through their own packages, any other through qpsolvers.

    tolerance: absolute, on every optimality condition.  feasible: the programs are known to be feasible and bounded.
    Raises DeclarationError for an unknown back end.
    """
    if name == "proxqp":
        from hqp.solvers.backends.proxqp import Proxqp

        return Proxqp(tolerance, max_iterations, feasible)
    if name == "osqp":
        from hqp.solvers.backends.osqp import Osqp

        return Osqp(tolerance, max_iterations)
    from hqp.solvers.backends.generic import Generic

    return Generic(name, tolerance, max_iterations)
