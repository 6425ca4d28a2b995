"""How far a point is from others that meet its rows to rounding.

A row within the tolerance of its bound counts as active, and as met.  Between rows nearly opposed that is not enough:
those missed by 1e-8 move the point by 1e-8 over the angle between them.  Each row has an error, rounding of its value
and of its bound, and one that is beyond its bound by more is missed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqp.arrays import Mat, Vec, row_lengths
from hqp.problem import Rows
from hqp.problem.judge import Judge
from hqp.problem.pricing import stack_rows
from hqp.tolerances import CERTIFIED_RANK_TOLERANCE, EITHER_RANK, NULL_SPACE_ROUNDING, RESTS, ROW_ERROR


def motion_to_bounds(
    levels: Sequence[Rows],
    x: Vec,
    judge: Judge,
    free: Mat,
    left: Sequence[float] = (),
    more: float | Vec = 0.0,
) -> float:
    """Length of the least motion, relative to 1 + ||x||, that meets the rows which x misses; zero if it misses none.

    It keeps rows that are fixed and rows in its way, each to its error.  judge: that has taken in the levels.  free:
    ``(n, r)``, directions that no level sees: they cost little, and do not count.  left: ||g_k||, what the multipliers
    leave of the gradient of each level; its slack stays if ||w||^2 > ||g|| (1 + ||x||): then no point so near has none.
    All other rows are to be met.  more: error ``(m,)`` beside rounding.
    """
    rows = stack_rows(levels, x.size)
    A, real = rows.dense(x.size), judge.lengths[: rows.m] > 0.0
    sizes = np.where(real, lengths := row_lengths(A), 1.0)
    error = (ROW_ERROR * (lengths + np.abs(A) @ np.abs(x)) + more) / sizes
    unit, value = A * (real / sizes)[:, None], real * (A @ x) / sizes
    lower = np.where(real, rows.lower / sizes, -np.inf)
    upper = np.where(real, rows.upper / sizes, np.inf)
    off = value - np.clip(value, lower, upper)
    out = np.abs(off) > error
    if not out.any():
        return 0.0
    end, far = 0, 1.0 + float(np.linalg.norm(x))
    for level, rest in zip(levels, left, strict=False):
        own, end = slice(end, end + level.m), end + level.m
        w = level.slack(x)
        rounding = float(np.linalg.norm(error[own] * sizes[own])) * float(np.linalg.norm(w))
        if out[own].any() and float(w @ w) > rest * far + rounding:
            lower[own], upper[own] = np.minimum(lower, value)[own], np.maximum(upper, value)[own]
    move = _back(unit, value, lower, upper, error, judge, free)
    return float(np.linalg.norm(move - free @ (free.T @ move))) / far


def _back(unit: Mat, value: Vec, lower: Vec, upper: Vec, error: Vec, judge: Judge, free: Mat) -> Vec:
    """The least motion ``(n,)`` that takes rows back that are beyond their bounds, and keeps others.

    Rows of unit length enter one by one, orthogonally, and an error grows as the remainder of its row gets short."""
    n, off = free.shape[0], value - np.clip(value, lower, upper)
    off[np.abs(off) <= error] = 0.0
    order = [*np.flatnonzero(off), *np.flatnonzero(judge.fixed[: off.size] & (off == 0.0))]
    scaled = unit + (1.0 / RESTS - 1.0) * (unit @ free) @ free.T
    while True:
        Q, part, grown = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        rank = 0
        for i in order:
            if rank == n:
                break
            along, rest = np.zeros(n), scaled[i]
            for _ in range(2):
                along += (again := Q @ rest)
                rest = rest - again @ Q
            length = float(np.linalg.norm(rest))
            rounding = NULL_SPACE_ROUNDING * float(np.linalg.norm(scaled[i]))
            if length <= max(EITHER_RANK * CERTIFIED_RANK_TOLERANCE, rounding):
                continue
            most, by = error[i] + np.abs(along) @ grown, off[i] + along @ part
            Q[rank], grown[rank] = rest / length, most / length
            part[rank] = -np.sign(by) * max(abs(by) - most, 0.0) / length
            rank += 1
        move = Q.T @ part
        move += (1.0 / RESTS - 1.0) * free @ (free.T @ move)
        there = value + unit @ move
        beyond = (there > upper + error) | (there < lower - error)
        beyond[order] = False
        if not beyond.any():
            return move
        for i in np.flatnonzero(beyond):
            off[i] = value[i] - (upper[i] if there[i] > upper[i] else lower[i])
            order.append(i)
