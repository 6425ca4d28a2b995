"""Noise of rounding in the rows of a hierarchy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from hqp import Hierarchy, Rows

NOISE = 1e-12
"""Standard deviation, as a share of each number."""


def noisy(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """The problem with noise in every dense row and its bounds."""
    levels = []
    for rows in problem.levels:
        if isinstance(rows.A, np.ndarray):
            factor = 1.0 + NOISE * rng.standard_normal(rows.m)
            A = rows.A * (1.0 + NOISE * rng.standard_normal(rows.A.shape))
            rows = Rows(A, rows.lower * factor, rows.upper * factor)
        levels.append(rows)
    return replace(problem, levels=tuple(levels), stacked=None)
