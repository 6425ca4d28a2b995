"""Hard random hierarchies: a seed gives one problem."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from hqp import Hierarchy, Rows, Selection
from hqp.arrays import Mat, Vec


def hierarchy(seed: int, largest: int = 100) -> Hierarchy:
    """Bounds, rank-deficient, linked, conflicting, duplicated and zero rows, levels scaled by 1e-3..1e3, left-out rows,
    equalities and inequalities mixed, selections, singular metrics and origins; n up to ``largest``."""
    rng = np.random.default_rng(seed)
    n = _size(rng, largest)
    whole = bool(rng.random() < 0.25)  # small integers: degenerate vertices
    levels = [_bounds(rng, n)] if rng.random() < 0.5 else []
    above: Mat | None = None
    for _ in range(int(rng.integers(1, 7))):
        rows, above = _level(rng, n, above, whole)
        levels.append(rows)
    if rng.random() < 0.5:
        index = np.arange(n) if rng.random() < 0.5 else rng.permutation(n)[: rng.integers(1, n + 1)]
        target = rng.normal(size=index.size)
        levels.append(Rows(Selection(index), target, target.copy()))
    metric = origin = None
    if rng.random() < 0.2:
        root = rng.normal(size=(n, int(rng.integers(1, n + 1))))
        metric = (root @ root.T + (root @ root.T).T) / 2.0
    if rng.random() < 0.2:
        origin = rng.normal(size=n)
    return Hierarchy(tuple(levels), int(rng.integers(0, len(levels) + 1)), metric, origin)


def _size(rng: Generator, largest: int) -> int:
    draw = rng.random()
    if draw < 0.6:
        return int(rng.integers(1, 12))
    return int(rng.integers(2, 40)) if draw < 0.95 else int(rng.integers(10, largest + 1))


def _bounds(rng: Generator, n: int) -> Rows:
    """Level 0 as limits on some variables: two-sided, one-sided, fixed, a corner at zero, scaled or not."""
    index = rng.permutation(n)[: rng.integers(1, n + 1)]
    scale = np.ones(index.size) if rng.random() < 0.7 else rng.choice([-2.0, 0.5, 3.0, 1e-2], size=index.size)
    limit = float(rng.choice([0.1, 0.5, 1.0, 3.0]))
    lower, upper = -limit * rng.random(index.size), limit * rng.random(index.size)
    if rng.random() < 0.2:
        lower[:] = 0.0
    draw, fixed = rng.random(index.size), rng.random(index.size) < 0.05
    lower[draw < 0.1], upper[draw > 0.9] = -np.inf, np.inf
    upper[fixed] = np.where(np.isfinite(lower[fixed]), lower[fixed], 0.0)
    lower[fixed] = upper[fixed]
    return Rows(Selection(index, scale), lower, upper)


def _level(rng: Generator, n: int, above: Mat | None, whole: bool) -> tuple[Rows, Mat]:
    m = int(rng.integers(1, max(2, min(n, 25) + 1))) if rng.random() < 0.7 else int(rng.integers(1, 5))
    A = _matrix(rng, m, n, whole)
    if above is not None and rng.random() < 0.4:  # repeat rows of the level above, or oppose them
        again = rng.integers(0, len(above), size=max(1, m // 2))
        A[: again.size] = above[again] * (1.0 if rng.random() < 0.5 else -1.0)
        if rng.random() < 0.3 and len(above) > 1:
            A[0] = above[0] + above[1]
    if m > 1 and rng.random() < 0.3:
        A[1] = A[0]
    if rng.random() < 0.1:
        A[rng.integers(m)] = 0.0
    lower, upper = _sides(rng, m, whole)
    scale = 10.0 ** rng.uniform(-3.0, 3.0) if rng.random() < 0.5 else 1.0
    return Rows(A * scale, lower * scale, upper * scale), A


def _matrix(rng: Generator, m: int, n: int, whole: bool) -> Mat:
    if whole:
        return rng.integers(-2, 3, size=(m, n)).astype(np.float64)
    if rng.random() < 0.4:
        rank = int(rng.integers(1, min(m, n) + 1))
        return np.asarray(rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n)))
    return rng.normal(size=(m, n))


def _sides(rng: Generator, m: int, whole: bool) -> tuple[Vec, Vec]:
    centre = rng.integers(-2, 3, size=m).astype(np.float64) if whole else rng.normal(size=m)
    width = rng.integers(0, 3, size=m).astype(np.float64) if whole else 2.0 * rng.random(m)
    share, draw = rng.choice([0.0, 0.5, 1.0], p=[0.3, 0.5, 0.2]), rng.random(m)
    between = rng.random(m) < share
    lower, upper = centre - between * width, centre + between * width
    lower[between & (draw < 0.35)], upper[between & (draw > 0.65)] = -np.inf, np.inf
    if rng.random() < 0.05:
        lower[0], upper[0] = -np.inf, np.inf
    return lower, upper
