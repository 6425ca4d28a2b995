"""`nullspace`: the recursive projector, equal to the hierarchical QP wherever no inequality is active."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import numpy as np

from hqp.arrays import Vec
from hqp.numbers import set_numbers
from hqp.problem import Hierarchy, Shape, Solution, Stats, Status
from hqp.problem.completion import metric_factor
from hqp.solvers.base import Solver
from hqp.solvers.flat import Flat
from hqp.solvers.recursion import Recursion
from hqp.tolerances import RANK_TOLERANCE


@dataclass(frozen=True)
class Nullspace(Solver):
    """x_k = x_{k-1} + (J_k N_{k-1})^+ (b_k - J_k x_{k-1}) with the augmented null space N (Siciliano, Slotine 1991).

    Equal to the lexicographic least squares at every rank; metric and origin choose in the last null space
    (Sentis' dynamically consistent law is this with the metric phi*).
    rank_tolerance: a row adds a direction where its pivot exceeds this fraction of the level's largest row norm,
    before projection.
    ignore_inequalities: leave inequality rows out, as an ordinary projector must; the answer is marked where one is
    violated.
    """

    name: ClassVar[str] = "nullspace"
    inequalities: ClassVar[bool] = False
    accuracy: ClassVar[float] = 1e-8

    rank_tolerance: float = RANK_TOLERANCE
    ignore_inequalities: bool = False

    def __post_init__(self) -> None:
        set_numbers(self, "nullspace", ("rank_tolerance",), 0.0, strict=True, below=1.0)

    def workspace(self, shape: Shape) -> NullspaceWorkspace:
        """Allocate; raises UnsupportedProblem for inequalities, unless they are to be ignored."""
        self.require(shape)
        return NullspaceWorkspace(self, shape)


class NullspaceWorkspace:
    """Buffers of one shape; there is no warm start."""

    def __init__(self, solver: Nullspace, shape: Shape) -> None:
        self.flat = Flat(shape)
        self.recursion = Recursion(shape.n, solver.rank_tolerance)

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
        shift = problem.origin if problem.metric is None else None
        if shift is not None:
            b = b - A @ shift
        built = perf_counter()
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

    def _verdict(self, x: Vec) -> tuple[Status, str]:
        if self.flat.inequality.any() and not self._inequalities_hold(x):
            return Status.NOT_CERTIFIED, "an ignored inequality is violated"
        if self.recursion.uncertain:
            return Status.RANK_UNCERTAIN, "a pivot is near rank_tolerance"
        return Status.OPTIMAL, ""

    def _inequalities_hold(self, x: Vec) -> bool:
        rows = self.flat.inequality
        w = self.flat.slack(x)[rows]
        return bool(np.all(np.abs(w) <= 1e-9 * (1.0 + np.abs(self.flat.A[rows]) @ np.abs(x))))
