"""Rows of all levels on the torque, from qdd = X tau + c: J qdd = a is J X tau = a - J c."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.problem import Motion


class TorqueRows:
    """Arrays from which native code refills rows and motion, all of them live.

    map: ``(nv, n + 1)``, [X, c].  demand, bounds: ``(2, m)``, lower and upper bounds on qdd and on tau.
    """

    def __init__(self, map: Mat) -> None:
        self.parts: dict[str, Any] = {"products": [], "picks": [], "motion": None}
        self.copies: list[tuple[Mat, Mat, Index, Vec]] = []
        """Blocks that are rows of the map times a factor each, to the bit: (A, map, rows, factors)."""
        self._map = map

    def product(self, J: Mat, A: Mat, demand: Mat, bounds: Mat) -> None:
        """Rows J ``(m, nv)`` on qdd become A ``(m, n)`` = J X."""
        self.parts["products"].append({"J": J, **demand_rows(A, demand, bounds)})

    def pick(self, index: Index, weight: Vec, A: Mat, demand: Mat, bounds: Mat) -> None:
        """Rows that pick coordinates ``(m,)`` of qdd, times a weight each, become A ``(m, n)``."""
        picked = {"index": index.tolist(), "weight": weight.tolist(), **demand_rows(A, demand, bounds)}
        self.parts["picks"].append(picked)
        self.copies.append((A, self._map, index, weight))

    def motion(self, scale: Vec, rest: float, motion: Motion) -> None:
        """E = |S (qdd + rest v)|^2 / 2 becomes F = S X, f = -S (c + rest v), S = diag(scale)."""
        self.parts["motion"] = {"scale": scale.tolist(), "rest": rest, "F": motion.F, "f": motion.f}
        self.copies.append((motion.F, self._map, np.arange(scale.size), scale))


def demand_rows(A: Mat, demand: Mat, bounds: Mat) -> dict[str, Any]:
    """Rows with requested bounds, and their destination."""
    return {"A": A, "demand_lower": demand[0], "demand_upper": demand[1], "lower": bounds[0], "upper": bounds[1]}
