"""Equality-constrained lexicographic least squares by an orthonormal chain, and the signs of its multipliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Mask, Mat, Signs, Vec
from hqp.solvers.lexicographic_reference.table import Table

if TYPE_CHECKING:
    from hqp.solvers.lexicographic import Lexicographic


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A level in the basis left by those above: A_k Z = U diag(s) V', Y = Z V, both cut at the rank."""

    rows: NDArray[np.intp]
    Y: Mat
    U: Mat
    s: Vec
    damped: float


@dataclass(frozen=True, slots=True)
class Wrong:
    """A working row or fixed variable whose multiplier has the wrong sign, and the level that says so."""

    level: int
    size: float
    variable: bool
    index: int


Silent: TypeAlias = "set[tuple[int, bool, int]] | frozenset[tuple[int, bool, int]]"
"""Levels that have no say in a row or a variable: (level, variable, index)."""


@dataclass(slots=True, eq=False)
class Point:
    """The solution x for a working set, value = A x, and the chain that led to it."""

    x: Vec
    value: Vec
    chain: list[Link]
    closest: float
    growth: float
    shifted: bool


def bounds(table: Table, W: Signs, rows: NDArray[np.intp]) -> Vec:
    """What working rows aim at."""
    return np.where(W[rows] == -1, table.lower[rows], table.upper[rows])


def equality_point(table: Table, W: Signs, F: Signs, options: Lexicographic) -> Point:
    """x_k = x_{k-1} + Y_k (s / (s^2 + d^2)) U_k' (b_k - A_k x_{k-1}), Z_{k+1} = Z_k V_k_rest."""
    n = table.A.shape[1]
    x = np.where(F > 0, table.box.hi, np.where(F < 0, table.box.lo, 0.0))
    Z = np.eye(n)[:, F == 0]
    chain, closest, growth, shifted = [], np.inf, 1.0, False
    for k, all_rows in enumerate(table.levels):
        rows = all_rows[W[all_rows] != 0]
        A, d = table.A[rows], table.damping[k]
        Y, U, s = np.zeros((n, 0)), np.zeros((rows.size, 0)), np.zeros(0)
        if rows.size and Z.shape[1]:
            U, s, Vt = np.linalg.svd(A @ Z)
            floor = max(max(options.rank_tolerance, 1e-14 * growth) * table.scale[k], table.rounding[k])
            rank = int(np.sum(s > floor))
            closest = min(closest, *(max(v / floor, floor / max(v, 1e-300)) for v in s)) if floor > 0 else closest
            Y, U, s, Z = Z @ Vt[:rank].T, U[:, :rank], s[:rank], Z @ Vt[rank:].T
            error = U.T @ (bounds(table, W, rows) - A @ x)
            x = x + Y @ (error * s / (s * s + d * d))
            if rank:
                growth = max(growth, table.scale[k] / s[-1])
                shifted = shifted or bool(d > 0.0 and np.any(d * d * abs(error) > 1e-9 * (s * s + d * d)))
        chain.append(Link(rows, Y, U, s, d))
    return Point(x, table.A @ x, chain, closest, growth, shifted)


def slack(table: Table, W: Signs, point: Point, k: int, tolerance: float) -> tuple[Vec, Vec]:
    """w_k of the working rows of level k, zero where all are met, and what of each counts as rounding."""
    link = point.chain[k]
    target = bounds(table, W, link.rows)
    w = point.value[link.rows] - target
    if link.s.size == link.rows.size:
        w[:] = 0.0
    elif link.s.size:
        w = w - link.U @ (link.U.T @ w)  # what damping asked for does not count
    rounding = tolerance * (abs(target) + table.norm[link.rows] * table.span(point.x))
    if np.all(abs(w) <= rounding):
        w[:] = 0.0
    return np.asarray(w), np.asarray(rounding)


def adjoint(table: Table, point: Point, k: int, w: Vec) -> tuple[list[Vec], list[Vec], Vec, Vec]:
    """lambda_kj = -U_j diag(1/s_j) Y_j' g for j = k-1..0, g = A_k' w + sum_{i>j} A_i' lambda_ki, refined once.

    Returns the multipliers of each level above k, by how much refinement changed them, the last g, and its change.
    """
    first, g = _sweep(table, point, k, table.A[point.chain[k].rows].T @ w)
    change, refined = _sweep(table, point, k, g)
    return [a + b for a, b in zip(first, change, strict=True)], change, refined, refined - g


def _sweep(table: Table, point: Point, k: int, g: Vec) -> tuple[list[Vec], Vec]:
    found: list[Vec] = []
    for link in reversed(point.chain[:k]):
        found.append(-link.U @ ((link.Y.T @ g) / link.s))
        g = g + table.A[link.rows].T @ found[-1]
    return found[::-1], g


def judge(
    table: Table, W: Signs, F: Signs, point: Point, options: Lexicographic, silent: Silent = frozenset()
) -> list[Wrong]:
    """Working rows and fixed variables that hold a level back: the first level with a clear sign decides."""
    open_rows, open_x = (W != 0) & table.usable, (F != 0) & ~table.box.fixed
    wrong: list[Wrong] = []

    def heard(k: int, variable: bool, which: NDArray[np.intp]) -> Mask:
        if not silent:
            return np.ones(which.size, dtype=bool)
        return np.array([(k, variable, int(i)) not in silent for i in which], dtype=bool)

    def settle(k: int, rows: NDArray[np.intp], values: Vec, error: Vec, limit: float | Vec) -> None:
        force = abs(values) * table.norm[rows]
        decided = open_rows[rows] & (force > limit) & (abs(values) > 10.0 * abs(error))
        decided &= heard(k, False, rows)
        bad = decided & (values * W[rows] < 0.0)
        wrong.extend(Wrong(k, float(force[i]), False, int(rows[i])) for i in np.flatnonzero(bad))
        open_rows[rows[decided]] = False

    for k, link in enumerate(point.chain):
        if not open_rows.any() and not open_x.any():
            break
        w, rounding = slack(table, W, point, k, options.multiplier_tolerance)
        if not w.any() or table.scale[k] <= table.rounding[k]:
            continue
        settle(k, link.rows, w, np.zeros_like(w), rounding * table.norm[link.rows])
        multipliers, errors, g, error = adjoint(table, point, k, w)
        scale = table.scale[k]
        length = 0.1 * float(np.sqrt(w @ w))  # refined, signs count from a tenth of the tolerance
        limit = scale * (options.multiplier_tolerance * length + 1e-15 * scale * table.span(point.x))
        for above, values, change in zip(point.chain, multipliers, errors, strict=False):
            settle(k, above.rows, values, change, limit)
        decided = open_x & (abs(g) > limit) & (abs(g) > 10.0 * abs(error))
        decided &= heard(k, True, np.arange(g.size))
        wrong.extend(Wrong(k, float(abs(g[i])), True, int(i)) for i in np.flatnonzero(decided & (g * F > 0.0)))
        open_x &= ~decided
    return wrong
