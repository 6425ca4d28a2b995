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
