"""Array types of the library: float64 in C order by default."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hqp.errors import ProblemError

FLOAT = np.dtype(np.float64)
_EPS = float(np.finfo(np.float64).eps)

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


def floats(what: str, given: object) -> NDArray[np.float64]:
    """``given`` as float64, itself where it is such an array.

    Raises ProblemError with the name ``what`` for text, complex numbers, dates, objects and sequences of unequal
    length.
    """
    try:
        array = np.asarray(given)
    except (TypeError, ValueError) as error:
        raise ProblemError(f"{what}: must be an array of real numbers; {error}") from None
    if array.dtype == FLOAT:
        return array
    if array.dtype.kind not in "biuf":
        shown = array.dtype if array.ndim else type(given).__name__
        raise ProblemError(f"{what}: must be an array of real numbers, given {shown}")
    return array.astype(np.float64)


def is_readable(array: NDArray[Any]) -> bool:
    """Return true if native code can read the array in place: in C order and aligned."""
    return array.flags.c_contiguous and array.flags.aligned


def readable(array: object, dtype: type = np.float64) -> NDArray[Any]:
    """The array where native code can read it, else a copy that it can."""
    return np.require(array, dtype, ("C", "A"))


_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """a x b of vectors ``(..., 3)``, the bits of numpy.cross, which takes several times as long."""
    if a.ndim == b.ndim == 1:
        (x, y, z), (u, v, w) = a.tolist(), b.tolist()
        return np.array((y * w - z * v, z * u - x * w, x * v - y * u))
    return np.asarray(a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT])


def rank(A: Mat, rtol: float | None = None) -> int:
    """Return the rank of A, 0 for an empty matrix.

    rtol: singular values below rtol times the largest count as zero; None takes max(m, n) eps, as NumPy does.
    """
    sizes = np.linalg.svd(A, compute_uv=False) if A.size else np.zeros(0)
    return int(np.count_nonzero(sizes > (max(A.shape) * _EPS if rtol is None else rtol) * sizes.max(initial=0.0)))


def right_vectors(A: Mat) -> tuple[Vec, Mat]:
    """Singular values of A ``(m, n)`` and all right singular vectors, ``(min(m, n),)`` and ``(n, n)``.

    The left ones, of which tall matrices have many, are not computed.
    """
    _, sigma, Vt = np.linalg.svd(A, full_matrices=A.shape[0] < A.shape[1])
    return sigma, Vt


def row_lengths(A: Mat) -> Vec:
    """The 2-norm of every row, ``(m,)``."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", A, A)))


def longest_row(A: Mat) -> float:
    """The largest 2-norm of a row, 0 without rows."""
    return float(row_lengths(A).max(initial=0.0))
