"""Array types of the library: everything is float64, in C order unless said otherwise."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FLOAT = np.dtype(np.float64)

Vec: TypeAlias = NDArray[np.float64]
"""A vector ``(n,)`` of float64."""

Mat: TypeAlias = NDArray[np.float64]
"""A matrix ``(m, n)`` of float64."""

Index: TypeAlias = NDArray[np.intp]
"""A vector of positions ``(m,)``."""

Mask: TypeAlias = NDArray[np.bool_]
"""A vector of choices ``(m,)``."""

Signs: TypeAlias = NDArray[np.int8]
"""A vector of activity marks ``(m,)``, see :class:`hqp.problem.Solution`."""


def row_lengths(A: Mat) -> Vec:
    """The 2-norm of every row, ``(m,)``."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", A, A)))


def longest_row(A: Mat) -> float:
    """The largest 2-norm of a row, 0 where there is none."""
    return float(row_lengths(A).max(initial=0.0))
