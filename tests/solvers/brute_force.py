"""Norms of a small hierarchy by trying every side of every row, without code of a solver."""

from __future__ import annotations

from itertools import product

import numpy as np

from hqp import Hierarchy
from hqp.arrays import Mat, Vec

NEAR = 1e-9


def norms(problem: Hierarchy) -> Vec:
    """|w_k|| of every level ``(levels,)``; the first level must bound every variable, so that optima have vertices.

    Level k is convex and quadratic as long as no row changes its side, so that its optimum is the least-squares point
    of some choice: rows of level k inside or beyond a bound, rows above free or at a bound.
    """
    n = problem.n
    fixed: list[tuple[Vec, float]] = []
    free: list[tuple[Vec, float, float]] = []
    found = []
    for rows in problem.levels:
        A, low, high = rows.dense(n), rows.lower, rows.upper
        best, at = np.inf, np.zeros(n)
        choices = [_sides(lower, upper) for _, lower, upper in free]
        own = [(0,) if lower == upper else _sides(lower, upper) for lower, upper in zip(low, high, strict=True)]
        for held in product(*choices):
            ends = [(a, (low_, high_)[side > 0]) for (a, low_, high_), side in zip(free, held, strict=True) if side]
            for sides in product(*own):
                x = _least_squares(
                    [*fixed, *ends],
                    [(a, u if s > 0 else lo) for a, lo, u, s in zip(A, low, high, sides, strict=True) if s or lo == u],
                    n,
                )
                if x is None or any(not lo - NEAR <= a @ x <= up + NEAR for a, lo, up in free):
                    continue
                value = float(np.linalg.norm(rows.slack(x)))
                if value < best:
                    best, at = value, x
        found.append(best)
        w = rows.slack(at)
        for a, lo, up, slack in zip(A, low, high, w, strict=True):
            if lo == up or abs(slack) > NEAR:
                fixed.append((a, float(a @ at)))
            else:
                free.append((a, lo, up))
    return np.array(found)


def _sides(lower: float, upper: float) -> tuple[int, ...]:
    return tuple(side for side, bound in ((0, 0.0), (-1, lower), (1, upper)) if np.isfinite(bound))


def _least_squares(fixed: list[tuple[Vec, float]], wanted: list[tuple[Vec, float]], n: int) -> Vec | None:
    """The shortest x that meets the fixed rows and is nearest to the wanted ones; None if the fixed rows conflict."""
    C, d = _stack(fixed, n)
    x = np.linalg.lstsq(C, d, rcond=1e-10)[0]
    if np.any(np.abs(C @ x - d) > NEAR):
        return None
    _, sigma, Vt = np.linalg.svd(C)
    Z = Vt[int(np.count_nonzero(sigma > 1e-10)) :].T
    A, b = _stack(wanted, n)
    return np.asarray(x + Z @ np.linalg.lstsq(A @ Z, b - A @ x, rcond=1e-10)[0])


def _stack(rows: list[tuple[Vec, float]], n: int) -> tuple[Mat, Vec]:
    return np.array([a for a, _ in rows]).reshape(-1, n), np.array([b for _, b in rows])
