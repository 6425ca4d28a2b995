"""`cascade`: one quadratic program a level, in the null-space basis of the levels above, by any back end."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import numpy as np

from hqp.arrays import Index, Mask, Mat, Vec, row_lengths
from hqp.errors import BackendError
from hqp.problem import Shape, Stats
from hqp.solvers.backends import QpAnswer, QpWorkspace, load
from hqp.solvers.external import External, ExternalWorkspace
from hqp.solvers.recursion import Recursion, geqp3, ormqr
from hqp.tolerances import ROUNDING

RELAXATION = 1e-11
"""Rows met above may be left by this much [unit of the row, its length taken as 1]: the next level is degenerate."""


@dataclass(frozen=True)
class Cascade(External):
    """Level by level min ||w_k|| with the levels above kept optimal (Kanoun, Lamiraux, Wieber 2011).

    Level k moves in x + Z y only, Z an orthonormal null-space basis of the rows that the levels above fix: equalities,
    violated rows (their optimal slack is unique) and met rows with a positive multiplier; other met rows are carried
    along as inequalities.  No fixed row is ever stacked as an equality.  The completion is the last level.
    backend: proxqp, osqp, or any solver of qpsolvers.  Its options are those of External, max_iterations a level.
    """

    name: ClassVar[str] = "cascade"

    backend: str = "proxqp"

    def exact(self, shape: Shape) -> CascadeWorkspace:
        """A workspace; raises DeclarationError for an unknown back end."""
        return CascadeWorkspace(self, shape)


class CascadeWorkspace(ExternalWorkspace):
    """Buffers of one shape, and the back end's workspace of every size of QP met so far."""

    def __init__(self, solver: Cascade, shape: Shape) -> None:
        super().__init__(solver, shape, trusted=max(1e-7, 100.0 * solver.tolerance))
        self.solver = solver
        self._backend = load(solver.backend, solver.tolerance, solver.max_iterations)
        self._programs: dict[tuple[int, ...], QpWorkspace] = {}
        self._single = Recursion(shape.n, solver.rank_tolerance)

    def reset(self) -> None:
        """Forget the warm starts."""
        self._programs.clear()

    def find(self, began: float) -> tuple[Vec, Stats, str]:
        """x level by level."""
        flat, n = self.flat, self.flat.shape.n
        self._iterations, self._qp_s = 0, 0.0
        self._complaints: list[str] = []
        self._lengths = row_lengths(flat.A)
        x: Vec = np.zeros(n)
        Z: Mat = np.eye(n)
        held: Index = np.zeros(0, dtype=np.intp)
        start = 0
        settled = (
            self.refiner is not None and not flat.inequality.any()
        )  # no active set to find: refining has no effect
        for k, stop in enumerate(flat.stops):
            if settled or not Z.shape[1]:
                break
            x, Z, held = self._level(k, np.arange(start, stop), x, Z, held)
            start = stop
        stats = Stats(self._iterations, 0, perf_counter() - began - self._qp_s, self._qp_s)
        return x, stats, "; ".join(self._complaints)

    def _level(self, k: int, rows: Index, x: Vec, Z: Mat, held: Index) -> tuple[Vec, Mat, Index]:
        """x moved to the optimum of level k, Z and held rows for the level below."""
        flat = self.flat
        equal, unequal = rows[flat.equality[rows]], rows[flat.inequality[rows]]
        size = float(self._lengths[rows].max(initial=0.0))
        if size <= ROUNDING * float(self._lengths.max()) or not equal.size + unequal.size:
            return x, Z, held
        pressed: Mask = np.zeros(held.size, dtype=bool)
        w = self._slack(rows, x)
        if np.any(np.abs(w) > 1e-14 * (self._lengths[rows] + np.abs(flat.A[rows]) @ np.abs(x))):
            if held.size or unequal.size:
                y, pressed = self._program(k, equal, unequal, held, x, Z, size)
            else:
                self._single = Recursion(Z.shape[1], self.solver.rank_tolerance)
                self._single.solve(flat.A[rows] @ Z, flat.lower[rows] - flat.A[rows] @ x, [rows.size], sizes=[size])
                y = self._single.point()
            x = x + Z @ y
        w = np.abs(self._slack(unequal, x))
        broken = w > self._trusted * size * (1.0 + np.abs(x).max())
        fixed = np.concatenate([flat.A[equal] / size, flat.A[unequal[broken]] / size])
        locked = flat.A[held[pressed]] / self._lengths[held[pressed], None]
        Z = self._shrink(Z, np.concatenate([fixed, locked]))
        return x, Z, np.concatenate([held[~pressed], unequal[~broken]])

    def _program(
        self, k: int, equal: Index, unequal: Index, held: Index, x: Vec, Z: Mat, size: float
    ) -> tuple[Vec, Mask]:
        """Level k as a QP in (y, w): its step y, and which held rows it presses against."""
        flat, r, m = self.flat, Z.shape[1], unequal.size
        J, e = (flat.A[equal] @ Z) / size, (flat.lower[equal] - flat.A[equal] @ x) / size
        H, g = np.zeros((r + m, r + m)), np.zeros(r + m)
        H[:r, :r], g[:r] = J.T @ J, -(e @ J)
        H[np.arange(r, r + m), np.arange(r, r + m)] = 1.0
        C = np.zeros((m + held.size, r + m))
        scale = np.concatenate([np.full(m, size), np.maximum(self._lengths[held], 1e-300)])
        both = np.concatenate([unequal, held])
        C[:, :r] = (flat.A[both] @ Z) / scale[:, None]
        C[np.arange(m), np.arange(r, r + m)] = -1.0
        value = flat.A[both] @ x
        lower, upper = (flat.lower[both] - value) / scale, (flat.upper[both] - value) / scale
        lower[m:] = np.minimum(lower[m:], 0.0) - RELAXATION
        upper[m:] = np.maximum(upper[m:], 0.0) + RELAXATION
        answer = self._solve_qp((k, r, m, held.size), H, g, C, lower, upper)
        if answer is None:
            return np.zeros(r), np.zeros(held.size, dtype=bool)
        pressed = np.abs(answer.multipliers[m:]) > max(1e-6, 1e3 * self.solver.tolerance)
        return answer.x[:r], pressed & (self._lengths[held] > 0.0)  # a row of zeros locks nothing

    def _solve_qp(self, key: tuple[int, ...], H: Mat, g: Vec, C: Mat, lower: Vec, upper: Vec) -> QpAnswer | None:
        """The back end's answer; None, and a complaint noted, where it has none."""
        began = perf_counter()
        if key not in self._programs:
            self._programs[key] = self._backend.workspace(C.shape[1], C.shape[0])
        try:
            answer = self._programs[key].solve(H, g, C, lower, upper)
        except BackendError as error:
            self._complaints.append(f"level {key[0]}: {error}")
            del self._programs[key]
            return None
        finally:
            self._qp_s += perf_counter() - began
        self._iterations += answer.iterations
        if not answer.solved:
            self._complaints.append(f"level {key[0]}: {self.solver.backend} ended with {answer.status}")
        if not np.isfinite(answer.x).all() or not np.isfinite(answer.multipliers).all():
            del self._programs[key]
            return None
        return answer

    def _shrink(self, Z: Mat, rows: Mat) -> Mat:
        """An orthonormal basis of the part of range(Z) that rows of about unit length do not see."""
        if not rows.size:
            return Z
        qr, _, tau, _, _ = geqp3((rows @ Z).T)
        rank = int(np.count_nonzero(np.abs(qr.diagonal()) > self.solver.rank_tolerance))
        turned, _, _ = ormqr("R", "N", qr[:, : tau.size], tau, Z, max(1, 64 * Z.shape[0]))
        return np.asarray(turned[:, rank:])

    def _slack(self, rows: Index, x: Vec) -> Vec:
        value = self.flat.A[rows] @ x
        return np.asarray(value - np.minimum(np.maximum(value, self.flat.lower[rows]), self.flat.upper[rows]))
