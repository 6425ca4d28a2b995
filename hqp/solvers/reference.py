"""`reference`: the definition as a program (hqp.problem.definition) behind the interface of a solver."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import ClassVar

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.problem import Hierarchy, Motion, Rows, Shape, Solution, Stats, Status
from hqp.problem.certify import certificate
from hqp.problem.definition import Levels, Limits
from hqp.problem.null_directions import without_rounding
from hqp.problem.pricing import is_met
from hqp.solvers.base import Solver, check_fields, finish
from hqp.solvers.flat import Flat
from hqp.tolerances import RANK_TOLERANCE


@dataclass(frozen=True)
class Reference(Solver):
    """The hierarchy level by level, priced or not, by a textbook active-set method (docs/solvers.md).

    rank_tolerance: a row adds no direction where no more than this fraction of its length is left.  max_iterations:
    steps a level may take.  factorisations: limit for the faces of a whole problem, None for no limit.  Either ends in
    ITERATION_LIMIT.
    """

    name: ClassVar[str] = "reference"
    accuracy: ClassVar[float] = 1e-8
    priced: ClassVar[bool] = True

    rank_tolerance: float = RANK_TOLERANCE
    max_iterations: int = 1000
    factorisations: int | None = None

    def __post_init__(self) -> None:
        check_fields(self, shares=("rank_tolerance",), counts=("max_iterations",))
        if self.factorisations is not None:
            check_fields(self, shares=(), counts=("factorisations",))

    def workspace(self, shape: Shape) -> ReferenceWorkspace:
        """Allocate; nothing is kept between solves."""
        self.require(shape)
        return ReferenceWorkspace(self, shape)


class ReferenceWorkspace:
    def __init__(self, solver: Reference, shape: Shape) -> None:
        self._solver, self._flat = solver, Flat(shape)

    def reset(self) -> None:
        """Nothing is kept between solves."""

    def solve(self, problem: Hierarchy) -> Solution:
        """The point found, judged, and where it is refused once more in other coordinates."""
        began = perf_counter()
        unusable = self._flat.load(problem)
        if unusable:
            return self._flat.refuse(problem, Stats(build_s=perf_counter() - began), unusable)
        x, stages, run = self._found(problem)
        steps, passed = run.steps, certificate(problem, x, self._solver.accuracy, stages).ok
        if not passed and self._solver.factorisations is None:
            turned, Q = _turned(problem)
            z, points, run = self._found(turned)
            x, stages, steps = Q @ z, None if points is None else points @ Q.T, steps + run.steps
            passed = certificate(problem, x, self._solver.accuracy, stages).ok
        stats = Stats(steps, 0, 0.0, perf_counter() - began)
        status, detail = Status.OPTIMAL, ""
        if not passed and run.ended:
            status, detail = Status.NOT_CERTIFIED, "the certificate rejects the solution"
        elif not passed:
            status, detail = Status.ITERATION_LIMIT, "a level stopped before its optimum"
        return finish(problem, x, status, stats, detail, stages)

    def _found(self, problem: Hierarchy) -> tuple[Vec, Mat | None, Levels]:
        """The answer, the stage points, and how it went."""
        solver = self._solver
        limits = Limits(solver.rank_tolerance, solver.max_iterations, solver.factorisations)
        run = Levels(without_rounding(problem), limits)
        points = run.points()
        if not problem.priced:
            return points[-1], None, run
        stages, exact = points[: len(problem.levels)].copy(), True  # above all unmet levels
        for k, (rows, priced) in enumerate(zip(problem.levels, problem.priced, strict=True)):
            exact = exact and not (priced and not is_met(rows, stages[k]))
            if exact and not priced:
                stages[k] = np.nan
        return points[-1], stages, run


def _turned(problem: Hierarchy) -> tuple[Hierarchy, Mat]:
    """The problem in other orthogonal coordinates z with x = Q z, in which rounding falls otherwise, and Q."""
    n = problem.n
    Q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(n, n)))
    motion = problem.motion or Motion(np.ones(n))
    F = np.diag(motion.F) if motion.F.ndim == 1 else motion.F
    turned = replace(
        problem,
        levels=tuple(Rows(rows.dense(n) @ Q, rows.lower, rows.upper) for rows in problem.levels),
        metric=None if problem.metric is None else (Q.T @ problem.metric @ Q + Q.T @ problem.metric.T @ Q) / 2.0,
        origin=None if problem.origin is None else Q.T @ problem.origin,
        motion=Motion(F @ Q, motion.f) if problem.priced else None,
        stacked=None,
    )
    return turned, Q
