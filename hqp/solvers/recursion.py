"""Lexicographic least squares of equality rows: the recursive projector as one chain of pivoted QR.

The recursion x_k = x_{k-1} + (J_k N_{k-1})^+ (b_k - J_k x_{k-1}) (Siciliano and Slotine 1991) is carried out in an
orthonormal basis that grows with the levels: with A_k' = [Q_above L_k; Q_k R_k P_k'] level k only sees the rows of
Q' A' below the rank of the levels above it.  No projector is formed, and no row is stacked on a fixed one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import get_lapack_funcs

from hqp.arrays import Index, Mat, Vec, longest_row, row_lengths
from hqp.tolerances import ROUNDING

NEAR = 100.0
"""A pivot within this factor of the rank tolerance makes a rank decision uncertain."""

_WORK = 8192
geqp3, ormqr, trtrs, gels = get_lapack_funcs(("geqp3", "ormqr", "trtrs", "gels"), (np.zeros(1),))


class Recursion:
    """min ||A_0 x - b_0||, then ||A_1 x - b_1|| with the first kept minimal, and so on, then min ||x||.

    Not a solver: it knows neither inequalities nor hierarchies.  tolerance: a row adds no direction where its
    pivot is below this fraction of the largest row norm of its level, before any projection, or below ROUNDING of
    the largest of all.
    """

    def __init__(self, n: int, tolerance: float) -> None:
        self.n, self.tolerance = n, tolerance
        self.ranks: list[int] = []
        self.uncertain = False
        self.factorisations = 0
        self._taken = 0
        self.least = 0.0
        self._steps: list[_Step] = []

    @property
    def free(self) -> int:
        """Number of directions that no level has fixed."""
        return self.n - self._taken

    def solve(
        self,
        A: Mat,
        b: Vec,
        stops: Sequence[int],
        sizes: Sequence[float] = (),
        least: float = 0.0,
    ) -> None:
        """Go through the levels; level k's rows of A ``(M, n)``, b ``(M,)`` end at stops[k], level k + 1's begin there.

        sizes: reference size of each level's pivots, its largest row norm by default.  least: lower bound of a level's
        cut, beside ROUNDING of the largest pivot; the attribute of that name holds the resulting value.
        """
        self.ranks, self._steps, self.uncertain, self.factorisations = [], [], False, 0
        self._taken = start = 0
        tail, b = A.T, b.copy()
        norms = np.zeros(0) if sizes else row_lengths(A)
        self.least = max(least, ROUNDING / self.tolerance * float(max(sizes) if sizes else norms.max(initial=0.0)))
        for k, stop in enumerate(stops):
            m = stop - start
            if m and self.free:
                size = sizes[k] if sizes else float(norms[start:stop].max())
                step = self._level(tail, m, b[start:], max(size, self.least))
            else:
                step = _Step(0, tail[:, m:])
            step.start, step.stop, step.offset = start, stop, self._taken
            self._steps.append(step)
            self._taken += step.rank
            self.ranks.append(step.rank)
            tail, start = step.tail, stop

    def extend(self, A: Mat, b: Vec) -> None:
        """One more level A ``(m, n)``, b ``(m,)`` below all that were solved."""
        if not self.free or not A.shape[0]:
            return
        tail, b = A.T, b.copy()
        for step in self._steps:
            if step.rank:
                tail, _, _ = ormqr("L", "T", step.qr, step.tau, tail, _WORK)
                b -= step.y @ tail[: step.rank]
                tail = tail[step.rank :]
        size = longest_row(A)
        step = self._level(tail, A.shape[0], b, max(size, self.least))
        step.offset = self._taken
        self._steps.append(step)
        self._taken += step.rank

    def point(self) -> Vec:
        """x ``(n,)`` of the levels gone through, the shortest one."""
        y = np.zeros((self.n, 1), order="F")
        for step in self._steps:
            y[step.offset : step.offset + step.rank, 0] = step.y
        for step in reversed(self._steps):
            if step.rank and not step.tall:
                part, _, _ = ormqr("L", "N", step.qr, step.tau, y[step.offset :], _WORK)
                y[step.offset :] = part
        return y[:, 0]

    def _level(self, tail: Mat, m: int, b: Vec, size: float) -> _Step:
        """Factor the first m columns of tail; transform the others; solve for this level's coordinates."""
        free = tail.shape[0]
        self.factorisations += 1
        if m >= free:
            step = self._full(tail, m, b, size)
            if step is not None:
                return step
            self.factorisations += 1
        whole, pivots, tau, _, _ = geqp3(tail[:, :m], lwork=_WORK)
        rank = self._rank(whole, min(m, free), size)
        if rank == 0:
            return _Step(0, tail[:, m:])
        pivots -= 1
        qr = whole
        if rank < m:
            qr, tau = whole[:, :rank], tau[:rank]
        rest = tail[:, m:]
        if rest.shape[1]:
            rest, _, _ = ormqr("L", "T", qr, tau, rest, _WORK)
        step = _Step(rank, rest[rank:], qr, tau, pivots[:rank], top=rest[:rank])
        rhs = b[:m][pivots]
        if rank == m:
            step.y, _ = trtrs(qr[:rank], rhs, trans=1)
        else:
            step.y = gels(np.triu(whole[:rank]).T, rhs, lwork=_WORK)[1][:rank]  # min ||R' y - rhs||, rows dependent
        if step.top.shape[1]:
            b[m:] -= step.y @ step.top
        return step

    def _full(self, tail: Mat, m: int, b: Vec, size: float) -> _Step | None:
        """The step of a level that determines all that is left, None where it turns out not to."""
        free = tail.shape[0]
        qr, pivots, tau, _, _ = geqp3(tail[:, :m].T, lwork=_WORK)
        if self._rank(qr, free, size) < free:
            return None
        pivots -= 1
        image, _, _ = ormqr("L", "T", qr, tau, b[:m, None], _WORK)
        z, _ = trtrs(qr[:free], image[:free, 0])
        step = _Step(free, tail[free:, m:], qr, tau, pivots, top=tail[:, m:], tall=True)
        step.y = np.empty(free)
        step.y[pivots] = z
        return step

    def _rank(self, qr: Mat, most: int, size: float) -> int:
        """Return the number of pivots above the tolerance, relative to the unprojected row norms."""
        cut = self.tolerance * size
        if abs(qr[most - 1, most - 1]) > NEAR * cut:  # pivots never grow: all are
            return most
        pivots = np.abs(qr.diagonal())
        rank = int(np.count_nonzero(pivots > cut))
        smallest_kept = pivots[rank - 1] if rank else np.inf
        largest_cut = pivots[rank] if rank < most else 0.0
        self.uncertain |= bool(smallest_kept < NEAR * cut or largest_cut * NEAR > cut)
        return rank

    def project(self, v: Vec, levels: int) -> Vec:
        """N v, v ``(n,)`` without its part in the row space of the first ``levels`` levels."""
        steps = [step for step in self._steps[:levels] if step.rank]
        if any(step.tall for step in steps):
            return np.zeros(self.n)
        parts = [v.reshape(-1, 1)]
        for step in steps:
            part, _, _ = ormqr("L", "T", step.qr, step.tau, parts[-1], _WORK)
            parts.append(part[step.rank :])
        free = parts[-1]
        for step in reversed(steps):
            whole = np.zeros((free.shape[0] + step.rank, 1), order="F")
            whole[step.rank :] = free
            free, _, _ = ormqr("L", "N", step.qr, step.tau, whole, _WORK)
        return np.array(free[:, 0])

    def multipliers(self, residuals: Vec, stops: Sequence[int]) -> Mat:
        """Column k: lambda_k with sum_{j<=k} A_j' lambda_kj = 0 and lambda_kk = w_k, ``(M, levels)``.

        residuals: ``(M,)``, A x - b at the x of the last solve.  Some dependent rows get zero.
        """
        levels = len(stops)
        L = np.zeros((stops[-1] if stops else 0, levels), order="F")
        start = 0
        for k, stop in enumerate(stops):
            L[start:stop, k] = residuals[start:stop]
            start = stop
        for k in range(levels - 2, -1, -1):
            step, below = self._steps[k], k + 1
            if not step.rank or step.stop >= L.shape[0]:
                continue
            force = -(step.top @ L[step.stop :, below:])
            if step.tall:
                share = np.zeros((step.stop - step.start, force.shape[1]), order="F")
                share[: step.rank], _ = trtrs(step.qr[: step.rank], force[step.pivots], trans=1)
                share, _, _ = ormqr("L", "N", step.qr, step.tau, share, _WORK)
                L[step.start : step.stop, below:] = share
            else:
                L[step.start + step.pivots, below:], _ = trtrs(step.qr[: step.rank], force)
        return L


_NOTHING: Mat = np.zeros((0, 0))
_NOWHERE: Index = np.zeros(0, dtype=np.intp)


class _Step:
    """Result of one level: its reflectors, its coordinates, and how it couples to the levels below."""

    __slots__ = ("offset", "pivots", "qr", "rank", "start", "stop", "tail", "tall", "tau", "top", "y")

    def __init__(
        self,
        rank: int,
        tail: Mat,
        qr: Mat = _NOTHING,
        tau: Vec = _NOTHING,
        pivots: Index = _NOWHERE,
        top: Mat = _NOTHING,
        tall: bool = False,
    ) -> None:
        self.rank, self.tail, self.tall = rank, tail, tall
        self.qr, self.tau, self.pivots, self.top = qr, tau, pivots, top
        self.y: Vec = np.zeros(rank)
        self.start = self.stop = self.offset = 0
