"""Space of a followed value: differences of two values, and the value at a difference, row by row."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.angles import all_wrapped
from hqp.arrays import Mask, Mat, Vec
from hqp.declare.element import Task
from hqp.errors import DeclarationError
from hqp.estimation.rotations import exponential, exponential_rows


class Space:
    """Values of a task: a vector ``(k,)``, a rotation ``(3, 3)`` or a pose ``(4, 4)``, and their differences.

    turns ``(k,)``: rows that are angles; the norm of these and of the others is bounded apart.  Differences of poses
    and rotations are those of ``Pose.error``: [p - q, log(R Q^T)].  Raises DeclarationError for an argument that is not
    a task.
    """

    def __init__(self, element: Any) -> None:
        if not isinstance(element, Task) or not callable(getattr(element, "at", None)):
            name = getattr(element, "name", "") or type(element).__name__
            raise DeclarationError("Follow", "cannot be followed", value=name, allowed="Pose, Position, Orientation")
        self.first: int | None = element.rotation_rows
        self.wraps = element.units == ("rad",) and self.first is None and hasattr(element, "axes")
        self._turning = element.units == ("rad",)

    def turns(self, k: int) -> Mask:
        """Mask of the rows among ``k`` that are angles."""
        return np.arange(k) >= (0 if self._turning else k if self.first is None else self.first)

    def minus(self, value: Any, other: Any) -> Vec:
        """The difference ``(k,)`` that leads from ``other`` to ``value``."""
        if self.first is None:
            difference: Vec = value - other
            return all_wrapped(difference) if self.wraps else difference
        one, two = value.tolist(), other.tolist()
        turn = logarithm(_between(one, two))
        if self.first == 0:
            return np.array(turn)
        return np.array([one[0][3] - two[0][3], one[1][3] - two[1][3], one[2][3] - two[2][3], *turn])

    def plus(self, value: Any, difference: Vec) -> Any:
        """The value that a difference ``(k,)`` leads to."""
        if self.first is None:
            return value + difference
        if self.first == 0:
            return exponential(difference) @ value
        *shift, x, y, z = difference.tolist()
        p, q, r, _ = value.tolist()
        found = [
            [a * p[0] + b * q[0] + c * r[0], a * p[1] + b * q[1] + c * r[1], a * p[2] + b * q[2] + c * r[2], row[3] + d]
            for (a, b, c), row, d in zip(exponential_rows(x, y, z), (p, q, r), shift, strict=True)
        ]
        return np.array([*found, [0.0, 0.0, 0.0, 1.0]])

    def neutral(self, k: int) -> Any:
        """The value at the origin of the axes."""
        return self.placed(np.eye(4), k)

    def placed(self, pose: Mat, k: int) -> Any:
        """Value of the task at a pose ``(4, 4)``; for numbers that are no place, zeros."""
        if self.first is None:
            return pose[:3, 3].copy() if k == 3 and not self._turning else np.zeros(k)
        return pose[:3, :3].copy() if self.first == 0 else pose.copy()


Rows = list[list[float]]


def _between(one: Rows, two: Rows) -> Rows:
    """The rotation that takes the axes of two to those of one, as rows."""
    (a, b, c), (d, e, f), (g, h, i) = (row[:3] for row in two[:3])
    return [
        [p * a + q * b + r * c, p * d + q * e + r * f, p * g + q * h + r * i] for p, q, r in (x[:3] for x in one[:3])
    ]


def logarithm(rows: Rows) -> tuple[float, float, float]:
    """log R [rad] of a rotation by its rows, with an angle of at most pi."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    x, y, z = h - f, c - g, d - b
    sine, cosine = 0.5 * math.sqrt(x * x + y * y + z * z), 0.5 * (a + e + i - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-6:
        s = 0.5 * angle / sine
        return s * x, s * y, s * z
    if cosine > 0.0:
        return 0.5 * x, 0.5 * y, 0.5 * z
    squares = [0.5 * (a + 1.0), 0.5 * (e + 1.0), 0.5 * (i + 1.0)]  # half a turn: R = 2 n n^T - 1
    k = max(range(3), key=squares.__getitem__)
    n = [0.5 * (rows[k][j] + rows[j][k]) + (j == k) for j in range(3)]
    size = math.pi / math.sqrt(sum(x * x for x in n))
    return size * n[0], size * n[1], size * n[2]
