"""Families of random hierarchies with the fault in their name, and their neighbours.

A box, levels of a few rows with a price, a posture on every variable.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from hqp import Hierarchy, Rows, Selection
from hqp.arrays import Mat
from hqp.declare.price import TURNING
from hqp.problem import ETA, Motion

FAMILIES = {
    "plain": "rows of normal numbers",
    "small": "the least singular value of every level is 1e-6 to 1e-2",
    "parallel": "a row of each level is parallel to one of the level above but for 1e-6 to 1e-2",
    "contradictory": "a row of each level has the coefficients of one of the level above",
    "beyond": "targets are out of reach",
    "mixed": "small and parallel by chance",
    "hard": "two hard equality rows above, targets out of reach",
    "hard, small": "the same, the least singular value of the hard rows 1e-6 to 1e-2",
    "kinds": "rows of 0.1, 1 and 10 times the size in one level, targets out of reach",
    "inequalities": "rows are bounded from one side or both, out of reach",
    "flat": "two directions cost no motion, targets out of reach",
    "deep": "four levels out of reach, of small singular values by chance",
}
"""Description of each family."""

HARD = ("hard", "hard, small")
FAR = ("beyond", "hard", "hard, small", "kinds", "inequalities", "flat", "deep")

PRICE, SIZE = 0.1, 1.0
"""c_k and L_k of every level."""

DT = 0.002
"""Period of the ticks in which rows turn [s]."""

MOVED = 1e-6
"""Standard deviation of the change of all data."""


def levels(rng: Generator, family: str, inequalities: bool = True) -> list[Rows]:
    """Random levels of a family: a box, [hard rows,] levels of a few rows, a posture on every variable.

    inequalities: with the box, and sometimes a bound instead of a target.
    """
    n = int(rng.integers(4, 9))
    found: list[Rows] = []
    if inequalities:
        box = rng.uniform(0.5, 3.0, n)
        found.append(Rows(Selection(np.arange(n)), -box, box))
    if family in HARD:
        A = _small(rng, rng.standard_normal((2, n))) if family == "hard, small" else rng.standard_normal((2, n))
        place = A @ rng.uniform(-0.2, 0.2, n)
        found.append(Rows(A, place, place.copy()))
    above: Mat | None = None
    for _ in range(4 if family == "deep" else int(rng.integers(2, 4))):
        m = int(rng.integers(1, 4))
        A = 0.5 * rng.standard_normal((m, n))
        if family == "small" or (family in ("mixed", "deep") and rng.random() < 0.5):
            A = _small(rng, A)
        if above is not None and (family == "parallel" or (family == "mixed" and rng.random() < 0.4)):
            A[0] = above[0] + 10.0 ** rng.uniform(-6.0, -2.0) * rng.standard_normal(n)
        if above is not None and family == "contradictory":
            A[0] = above[0]
        if family == "kinds":
            A *= 10.0 ** rng.integers(-1, 2, m)[:, None]
        lower = rng.standard_normal(m) * (4.0 if family in FAR else 0.5)
        upper = lower.copy()
        if family == "inequalities":
            upper += np.where(rng.random(m) < 0.5, np.inf, 0.3)
        elif inequalities and rng.random() < 0.3:
            upper[-1] = np.inf if rng.random() < 0.5 else lower[-1] + 0.3
        found.append(Rows(A, lower, upper))
        above = A
    posture = rng.uniform(-1.0, 1.0, n)
    return [*found, Rows(np.eye(n), posture, posture.copy())]


def _small(rng: Generator, A: Mat) -> Mat:
    U, sigma, Vt = np.linalg.svd(A, full_matrices=False)
    sigma[-1] = 10.0 ** rng.uniform(-6.0, -2.0)
    return np.asarray(U * sigma @ Vt)


def problem(rng: Generator, family: str) -> Hierarchy:
    """Random hierarchy of a family; its levels have prices, except box, hard rows and posture."""
    found = levels(rng, family)
    n, hard = found[-1].m, 2 if family in HARD else 1
    prices = np.array([0.0] * hard + [PRICE] * (len(found) - hard - 1) + [0.0])
    motion = Motion(rng.standard_normal((n - 2, n))) if family == "flat" else None
    return priced(found, prices, hard, motion)


def priced(found: list[Rows], prices: Mat, hard: int, motion: Motion | None, size: float = SIZE) -> Hierarchy:
    """Hierarchy with the turning of velocities in ticks of DT; L_k = size."""
    turning = np.divide(1.0 / (TURNING[1] * ETA * size**2), prices, out=np.zeros(len(prices)), where=prices > 0.0)
    return Hierarchy(tuple(found), constraints=hard, prices=prices, motion=motion, turning=turning)


def neighbour(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """Change all data slightly, except the box and the posture."""
    moved = list(problem.levels)
    for k in range(1, len(moved) - 1):
        rows = moved[k]
        shift = MOVED * rng.standard_normal(rows.m)
        A = rows.dense(problem.n) + MOVED * rng.standard_normal((rows.m, problem.n))
        moved[k] = Rows(A, rows.lower + shift, rows.upper + shift)
    return replace(problem, levels=tuple(moved))
