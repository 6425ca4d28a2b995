"""What a followed value is made of: how two values differ, and where a difference leads, row by row."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Mask, Mat, Vec
from hqp.element import Task
from hqp.errors import DeclarationError
from hqp.estimation.rotations import exponential


class Space:
    """Values of a task: a vector ``(k,)``, a rotation ``(3, 3)`` or a pose ``(4, 4)``, and their differences.

    turns ``(k,)``: rows that are angles; the norm of these and of the others is bounded apart.  Differences of poses
    and rotations are those of ``Pose.error``: [p - q, log(R Q^T)].  Raises DeclarationError for what is no task.
    """

    def __init__(self, element: Any) -> None:
        if not isinstance(element, Task) or not callable(getattr(element, "at", None)):
            name = getattr(element, "name", "") or type(element).__name__
            raise DeclarationError("Follow", "cannot be followed", value=name, allowed="Pose, Position, Orientation")
        self.first: int | None = element.rotation_rows
        self.wraps = element.units == ("rad",) and self.first is None and hasattr(element, "axes")
        self._turning = element.units == ("rad",)

    def turns(self, k: int) -> Mask:
        """Which of ``k`` rows are angles."""
        return np.arange(k) >= (0 if self._turning else k if self.first is None else self.first)

    def minus(self, value: Any, other: Any) -> Vec:
        """The difference ``(k,)`` that leads from ``other`` to ``value``."""
        if self.first is None:
            difference: Vec = value - other
            return np.array([math.remainder(d, math.tau) for d in difference.tolist()]) if self.wraps else difference
        if self.first == 0:
            return logarithm(value @ other.T)
        found = np.empty(6)
        found[:3] = value[:3, 3] - other[:3, 3]
        found[3:] = logarithm(value[:3, :3] @ other[:3, :3].T)
        return found

    def plus(self, value: Any, difference: Vec) -> Any:
        """The value that a difference ``(k,)`` leads to."""
        if self.first is None:
            return value + difference
        if self.first == 0:
            return exponential(difference) @ value
        found = value.copy()
        found[:3, 3] += difference[:3]
        found[:3, :3] = exponential(difference[3:]) @ value[:3, :3]
        return found

    def neutral(self, k: int) -> Any:
        """The value at the origin of the axes."""
        return self.placed(np.eye(4), k)

    def placed(self, pose: Mat, k: int) -> Any:
        """The value of what is at a pose ``(4, 4)``; for numbers that are no place, zeros."""
        if self.first is None:
            return pose[:3, 3].copy() if k == 3 and not self._turning else np.zeros(k)
        return pose[:3, :3].copy() if self.first == 0 else pose.copy()


def logarithm(R: Mat) -> Vec:
    """log R ``(3,)`` [rad], with an angle of at most pi."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    x, y, z = h - f, c - g, d - b
    sine, cosine = 0.5 * math.sqrt(x * x + y * y + z * z), 0.5 * (a + e + i - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-6:
        s = 0.5 * angle / sine
        return np.array([s * x, s * y, s * z])
    if cosine > 0.0:
        return np.array([0.5 * x, 0.5 * y, 0.5 * z])
    squares = [0.5 * (a + 1.0), 0.5 * (e + 1.0), 0.5 * (i + 1.0)]  # half a turn: R = 2 n n^T - 1
    k = max(range(3), key=squares.__getitem__)
    n = 0.5 * (R[k] + R[:, k])
    n[k] += 1.0
    axis: Vec = n / np.linalg.norm(n)
    return math.pi * axis
