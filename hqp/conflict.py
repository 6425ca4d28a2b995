"""Which constraints exclude each other: an irreducible set of rows, and what each would have to give way.

At the least-squares violation of all rows, min ||w||^2, the stationarity condition A' w = 0 makes w a certificate of
Farkas: the rows with w != 0 cannot hold together.  A deletion filter then removes every row that the conflict does not
need (Chinneck and Dravnieks, 1991): what is left is feasible without any one of its rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.problem import Hierarchy, Rows
from hqp.solvers import exact, load
from hqp.tolerances import VIOLATION_TOLERANCE

SUPPORT = 1e-6
"""Rows whose share of the certificate is below this do not take part in it."""


@dataclass(frozen=True)
class Conflicting:
    """One row of a conflict: its level, its place there, the side that binds, and the least it must give way alone."""

    name: str
    level: int
    row: int
    side: str
    relaxation: float
    unit: str = ""

    def __str__(self) -> str:
        side = "" if self.side == "equality" else f" {self.side}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name}{side} by {self.relaxation:.3g}{unit}"


@dataclass(frozen=True)
class Conflict:
    """An irreducible set of rows that cannot hold together, none where all constraints can; ``str()`` says it."""

    rows: tuple[Conflicting, ...]

    def __bool__(self) -> bool:
        return bool(self.rows)

    def __str__(self) -> str:
        if not self.rows:
            return "all constraints can hold"
        names = [row.name + ("" if row.side == "equality" else f" {row.side}") for row in self.rows]
        listed = names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]
        least = sorted(self.rows, key=lambda row: row.relaxation)
        return f"{listed} exclude each other; they hold if one gives way: {', or '.join(map(str, least))}"


def conflict(problem: Hierarchy, names: Sequence[Sequence[tuple[str, str]]] | None = None) -> Conflict:
    """An irreducible conflict among the leading ``problem.constraints`` levels.

    names: for each of these levels (name, unit) of its rows; numbers without.
    """
    A, lower, upper, places = _stack(problem)
    if not lower.size:
        return Conflict(())
    w = _violation(A, lower, upper)
    if not _violated(w, lower, upper):
        return Conflict(())
    kept = np.flatnonzero(np.abs(w) > SUPPORT * float(np.abs(w).max()))
    for i in kept.copy():
        rest = kept[kept != i]
        if rest.size and _violated(_violation(A[rest], lower[rest], upper[rest]), lower[rest], upper[rest]):
            kept = rest
    found = []
    for j in kept.tolist():
        level, row, length = places[j]
        alone = _relaxation(A, lower, upper, kept[kept != j], j)
        name, unit = names[level][row] if names is not None else (f"level {level}, row {row}", "")
        side = "equality" if lower[j] == upper[j] else "upper" if alone > 0.0 else "lower"
        found.append(Conflicting(name, level, row, side, abs(alone) * length, unit))
    return Conflict(tuple(found))


def _stack(problem: Hierarchy) -> tuple[Mat, Vec, Vec, list[tuple[int, int, float]]]:
    """All rows of the constraints that ask for something, of length one; where each was, and its length."""
    blocks: list[Mat] = []
    bounds: list[tuple[float, float]] = []
    places: list[tuple[int, int, float]] = []
    for k, rows in enumerate(problem.levels[: problem.constraints]):
        A = rows.dense(problem.n)
        length = np.sqrt(np.sum(A * A, axis=1))
        for i in np.flatnonzero((rows.lower > -np.inf) | (rows.upper < np.inf)):
            size = float(length[i]) or 1.0
            blocks.append(A[i] / size)
            bounds.append((float(rows.lower[i]) / size, float(rows.upper[i]) / size))
            places.append((k, int(i), size))
    low, high = (np.array(side, dtype=np.float64) for side in zip(*bounds, strict=True)) if bounds else ((), ())
    return np.array(blocks).reshape(len(blocks), problem.n), np.asarray(low), np.asarray(high), places


def _violation(A: Mat, lower: Vec, upper: Vec) -> Vec:
    """w of least norm."""
    problem = Hierarchy((Rows(A, lower, upper),))
    return np.asarray(load(exact()).solve(problem).residuals[0])


def _relaxation(A: Mat, lower: Vec, upper: Vec, rest: np.ndarray, i: int) -> float:
    """How far row i is off where all the others of its conflict hold."""
    levels = [Rows(A[rest], lower[rest], upper[rest])] if rest.size else []
    levels.append(Rows(A[[i]], lower[[i]], upper[[i]]))
    return float(load(exact()).solve(Hierarchy(tuple(levels))).residuals[-1][0])


def _violated(w: Vec, lower: Vec, upper: Vec) -> bool:
    with np.errstate(invalid="ignore"):
        size = np.where(w > 0.0, np.abs(upper), np.abs(lower))
    return bool(np.any(np.abs(w) > VIOLATION_TOLERANCE * (1.0 + np.where(w == 0.0, 0.0, size))))
