"""Tie-breaking among the optima of all levels, written as levels: metric and origin, then least norm."""

from __future__ import annotations

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.problem import Hierarchy, Rows, Selection
from hqp.tolerances import METRIC_TOLERANCE


def metric_factor(metric: Mat, tolerance: float = METRIC_TOLERANCE) -> Mat:
    """F ``(n, n)`` with F' F = metric, by pivoted Cholesky; zero rows where the metric is singular.

    metric: ``(n, n)`` symmetric positive semidefinite; indefinite parts below the tolerance, which come from rounding,
    are cut.
    """
    from scipy.linalg import get_lapack_funcs  # heavy, and most stacks have no metric

    F = np.zeros_like(metric)
    largest = float(metric.diagonal().max(initial=0.0))
    if largest > 0.0:
        (pstrf,) = get_lapack_funcs(("pstrf",), (metric,))
        factor, pivots, rank, _ = pstrf(metric, tol=tolerance * largest)
        F[:rank, pivots - 1] = np.triu(factor)[:rank]
    return F


def completion(problem: Hierarchy) -> tuple[Rows, ...]:
    """Levels of n rows for the completion, below the levels of the problem: metric about origin, least norm."""
    n, origin = problem.n, problem.origin
    if problem.metric is None:
        return (_identity(np.zeros(n) if origin is None else origin),)
    F = metric_factor(problem.metric)
    target = np.zeros(n) if origin is None else F @ origin
    return Rows(F, target, target), _identity(np.zeros(n))


def _identity(target: Vec) -> Rows:
    return Rows(Selection(np.arange(target.size)), target, target)
