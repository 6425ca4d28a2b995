"""The problem as one table of rows under a box: level 0 is taken out where it only bounds variables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Mat, Signs, Vec
from hqp.solvers.flat import Flat
from hqp.tolerances import ROUNDING

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """lo <= x <= hi, ``(n,)``; taken: whether level 0 became it, so that its rows are none any more."""

    lo: Vec
    hi: Vec
    taken: bool

    @property
    def fixed(self) -> Mask:
        """Variables that have one value only."""
        return np.equal(self.lo, self.hi)

    def clip(self, x: Vec) -> Vec:
        """The point of the box next to x."""
        clipped: Vec = np.minimum(np.maximum(x, self.lo), self.hi)
        return clipped


@dataclass(slots=True, eq=False)
class Table:
    """Rows of all levels, completion included: lower <= A x - w <= upper, A ``(M, n)``.

    levels: the row numbers of each level.  norm: ``(M,)`` row norms.  scale: the largest one of each level.
    usable: ``(M,)`` inequalities.  lower, upper and box are the table's own and may be widened.
    """

    A: Mat
    lower: Vec
    upper: Vec
    level: NDArray[np.intp]
    levels: list[NDArray[np.intp]]
    norm: Vec
    scale: list[float]
    usable: Mask
    box: Box
    start: Signs
    """``(M,)`` working marks of a cold start: 2 for an equality, 0 otherwise."""
    damping: tuple[float, ...]
    reach: float
    """Largest distance that a row of usual length asks for, |bound| / norm: the scale of rounding in x."""
    rounding: list[float]
    """Per level, no direction is shorter: what rounding leaves of zero in this problem."""

    def span(self, x: Vec) -> float:
        """The size of x for tolerances: of its largest entry, and not below what the rows' rounding leaves."""
        return max(float(abs(x).max(initial=0.0)), 1e-3 * self.reach)

    def missed(self, level: int, value: Vec) -> float:
        """Norm of what the rows of a level miss at value = A x, ``(M,)``."""
        rows = self.levels[level]
        out = value[rows] - np.minimum(np.maximum(value[rows], self.lower[rows]), self.upper[rows])
        return float(np.sqrt(out @ out))

    @property
    def M(self) -> int:
        """Number of rows."""
        return int(self.A.shape[0])


def table(flat: Flat, damping: tuple[float, ...]) -> Table:
    """Read a loaded block; damping is padded with zeros for the completion."""
    box = _box(flat)
    gone = (flat.level == 0) & box.taken
    norm = np.sqrt(np.einsum("ij,ij->i", flat.A, flat.A))
    used = (flat.equality | flat.inequality) & ~gone
    levels = [np.flatnonzero(flat.level == k) for k in range(len(flat.sizes))]
    scale = [float(norm[rows[used[rows]]].max(initial=0.0)) for rows in levels]
    own = len(flat.shape.rows)
    zero = ROUNDING * max(scale[:own], default=0.0)
    usual = np.maximum(1e-3 * np.array(scale)[flat.level], zero)  # rows that are nearly zero reach anywhere
    start: Signs = np.where(flat.equality & ~gone, 2, 0).astype(np.int8)
    padded = damping + (0.0,) * (len(levels) - len(damping))
    return Table(
        flat.A,
        flat.lower.copy(),
        flat.upper.copy(),
        flat.level.astype(np.intp),
        levels,
        norm,
        scale,
        flat.inequality & ~gone,
        box,
        start,
        padded,
        _reach(flat, used & (norm > usual) & (flat.level < own), norm),
        [zero] * own + [0.0] * (len(levels) - own),
    )


def _reach(flat: Flat, rows: Mask, norm: Vec) -> float:
    nearest = np.minimum(abs(flat.lower[rows]), abs(flat.upper[rows]))
    return float((nearest / norm[rows]).max(initial=0.0))


def _box(flat: Flat) -> Box:
    n = flat.A.shape[1]
    lo, hi = np.full(n, -np.inf), np.full(n, np.inf)
    rows = np.flatnonzero(flat.level == 0)
    nonzero = flat.A[rows] != 0.0
    if len(flat.shape.rows) and np.all(nonzero.sum(axis=1) == 1):
        index = nonzero.argmax(axis=1)
        scale = flat.A[rows, index]
        a, b = flat.lower[rows] / scale, flat.upper[rows] / scale
        np.maximum.at(lo, index, np.minimum(a, b))
        np.minimum.at(hi, index, np.maximum(a, b))
        if np.all(lo <= hi):
            for i, s, lower, upper in zip(index, scale, flat.lower[rows], flat.upper[rows], strict=True):
                lo[i] = _inside(float(lo[i]), s, lower, upper)
                hi[i] = _inside(float(hi[i]), s, lower, upper)
            return Box(lo, np.maximum(lo, hi), True)
    return Box(np.full(n, -np.inf), np.full(n, np.inf), False)


def _inside(x: float, scale: float, lower: float, upper: float) -> float:
    """x moved by single roundings until lower <= scale x <= upper, so that bounds hold exactly."""
    for _ in range(8):
        if not np.isfinite(x) or lower <= scale * x <= upper:
            break
        towards = np.inf if (scale * x < lower) == (scale > 0.0) else -np.inf
        x = float(np.nextafter(x, towards))
    return x
