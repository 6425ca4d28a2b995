"""Rows of all levels on the torque, from qdd = X tau + c: J qdd = a is J X tau = a - J c."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.problem import Motion

try:
    from hqp import _torque as native
except ImportError:  # no compiler was there
    native = None  # type: ignore[assignment]


class TorqueRows:
    """Rows and motion, refilled in arrays of their own from arrays that are refilled in place.

    map: ``(nv, n + 1)``, [X, c].  asked, bounds: ``(2, m)``, lower and upper bounds on qdd and on tau.
    """

    def __init__(self, map: Mat) -> None:
        self._map = map
        self._products: list[tuple[Mat, Mat, Mat, Mat]] = []
        self._picks: list[tuple[Index, Vec, Mat, Mat, Mat]] = []
        self._motion: tuple[Vec, float, Motion] | None = None
        self.native = None if native is None else native.TorqueRows(map)
        """The same natively, None without a compiler."""

    def product(self, J: Mat, A: Mat, asked: Mat, bounds: Mat) -> None:
        """Rows J ``(m, nv)`` on qdd become A ``(m, n)`` = J X."""
        self._products.append((J, A, asked, bounds))
        if self.native is not None:
            self.native.product(J, A, *asked, *bounds)

    def pick(self, index: Index, weight: Vec, A: Mat, asked: Mat, bounds: Mat) -> None:
        """Rows that pick coordinates ``(m,)`` of qdd, times a weight each, become A ``(m, n)``."""
        self._picks.append((index, weight, A, asked, bounds))
        if self.native is not None:
            self.native.pick(index.tolist(), weight.tolist(), A, *asked, *bounds)

    def motion(self, scale: Vec, rest: float, motion: Motion) -> None:
        """E = |S (qdd + rest v)|^2 / 2 becomes F = S X, f = -S (c + rest v), S = diag(scale)."""
        self._motion = scale, rest, motion
        if self.native is not None:
            self.native.motion(scale.tolist(), rest, motion.F, motion.f)  # type: ignore[arg-type]

    @property
    def parts(self) -> dict[str, Any]:
        """The rows and the motion, for a file."""
        products = [{"J": J, **_asked(A, asked, bounds)} for J, A, asked, bounds in self._products]
        picks = [
            {"index": index.tolist(), "weight": weight.tolist(), **_asked(A, asked, bounds)}
            for index, weight, A, asked, bounds in self._picks
        ]
        motion = None
        if self._motion is not None:
            scale, rest, moved = self._motion
            motion = {"scale": scale.tolist(), "rest": rest, "F": moved.F, "f": moved.f}
        return {"products": products, "picks": picks, "motion": motion}

    @property
    def copies(self) -> list[tuple[Mat, Mat, Index, Vec]]:
        """Blocks that are rows of the map times a factor each, to the bit: (A, map, rows, factors)."""
        found = [(A, self._map, index, weight) for index, weight, A, *_ in self._picks]
        if self._motion is not None:
            scale, _, motion = self._motion
            found.append((motion.F, self._map, np.arange(scale.size), scale))
        return found

    def fill(self, v: Vec, c: Vec | None) -> None:
        """All of it from the latest map; c ``(nv,)``: for rows in the place of the map's own."""
        if self.native is not None:
            self.native.run(v, c)
            return
        X, own = self._map[:, :-1], self._map[:, -1]
        if self._motion is not None:
            scale, rest, motion = self._motion
            np.multiply(X, scale[:, None], out=motion.F)
            np.multiply(own + rest * v, -scale, out=motion.f)
        c = own if c is None else c
        for J, A, asked, bounds in self._products:
            np.matmul(J, X, out=A)
            np.subtract(asked, J @ c, out=bounds)
        for index, weight, A, asked, bounds in self._picks:
            np.multiply(X[index], weight[:, None], out=A)
            np.subtract(asked, c[index] * weight, out=bounds)


def _asked(A: Mat, asked: Mat, bounds: Mat) -> dict[str, Any]:
    return {"A": A, "asked_lower": asked[0], "asked_upper": asked[1], "lower": bounds[0], "upper": bounds[1]}
