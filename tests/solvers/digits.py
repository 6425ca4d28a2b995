"""Optima of small levels in 160 digits, without code of a solver: no rank and no tolerance of a solver decides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from typing import Any

import numpy as np

from hqp import Rows
from hqp.arrays import Mat, Vec

DIGITS = 160
LESS = Decimal("1e-35")
"""Weight of a level's squares beside those of the level above it."""

DEPENDS, MISSED, ROOT = Decimal("1e-110"), Decimal("1e-40"), Decimal("1e-30")
"""Zero for the share of a row that no other row has, squared, for a row's distance from its bounds, for a root."""


def optimum(hard: Rows, level: Rows, motion: Mat | None = None, price: float = 0.0) -> Vec | None:
    """The shortest point ``(n,)`` within hard rows that minimises ||w||, w the slack of a level, and then ||motion x||,
    or with a price ||w|| + price / 2 ||motion x||^2; rounded at the end.

    None if no point meets the hard rows."""
    F = np.zeros((0, np.shape(hard.A)[1])) if motion is None else motion
    with localcontext() as context:
        context.prec = DIGITS
        least, one = _Least([hard, level, Rows(F, np.zeros(len(F)), np.zeros(len(F)))]), Decimal(1)
        if price > 0.0:
            x = _root(lambda m: least.point([None, one, m * Decimal(price)]), least.size)
        else:
            x = least.point([None, one, LESS])
        return None if x is None else np.asarray(x, dtype=np.float64)


def _root(point: Callable[[Decimal], Any], size: Callable[[Any], Decimal]) -> Any:
    """The point of m whose size is m: it has the least size + c E if the point of m has the least size^2 / 2 m + c E.

    The size grows with m, and m / size nearly along a line; the level is met for its price if the size begins at zero.
    """
    if (x := point(LESS)) is None or size(x) <= LESS:
        return x
    low, high, before, m = Decimal(0), Decimal("inf"), (LESS, LESS / size(x) - 1), size(x)
    while True:
        off = m / size(x := point(m)) - 1
        if abs(off) < ROOT:
            return x
        low, high = (m, high) if off < 0 else (low, m)
        (last, other), before = before, (m, off)
        m -= off * (m - last) / (off - other) if off != other else m
        if not low < m < high:
            m = 2 * low if high.is_infinite() else (low + high) / 2


class _Least:
    """The point of least sum of weight ||w||^2, then ||x||, over parts: rows with a weight, or None for no slack.

    By multipliers (Goldfarb and Idnani 1983): missed rows enter one by one, rows whose multiplier comes to zero leave.
    """

    def __init__(self, parts: Sequence[Rows]) -> None:
        n = np.shape(parts[0].A)[1]
        self._counts = [rows.m for rows in parts]
        self._C = _exact(np.concatenate([rows.dense(n) for rows in parts]))
        self._low = _exact(np.concatenate([rows.lower for rows in parts]))
        self._high = _exact(np.concatenate([rows.upper for rows in parts]))
        self._equal = self._low == self._high
        self._square = self._C @ self._C.T
        self._held: list[int] = []
        self._force = _exact(np.zeros(len(self._C)))  # positive at upper, negative at lower

    def size(self, x: Any) -> Decimal:
        """||w|| of the second part at x."""
        first, end = np.cumsum(self._counts)[:2]
        return sum((off * off for off in self._off(self._C @ x)[first:end]), Decimal(0)).sqrt()

    def point(self, weights: Sequence[Decimal | None]) -> Any:
        """The point ``(n,)``; None if none meets the rows without slack."""
        soft = np.array([LESS * LESS / weight if weight else Decimal(0) for weight in weights])
        G = self._square + np.diag(np.repeat(soft, self._counts))
        self._begin(G)
        while True:
            off = self._off(-G @ self._force)
            off[self._held] = Decimal(0)
            row = int(np.argmax(np.abs(off)))
            if abs(off[row]) <= MISSED:
                return -self._C.T @ self._force
            if not self._enter(G, row, off[row]):
                return None

    def _begin(self, G: Any) -> None:
        """Hold the rows of the last point whose multipliers have their signs."""
        while True:
            held, before = self._held, self._force
            self._force = _exact(np.zeros(len(G)))
            self._force[held] = _solve(G[np.ix_(held, held)], -np.where(before > 0, self._high, self._low)[held])
            self._held = [i for i in held if self._equal[i] or self._force[i] * before[i] > 0]
            if len(self._held) == len(held):
                return
            self._force = before

    def _enter(self, G: Any, row: int, off: Decimal) -> bool:
        """Hold a row that is off by so much; return false if rows that stay hold it there."""
        side = off.copy_sign(1) / off
        while True:
            held = self._held
            change = _solve(G[np.ix_(held, held)], G[held, row])
            left = G[row, row] - G[row, held] @ change
            times = [
                self._force[i] / (side * rate) if not self._equal[i] and self._force[i] * side * rate > 0 else None
                for i, rate in zip(held, change, strict=True)
            ]
            ends = [(time, k) for k, time in enumerate(times) if time is not None]
            far, out = min(ends, default=(Decimal("inf"), -1))
            full = abs(off) / left if left > DEPENDS * G[row, row] else Decimal("inf")
            if min(far, full).is_infinite():
                return False
            far, out = (full, -1) if full <= far else (far, out)
            self._force[held] -= side * far * change
            self._force[row] += side * far
            off -= side * far * left
            if out < 0:
                self._held = [*held, row]
                return True
            self._force[held[out]] = Decimal(0)
            self._held = held[:out] + held[out + 1 :]

    def _off(self, value: Any) -> Any:
        """The distance of values of the rows from their bounds, negative below."""
        return np.maximum(value - self._high, 0) + np.minimum(value - self._low, 0)


def _exact(values: Any) -> Any:
    return np.vectorize(lambda value: Decimal(float(value)), otypes=[object])(values)


def _solve(M: Any, b: Any) -> Any:
    """The solution of M x = b, M positive definite, by elimination."""
    rows = [[*row, right] for row, right in zip(M.tolist(), b, strict=True)]
    for k, (pivot, *row) in ((k, rows[k][k:]) for k in range(len(rows))):
        for i in range(k + 1, len(rows)):
            share = rows[i][k] / pivot
            rows[i][k + 1 :] = [x - share * y for x, y in zip(rows[i][k + 1 :], row, strict=True)]
    x = np.full(len(rows), Decimal(0))
    for k in reversed(range(len(rows))):
        x[k] = (
            rows[k][-1] - sum((a * y for a, y in zip(rows[k][k + 1 : -1], x[k + 1 :], strict=True)), Decimal(0))
        ) / rows[k][k]
    return x
