"""Priced hierarchies as cone programs, written from the equations of pricing alone and solved by Clarabel."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, triu

from hqp import Hierarchy, Motion, Rows
from hqp.arrays import Mat, Vec

MET = 1e-7
"""Tolerance on ||w||: a smaller residual is zero to the accuracy of the cone solver."""


@dataclass
class Oracle:
    """Stage points of a hierarchy, level by level; the last x is the solution before completion.

    doubtful: a level's residual is within the cone solver's accuracy of zero, or the solver missed its accuracy. worse:
    excess of the stage costs of the followed points over the best, relative to 1 + best.
    """

    problem: Hierarchy
    points: list[Vec] = field(default_factory=list)
    doubtful: bool = False
    worse: float = 0.0
    hard: list[tuple[Mat, Vec, Vec]] = field(default_factory=list)
    unmet: list[tuple[Rows, float, Vec, Vec]] = field(default_factory=list)

    def solve(self, followed: Mat | None = None) -> Oracle:
        """Solve level by level.

        followed: ``(levels, n)`` points to hand down instead, NaN for none. A cone solver's own stage point has an
        error of the square root of its accuracy, and lower levels multiply that error.
        """
        problem = self.problem
        for k, rows in enumerate(problem.levels):
            price = 0.0 if problem.prices is None else float(problem.prices[k])
            x = self.stage(rows, price)
            self.points.append(x)
            if followed is not None and np.isfinite(followed[k]).all():
                best = self.objective(rows, price, x)
                x = followed[k]
                self.worse = max(self.worse, (self.objective(rows, price, x) - best) / (1.0 + abs(best)))
            self._hand_down(k, rows, price, x)
        return self

    def objective(self, rows: Rows, price: float, x: Vec) -> float:
        """Stage objective of a level, below the levels handled so far."""
        size = float(np.linalg.norm(rows.slack(x)))
        motion = self.problem.motion or Motion(np.ones(x.size))
        value = size + price * motion(x) if price > 0.0 else 0.5 * size**2
        counts = price if price > 0.0 else 1.0
        for kept, give, turning, point in self.unmet:
            value += 0.5 * counts * float(np.sum(kept.slack(x) ** 2)) / give
            value += 0.5 * counts * float(np.sum((turning * (self._F() @ (x - point))) ** 2))
        return value

    def stage(self, rows: Rows, price: float) -> Vec:
        """argmin over z = (x, w, t, v): A x - w within its bounds, (t, w) in the cone, A_a x - sqrt(give) v at y_a."""
        n, m = self.problem.n, rows.m
        anchored = sum(kept.m for kept, *_ in self.unmet)
        size = n + m + 1 + anchored
        F, f = self._F(), self._f()
        P, q = np.zeros((size, size)), np.zeros(size)
        if price > 0.0:
            P[:n, :n], q[:n], q[n + m] = price * F.T @ F, -price * F.T @ f, 1.0
        else:
            P[n : n + m, n : n + m] = np.eye(m)
        blocks, own = [], np.zeros((m, size))
        own[:, :n], own[:, n : n + m] = rows.dense(n), -np.eye(m)
        blocks.append((own, rows.lower, rows.upper))
        for A, lower, upper in self.hard:
            blocks.append((np.hstack([A, np.zeros((len(A), size - n))]), lower, upper))
        here, counts = n + m + 1, price if price > 0.0 else 1.0
        for kept, give, turning, point in self.unmet:
            part, end = np.zeros((kept.m, size)), here + kept.m
            part[:, :n], part[:, here:end] = kept.dense(n), -np.sqrt(give) * np.eye(kept.m)
            blocks.append((part, kept.lower, kept.upper))
            P[here:end, here:end] = counts * np.eye(kept.m)
            here = end
            D = turning[:, None] * F
            P[:n, :n] += counts * D.T @ D
            q[:n] -= counts * D.T @ (D @ point)
        return self._clarabel(P, q, blocks, (n, m) if price > 0.0 else None)[:n]

    def _clarabel(self, P: Mat, q: Vec, blocks: list[Any], cone: tuple[int, int] | None) -> Vec:
        import clarabel

        C = np.concatenate([block for block, *_ in blocks])
        lower = np.concatenate([low for _, low, _ in blocks])
        upper = np.concatenate([high for *_, high in blocks])
        equal, above = lower == upper, (lower != upper) & np.isfinite(upper)
        below = (lower != upper) & np.isfinite(lower)
        G, h = [C[equal], C[above], -C[below]], [upper[equal], upper[above], -lower[below]]
        cones = [clarabel.ZeroConeT(int(equal.sum())), clarabel.NonnegativeConeT(int(above.sum() + below.sum()))]
        if cone is not None:
            n, m = cone
            block = np.zeros((m + 1, q.size))
            block[0, n + m] = -1.0
            block[1:, n : n + m] = -np.eye(m)
            G.append(block)
            h.append(np.zeros(m + 1))
            cones.append(clarabel.SecondOrderConeT(m + 1))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
        solver = clarabel.DefaultSolver(
            triu(csc_matrix(P)).tocsc(), q, csc_matrix(np.concatenate(G)), np.concatenate(h), cones, settings
        )
        found = solver.solve()
        self.doubtful |= str(found.status) not in ("Solved", "AlmostSolved")
        return np.array(found.x)

    def _hand_down(self, k: int, rows: Rows, price: float, x: Vec) -> None:
        problem = self.problem
        A, w = rows.dense(problem.n), rows.slack(x)
        y, size = A @ x, float(np.linalg.norm(w))
        self.doubtful |= bool(np.any((np.abs(w) > 0.01 * MET) & (np.abs(w) < 100.0 * MET)))
        if price > 0.0 and size <= MET:
            self.hard.append((A, rows.lower, rows.upper))
        elif price > 0.0:
            asks, equal = np.isfinite(rows.lower) | np.isfinite(rows.upper), rows.lower == rows.upper
            low, high = np.where(equal, y, np.minimum(rows.lower, y)), np.where(equal, y, np.maximum(rows.upper, y))
            part = np.where(equal, 1.0, np.abs(w) / size)[asks, None] * A[asks]
            t = 0.0 if problem.turning is None else float(problem.turning[k])
            back = np.linalg.pinv(self._F(), rcond=1e-7)
            columns = np.concatenate([part @ back, part @ back @ self._left()])
            turning = np.sqrt(t) * size * np.linalg.norm(columns, axis=0)
            self.unmet.append((Rows(A[asks], low[asks], high[asks]), problem.eta * price * size, turning, x))
        else:
            equal = (rows.lower == rows.upper) | ((np.abs(w) > MET) & (not self.unmet))
            low, high = np.where(equal, y, np.minimum(rows.lower, y)), np.where(equal, y, np.maximum(rows.upper, y))
            self.hard.append((A, low, high))

    def _left(self) -> Mat:
        """Projection onto the image under F of the null space of S's equality rows."""
        F = self._F()
        rows = [np.zeros((0, self.problem.n)), *(A[low == high] for A, low, high in self.hard)]
        seen, sigma, _ = np.linalg.svd(F @ _null_space(np.concatenate(rows)))
        seen = seen[:, : int(np.count_nonzero(sigma > 1e-7 * np.linalg.norm(F)))]
        return seen @ seen.T

    def _F(self) -> Mat:
        F = np.ones(self.problem.n) if self.problem.motion is None else self.problem.motion.F
        return np.diag(F) if F.ndim == 1 else F

    def _f(self) -> Vec:
        motion = self.problem.motion
        return np.zeros(len(self._F())) if motion is None or motion.f is None else motion.f


def _null_space(A: Mat) -> Mat:
    _, sigma, Vt = np.linalg.svd(A)
    return Vt[int(np.count_nonzero(sigma > 1e-9 * max(sigma.max(initial=0.0), 1e-300))) :].T
