"""What chooses among the optima of all levels, written as levels: metric and origin, then least norm."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from hqp.arrays import Mat, Vec
from hqp.problem import Hierarchy, Rows, Selection

METRIC_TOLERANCE = 1e-10
"""Pivots of the metric below this fraction of its largest diagonal entry count as zero."""


def metric_factor(metric: Mat, tolerance: float = METRIC_TOLERANCE) -> Mat:
    """F ``(rank, n)`` with F' F = metric, by pivoted Cholesky; singular metrics give fewer rows.

    metric: ``(n, n)`` symmetric positive semidefinite; what rounding makes indefinite below the tolerance is cut.
    """
    largest = float(metric.diagonal().max(initial=0.0))
    if largest <= 0.0:
        return np.zeros((0, metric.shape[0]))
    factor, pivots, rank, _ = lapack.dpstrf(metric, tol=tolerance * largest)
    F = np.zeros((rank, metric.shape[0]))
    F[:, pivots - 1] = np.triu(factor)[:rank]
    return F


def completion(problem: Hierarchy) -> tuple[Rows, ...]:
    """Levels that, put below those of the problem, make its solution unique and its completion explicit."""
    n, origin = problem.n, problem.origin
    if problem.metric is None:
        return (_identity(n, np.zeros(n) if origin is None else origin),)
    F = metric_factor(problem.metric)
    target = np.zeros(F.shape[0]) if origin is None else F @ origin
    if F.shape[0] == n:
        return (Rows(F, target, target),)
    return Rows(F, target, target), _identity(n, np.zeros(n))


def _identity(n: int, target: Vec) -> Rows:
    return Rows(Selection(np.arange(n)), target, target)
