"""The workspace of the reference: loads the rows, runs the active set, reports from (problem, x)."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from hqp.arrays import Signs, Vec
from hqp.problem import Hierarchy, Shape, Solution, Stats, Status
from hqp.solvers.flat import Flat
from hqp.solvers.lexicographic import DAMPED, STUCK, second_opinion
from hqp.solvers.lexicographic_reference.active_set import ActiveSet
from hqp.solvers.lexicographic_reference.equality import adjoint, slack
from hqp.solvers.lexicographic_reference.table import Table, table

if TYPE_CHECKING:
    from hqp.solvers.lexicographic import Lexicographic


class ReferenceWorkspace:
    """Buffers of one shape and the working set of the last solve."""

    def __init__(self, solver: Lexicographic, shape: Shape) -> None:
        self._solver = solver
        self._flat = Flat(shape, complete=True)
        self._damping = solver.level_damping(shape)
        self._warm: tuple[Signs, Signs] | None = None

    def reset(self) -> None:
        """Forget the warm start."""
        self._warm = None

    def solve(self, problem: Hierarchy) -> Solution:
        """The solution; raises ProblemError for a wrong shape, and marks numbers that are not usable."""
        solution = self._solve(problem)
        if solution.detail != STUCK:
            return solution
        self.reset()
        return second_opinion(problem, solution, (lambda: self._solve(problem),))

    def _solve(self, problem: Hierarchy) -> Solution:
        begin = perf_counter()
        unusable = self._flat.load(problem)
        if unusable:
            self._warm = None
            return self._flat.refuse(problem, Stats(build_s=perf_counter() - begin), unusable)
        rows = table(self._flat, self._damping)
        built = perf_counter()
        run = ActiveSet(rows, self._solver, self._warm, begin)
        run.run()
        self._warm = run.W, run.F
        status, detail = run.status, STUCK if run.status is Status.NOT_CERTIFIED else ""
        if run.shifted and status.solved:
            status, detail = Status.NOT_STRICT, DAMPED
        stats = Stats(run.factorisations, run.factorisations, built - begin, perf_counter() - built)
        solution = self._flat.finish(problem, run.x, status, stats, detail)
        if not self._solver.multipliers or run.point is None:
            return solution
        return Solution(
            solution.x,
            solution.status,
            solution.residuals,
            solution.active,
            solution.stats,
            solution.detail,
            self._multipliers(rows, run, solution),
        )

    def _multipliers(self, rows: Table, run: ActiveSet, solution: Solution) -> tuple[Vec, ...]:
        """Per level k the adjoint of its slack over the levels above, the box taking what is left of the gradient."""
        point = run.point
        if point is None:
            return ()
        found = []
        for k, w in enumerate(solution.residuals):
            values: list[Vec] = [np.zeros(r.size) for r in solution.residuals[: k + 1]]
            inner, _ = slack(rows, run.W, point, k, self._solver.multiplier_tolerance)
            if inner.any():
                above, _, g, _ = adjoint(rows, point, k, inner)
                for j, lam in enumerate(above):
                    place = point.chain[j].rows - rows.levels[j][0] if lam.size else []
                    values[j][place] = lam
                if rows.box.taken:
                    values[0] = self._box(rows, run.F, g)
            values[k] = w
            found.append(np.concatenate(values))
        return tuple(found)

    def _box(self, rows: Table, F: Signs, g: Vec) -> Vec:
        """A held variable's multiplier goes to the first row of level 0 that holds it."""
        level = rows.levels[0]
        A, left, out = rows.A[level], np.where(F != 0, g, 0.0), np.zeros(level.size)
        for i, a in enumerate(A):
            j = int(np.flatnonzero(a)[0])
            value = a[j] * (rows.box.hi[j] if F[j] > 0 else rows.box.lo[j])
            sides = (rows.lower[level[i]], rows.upper[level[i]])
            if left[j] != 0.0 and any(abs(value - bound) <= 1e-9 * (1.0 + abs(bound)) for bound in sides):
                out[i], left[j] = -left[j] / a[j], 0.0
        return out
