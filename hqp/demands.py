"""From errors to demands: the laws of all rows of a stack at once, where no native assembly does it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqp.arrays import Index, Mask, Mat, Vec

Saturation = tuple[int, int, float, float, float]
"""Rows start to stop of one element, its max_velocity and max_acceleration, its largest kd (1 at order 1)."""


class Demands:
    """Writes demand, and bounds as weight times demand where rows are equalities; elsewhere it weighs the bounds.

    order 1: demand = rate - kp e.  order 2: demand = feedforward - kp e - kd (J v - rate) - dJ/dt v.
    All arrays are live, ``(total,)``; the rows of J ``(m, nv)`` are weighted, those after them pick a coordinate.
    """

    def __init__(
        self,
        *,
        order: int,
        J: Mat,
        error: Vec,
        rate: Vec,
        feedforward: Vec,
        drift: Vec,
        kp: Vec,
        kd: Vec,
        weight: Vec,
        pick: Index,
        equality: Mask,
        demand: Vec,
        lower: Vec,
        upper: Vec,
        saturations: Sequence[Saturation],
    ) -> None:
        self._order, self._J, self._error, self._rate = order, J, error, rate
        self._feedforward, self._drift, self._kp, self._kd = feedforward, drift, kp, kd
        self._weight, self._pick, self._equality = weight, pick, equality
        self._demand, self._lower, self._upper = demand, lower, upper
        self._saturations = [(slice(a, b), fastest, hardest, kd) for a, b, fastest, hardest, kd in saturations]
        self._damper = np.zeros_like(demand)
        self._plain = bool(np.all(weight == 1.0))
        self._inverse_weight = 1.0 / weight[: J.shape[0]]
        self._all_equal = bool(equality.all())

    def run(self, v: Vec) -> None:
        """Refill for errors, rates and rows of this tick."""
        demand, damper = self._demand, self._damper
        np.multiply(self._kp, self._error, out=demand)
        if self._order == 1:
            if self._saturations:
                self._saturate_first()
            np.subtract(self._rate, demand, out=demand)
        else:
            m = self._J.shape[0]
            np.matmul(self._J, v, out=damper[:m])
            np.take(v, self._pick, out=damper[m:])
            if not self._plain:
                np.multiply(damper[:m], self._inverse_weight, out=damper[:m])
            np.subtract(damper, self._rate, out=damper)
            np.multiply(damper, self._kd, out=damper)
            if self._saturations:
                self._saturate_second()
            np.add(demand, damper, out=demand)
            np.subtract(self._feedforward, demand, out=demand)
            np.subtract(demand, self._drift, out=demand)
        if self._all_equal:
            np.multiply(demand, self._weight, out=self._lower)
            np.copyto(self._upper, self._lower)
        else:
            np.copyto(self._lower, demand, where=self._equality)
            np.copyto(self._upper, demand, where=self._equality)
            if not self._plain:
                np.multiply(self._lower, self._weight, out=self._lower)
                np.multiply(self._upper, self._weight, out=self._upper)

    def _saturate_first(self) -> None:
        for part, fastest, hardest, _ in self._saturations:
            feedback, error = self._demand[part], self._error[part]
            speed = float(np.sqrt(feedback @ feedback))
            allowed = min(fastest, float(np.sqrt(2.0 * hardest * np.sqrt(error @ error))))
            if speed > allowed:
                feedback *= allowed / speed

    def _saturate_second(self) -> None:
        for part, fastest, hardest, kd in self._saturations:
            spring, damper = self._demand[part], self._damper[part]
            pull = float(np.sqrt(spring @ spring))
            if pull > kd * fastest:
                spring *= kd * fastest / pull
            total = spring + damper
            size = float(np.sqrt(total @ total))
            if size > hardest:
                spring *= hardest / size
                damper *= hardest / size
