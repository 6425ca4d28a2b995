"""The optimum of a small level in rational arithmetic, without code of a solver: no rounding, no rank, no tolerance."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from hqp import Rows
from hqp.arrays import Vec

SHORT = Fraction(1, 10**60)
"""Weight of ||x||^2 beside ||w||^2: it chooses the shortest optimum, to 30 digits."""


def optimum(hard: Rows, level: Rows, near: Vec) -> Vec | None:
    """The point ``(n,)`` of least ||w|| of a level, w its slack, that meets hard rows, rounded at the end.

    near: a guess of it.  Rows change their sides until multipliers have their signs and rows keep to their bounds; None
    if that does not end, or if held rows depend on each other.
    """
    (C, lower, upper), (A, low, high) = _rational(hard, near.size), _rational(level, near.size)
    held, missed = _sides(C @ near, lower, upper), _sides(A @ near, low, high)
    for _ in range(30):
        a, b = A[missed != 0], np.where(missed < 0, low, high)[missed != 0]
        c, d = C[held != 0], np.where(held < 0, lower, upper)[held != 0]
        H = a.T @ a + SHORT * np.eye(near.size, dtype=int)
        none = np.zeros((len(c), len(c)), dtype=int)
        found = _solve(np.block([[H, c.T], [c, none]]), np.concatenate([a.T @ b, d]))
        if found is None:
            return None
        x, force = found[: near.size], np.zeros(held.size, dtype=object)
        force[held != 0] = found[near.size :]
        wrong = (lower != upper) & (held * force < 0)
        after = np.where(wrong, 0, np.where(held != 0, held, _sides(C @ x, lower, upper)))
        out = _sides(A @ x, low, high)
        if np.array_equal(after, held) and np.array_equal(out, missed):
            return np.asarray(x, dtype=np.float64)
        held, missed = after, out
    return None


def _rational(rows: Rows, n: int) -> tuple[Any, Any, Any]:
    """A, lower and upper of rows in fractions; infinite bounds stay as they are."""
    exact = np.vectorize(lambda value: Fraction(value) if np.isfinite(value) else value, otypes=[object])
    return exact(rows.dense(n)), exact(rows.lower), exact(rows.upper)


def _sides(value: Any, lower: Any, upper: Any) -> Any:
    """-1 for rows below, +1 for rows above or with one bound, 0 for the others."""
    return np.where((value > upper) | (lower == upper), 1, np.where(value < lower, -1, 0))


def _solve(M: Any, b: Any) -> Any:
    """The solution of M x = b by elimination; None if M is singular."""
    rows = [[*row, right] for row, right in zip(M, b, strict=True)]
    for k in range(len(rows)):
        pivot = next((i for i in range(k, len(rows)) if rows[i][k] != 0), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [entry / rows[k][k] for entry in rows[k]]
        for i in range(len(rows)):
            if i != k and rows[i][k] != 0:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return np.array([row[-1] for row in rows], dtype=object)
