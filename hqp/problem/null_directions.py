"""Directions that no level sees: rounding of the rows along these directions is removed.

Torques of closed loops are redundant: internal forces move nothing, every row of a task is orthogonal to them but for
rounding.  In a short row, or in the remainder of nearly dependent rows, rounding is large: a row of length 1e-9 with
1e-16 along an internal force tilts the null space of the rows by 1e-7, and levels below would buy a motion of 1e-4 with
1000 N m of it.  The rows are therefore judged without such directions, which only bounds, the metric and the norm see.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from hqp.arrays import Mat, longest_row, row_lengths
from hqp.problem import Hierarchy, Rows
from hqp.tolerances import NULL_SPACE_ROUNDING, UNSEEN_BY_METRIC


def null_directions(problem: Hierarchy) -> Mat:
    """An orthonormal basis ``(n, r)`` of the directions along which no row below the constraints is more than rounding.

    Rounding is NULL_SPACE_ROUNDING of the problem's longest row, by a QR factorisation with pivoting of all those rows.
    Bounds on single variables, where they are level 0, do not count.
    """
    from scipy.linalg import qr  # slow, and needed only for judged solutions

    dense = [rows.dense(problem.n) for rows in problem.levels]
    first = problem.constraints
    if first == 0 and dense and np.all(np.count_nonzero(dense[0], axis=1) == 1):
        first = 1
    counted = np.concatenate([np.zeros((0, problem.n)), *dense[first:]])
    factors: Any = qr(counted.T, pivoting=True)  # Q, R, the order of the rows
    longest = max((longest_row(A) for A in dense), default=0.0)
    rank = int(np.count_nonzero(np.abs(np.diagonal(factors[1])) > NULL_SPACE_ROUNDING * longest))
    return np.asarray(factors[0][:, rank:])


def without_rounding(problem: Hierarchy) -> Hierarchy:
    """Return the problem with rows and metric orthogonal to the directions that they see by rounding alone."""
    Z = null_directions(problem)
    if not Z.shape[1]:
        return problem
    longest = max((longest_row(rows.dense(problem.n)) for rows in problem.levels), default=0.0)
    levels = [_cleaned(rows, Z, NULL_SPACE_ROUNDING * longest) for rows in problem.levels]
    metric = problem.metric
    if metric is not None and longest_row(metric @ Z) <= UNSEEN_BY_METRIC * longest_row(metric):
        metric = metric - Z @ (Z.T @ metric)
        metric -= (metric @ Z) @ Z.T
        metric = 0.5 * (metric + metric.T)
    return replace(problem, levels=tuple(levels), metric=metric, stacked=None)


def _cleaned(rows: Rows, Z: Mat, rounding: float) -> Rows:
    """The rows without their parts along Z where those are rounding; unchanged where there is nothing to take out."""
    A = rows.dense(Z.shape[0])
    along = A @ Z
    lengths = row_lengths(along)
    small = (lengths > 0.0) & (lengths <= rounding)
    return Rows(A - (along * small[:, None]) @ Z.T, rows.lower, rows.upper) if small.any() else rows
