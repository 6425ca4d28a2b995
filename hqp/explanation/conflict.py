"""Conflicts of constraints: an irreducible set of rows, and the relaxation of each that resolves it.

At the least-squares violation of all rows, min ||w||^2, the stationarity condition A' w = 0 makes y = w a certificate
of Farkas, A' y = 0 and b' y < 0, b_i being the bound at the side of y_i: rows with y_i != 0 cannot hold together.
Along A' z = 0, b' z = 0 one y_i after the other becomes zero (Caratheodory), until y is unique up to its length:
without any one of its rows the rest has no certificate, so it is feasible.  If the others hold, row i is violated by
-b' y / |y_i|.  If rounding dominates, a deletion filter decides (Chinneck and Dravnieks, 1991).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.problem import Hierarchy, Rows
from hqp.solvers import exact, load
from hqp.solvers.base import Solver
from hqp.tolerances import VIOLATION_TOLERANCE

SUPPORT = 1e-9
"""Rows whose share of the certificate is below this do not take part in it."""

DEPENDENT = 1e-11
"""Singular values below this, relative to the largest, are zero."""

QUICK = 0.04
"""Time for the least violation [s]."""

FAR = 1e3
"""Distance from zero, relative to the least violation's point, up to which a certificate excludes points."""

CLEAR = 1e-9
"""The second smallest singular value of the rows of a conflict, relative to the largest, is above this."""

ZERO = 1e-9
"""Entries of a certificate of length one below this are zero."""


@dataclass(frozen=True)
class Conflicting:
    """One row of a conflict: its level, its place there, the active side, and the least relaxation if alone."""

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
    """An irreducible set of contradictory rows, empty if all constraints can hold; ``str()`` lists it."""

    rows: tuple[Conflicting, ...]

    def __bool__(self) -> bool:
        return bool(self.rows)

    def __str__(self) -> str:
        if not self.rows:
            return "the constraints are feasible"
        names = [row.name + ("" if row.side == "equality" else f" {row.side}") for row in self.rows]
        listed = names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]
        least = sorted(self.rows, key=lambda row: row.relaxation)
        return f"{listed} exclude each other; feasible if one is relaxed: {', or '.join(map(str, least))}"


def conflict(problem: Hierarchy, names: Sequence[Sequence[tuple[str, str]]] | None = None) -> Conflict:
    """An irreducible conflict among the leading ``problem.constraints`` levels.

    names: for each of these levels (name, unit) of its rows; numbers without.
    """
    A, lower, upper, places = _stack(problem)
    if not lower.size:
        return Conflict(())
    whole = Hierarchy((Rows(A, lower, upper),))
    quick = _quick().solve(whole)
    if not _violated(quick.residuals[0], lower, upper):
        return Conflict(())
    found_by = _smallest_certificate(A, lower, upper, quick.residuals[0], 1.0 + float(np.linalg.norm(quick.x)))
    if found_by is None:
        w = _violation(A, lower, upper)
        if not _violated(w, lower, upper):
            return Conflict(())
        found_by = _filtered(A, lower, upper, _support(w))
    found = []
    for j, alone in zip(*(part.tolist() for part in found_by), strict=True):
        level, row, length = places[j]
        name, unit = names[level][row] if names is not None else (f"level {level}, row {row}", "")
        side = "equality" if lower[j] == upper[j] else "upper" if alone > 0.0 else "lower"
        found.append(Conflicting(name, level, row, side, abs(alone) * length, unit))
    return Conflict(tuple(found))


def _quick() -> Solver:
    """Solver; the native one skips its own checks, because the certificate of Farkas is judged here."""
    name = exact()
    return load(name, deadline=QUICK) if name == "lexicographic" else load(name)


def _support(w: Vec) -> Index:
    return np.flatnonzero(np.abs(w) > SUPPORT * float(np.abs(w).max()))


def _smallest_certificate(A: Mat, lower: Vec, upper: Vec, w: Vec, size: float) -> tuple[Index, Vec] | None:
    """Rows of an irreducible conflict, and the violation of each alone; None if rounding decides.

    w: the least violation, a certificate.  size: size of x; certificates beyond a thousand times that are ignored.
    """
    kept = _support(w)
    y, bound = w[kept], np.where(w > 0.0, upper, lower)[kept]
    scale = max(1.0, float(np.abs(bound).max()))
    _, sigma, V = np.linalg.svd(np.vstack([A[kept].T, bound / scale]))
    Z = V[int(np.sum(sigma > DEPENDENT * sigma[0])) :].T
    while Z.shape[1]:
        z = Z[:, 0]
        moves = np.abs(z) > DEPENDENT * float(np.abs(z).max())
        steps = np.full(y.size, np.inf)
        steps[moves] = np.abs(y[moves] / z[moves])
        j = int(np.argmin(steps))
        y = np.delete(y - y[j] / z[j] * z, j)
        c = int(np.argmax(np.abs(Z[j])))
        Z = np.delete(Z - np.outer(Z[:, c] / Z[j, c], Z[j]), c, axis=1)
        Z, kept, bound = np.delete(Z, j, axis=0), np.delete(kept, j), np.delete(bound, j)
    unique = _null_vector(A[kept])
    if unique is not None and np.any(small := np.abs(unique) < ZERO):  # they became zero together with another one
        kept, bound, y = kept[~small], bound[~small], y[~small]
        unique = _null_vector(A[kept])
    if unique is None:
        return None
    unique = unique if float(unique @ y) > 0.0 else -unique
    off, error = -float(bound @ unique), float(np.linalg.norm(unique @ A[kept]))
    if np.any(unique * w[kept] <= 0.0) or not off > max(VIOLATION_TOLERANCE * scale, FAR * size * error):
        return None
    return kept, off / unique


def _null_vector(A: Mat) -> Vec | None:
    """y of length one with A' y = 0; None if there is none, or if others are nearly as good."""
    _, sigma, V = np.linalg.svd(A.T)
    rank = A.shape[0] - 1
    if rank < 0 or sigma.size < rank or (rank and sigma[rank - 1] < CLEAR * sigma[0]):
        return None
    return np.asarray(V[-1])


def _filtered(A: Mat, lower: Vec, upper: Vec, kept: Index) -> tuple[Index, Vec]:
    """Find the conflict by removing one row after the other."""
    for i in kept.copy():
        rest = kept[kept != i]
        if rest.size and _violated(_violation(A[rest], lower[rest], upper[rest]), lower[rest], upper[rest]):
            kept = rest
    return kept, np.array([_relaxation(A, lower, upper, kept[kept != j], j) for j in kept])


def _stack(problem: Hierarchy) -> tuple[Mat, Vec, Vec, list[tuple[int, int, float]]]:
    """All bounded rows of the constraints, scaled to length one; origin and length of each."""
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
    """Violation of row i if all the others of its conflict hold."""
    levels = [Rows(A[rest], lower[rest], upper[rest])] if rest.size else []
    levels.append(Rows(A[[i]], lower[[i]], upper[[i]]))
    return float(load(exact()).solve(Hierarchy(tuple(levels))).residuals[-1][0])


def _violated(w: Vec, lower: Vec, upper: Vec) -> bool:
    with np.errstate(invalid="ignore"):
        size = np.where(w > 0.0, np.abs(upper), np.abs(lower))
    return bool(np.any(np.abs(w) > VIOLATION_TOLERANCE * (1.0 + np.where(w == 0.0, 0.0, size))))
