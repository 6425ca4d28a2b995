"""`nullspace`: the recursive projector, equal to the hierarchical QP wherever no inequality is active."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import numpy as np

from hqp.arrays import Mat, Vec, longest_row
from hqp.errors import ProblemError
from hqp.pace import coordinates_below, excess_below, slowed
from hqp.pricing import Coordinates, is_met, stage_price
from hqp.problem import Hierarchy, Shape, Solution, Stats, Status
from hqp.solvers.base import Solver, check_number, finish
from hqp.solvers.completion import metric_factor
from hqp.solvers.flat import Flat
from hqp.solvers.recursion import Recursion
from hqp.solvers.secular import least_unmet
from hqp.tolerances import RANK_TOLERANCE


@dataclass(frozen=True)
class Nullspace(Solver):
    """x_k = x_{k-1} + (J_k N_{k-1})^+ (b_k - J_k x_{k-1}) with the augmented null space N (Siciliano, Slotine 1991).

    Equal to the lexicographic least squares at every rank; metric and origin choose in the last null space
    (Sentis' dynamically consistent law is this with the metric phi*).
    rank_tolerance: a row adds a direction where its pivot exceeds this fraction of the level's largest row norm,
    before projection.  Levels with a price are min ||w_k|| + c E in that null space, with share 0.
    ignore_inequalities: leave inequality rows out, as an ordinary projector must; the answer is marked where one is
    violated.
    """

    name: ClassVar[str] = "nullspace"
    inequalities: ClassVar[bool] = False
    priced: ClassVar[bool] = True
    shares: ClassVar[bool] = False
    accuracy: ClassVar[float] = 1e-8

    rank_tolerance: float = RANK_TOLERANCE
    ignore_inequalities: bool = False

    def __post_init__(self) -> None:
        check_number("nullspace", "rank_tolerance", self.rank_tolerance, below=1.0)

    def workspace(self, shape: Shape) -> NullspaceWorkspace:
        """Allocate; raises UnsupportedProblem for inequalities, unless they are to be ignored."""
        self.require(shape)
        return NullspaceWorkspace(self, shape)


class NullspaceWorkspace:
    """Buffers of one shape; there is no warm start."""

    def __init__(self, solver: Nullspace, shape: Shape) -> None:
        self.flat = Flat(shape)
        self.recursion = Recursion(shape.n, solver.rank_tolerance)
        self._tolerance = solver.rank_tolerance

    def reset(self) -> None:
        """Nothing is kept between solves."""

    def solve(self, problem: Hierarchy) -> Solution:
        """The solution; NOT_CERTIFIED where an ignored inequality is violated."""
        began = perf_counter()
        flat, recursion = self.flat, self.recursion
        unusable = flat.load(problem)
        if unusable:
            return flat.refuse(problem, Stats(build_s=perf_counter() - began), unusable)
        A, b, stops = flat.equations()
        shift = problem.origin if problem.metric is None and not problem.priced else None
        if shift is not None:
            b = b - A @ shift
        built = perf_counter()
        if problem.priced:
            if any(c > 0.0 and problem.share(k) > 0.0 for k, c in enumerate(problem.prices)):  # type: ignore[arg-type]
                raise ProblemError("nullspace: hands down no shares, needs shares = 0 where a level has a price")
            return self._priced(problem, A, b, stops, began)
        recursion.solve(A, b, stops)
        if problem.metric is not None and recursion.free:
            F = metric_factor(problem.metric)
            recursion.extend(F, np.zeros(F.shape[0]) if problem.origin is None else F @ problem.origin)
        x = recursion.point()
        if shift is not None:
            x = x + shift
        status, detail = self._verdict(x)
        stats = Stats(0, recursion.factorisations, built - began, perf_counter() - built)
        return flat.finish(problem, x, status, stats, detail)

    def _priced(self, problem: Hierarchy, A: Mat, b: Vec, stops: list[int], began: float) -> Solution:
        """Level by level in the coordinates of the motion: y = y_above + Z z, z by the secular equation."""
        prices = problem.prices if problem.prices is not None else np.zeros(len(stops))
        at = Coordinates.of(problem.motion, problem.n)
        y, Z = np.zeros(problem.n), np.eye(problem.n)
        stages = np.full((len(stops), problem.n), np.nan)
        b, excess, below = b.copy(), 1.0, coordinates_below(problem)
        for k, (start, stop) in enumerate(zip([0, *stops], stops, strict=False)):
            if k in below:
                given = slowed(problem, k, at, excess)
                b[start:stop] = given.lower[given.equality]
            rows = A[start:stop]
            B = at.rows(rows)
            size = longest_row(B)
            if size > 0.0 and Z.shape[1]:
                e = b[start:stop] - rows @ at.still - B @ y
                z, seen = least_unmet(B @ Z, e, stage_price(problem, stages, k), self._tolerance * size)
                y = y + Z @ z
                Z = Z @ np.linalg.svd(seen, full_matrices=True)[0][:, seen.shape[1] :]
            if prices[k] > 0.0:
                stages[k] = at.point(y)
                if not is_met(problem.levels[k], stages[k]):
                    excess = min(excess, excess_below(problem, k, stages[k]))
        x = _complete(problem, at.point(y), at.P[:, None] * Z if at.P.ndim == 1 else at.P @ Z)
        status, detail = self._verdict(x)
        return finish(problem, x, status, Stats(0, len(stops), 0.0, perf_counter() - began), detail, stages)

    def _verdict(self, x: Vec) -> tuple[Status, str]:
        if self.flat.inequality.any() and not self._inequalities_hold(x):
            return Status.NOT_CERTIFIED, "an inequality that was left out is violated"
        if self.recursion.uncertain:
            return Status.RANK_UNCERTAIN, "a pivot lay near rank_tolerance"
        return Status.OPTIMAL, ""

    def _inequalities_hold(self, x: Vec) -> bool:
        rows = self.flat.inequality
        w = self.flat.slack(x)[rows]
        return bool(np.all(np.abs(w) <= 1e-9 * (1.0 + np.abs(self.flat.A[rows]) @ np.abs(x))))


def _complete(problem: Hierarchy, x: Vec, D: Mat) -> Vec:
    """The point of x + D z that the metric about the origin prefers, then the shortest."""
    origin = np.zeros(x.size) if problem.origin is None else problem.origin
    if problem.metric is not None and D.size:
        F = metric_factor(problem.metric)
        size = longest_row(F @ D)
        z, seen = least_unmet(F @ D, F @ (origin - x), 0.0, 1e-10 * size)
        x, D = x + D @ z, D @ np.linalg.svd(seen, full_matrices=True)[0][:, seen.shape[1] :]
        origin = np.zeros(x.size)
    if D.size:
        x = x + D @ np.linalg.lstsq(D, origin - x, rcond=None)[0]
    return x
