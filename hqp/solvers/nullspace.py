"""`nullspace`: the recursive projector, equal to the hierarchical QP wherever no inequality is active."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import numpy as np

from hqp.arrays import Vec
from hqp.errors import DeclarationError, UnsupportedProblem
from hqp.problem import Hierarchy, Shape, Solution, Stats, Status
from hqp.solvers.base import Solver, check_number
from hqp.solvers.completion import metric_factor
from hqp.solvers.flat import Flat
from hqp.solvers.recursion import Recursion
from hqp.tolerances import RANK_TOLERANCE


@dataclass(frozen=True)
class Nullspace(Solver):
    """x_k = x_{k-1} + (J_k N_{k-1})^+ (b_k - J_k x_{k-1}) with the augmented null space N (Siciliano, Slotine 1991).

    Equal to the lexicographic least squares at every rank; metric and origin choose in the last null space
    (Sentis' dynamically consistent law is this with the metric phi*).
    rank_tolerance: a row adds a direction where its pivot exceeds this fraction of the level's largest row norm,
    before projection.  damping: lambda [unit of A], one for all levels or one a level, min ||w_k||^2 + lambda^2
    ||step||^2; the levels above never notice, the answer is marked where the level is not at its optimum.
    ignore_inequalities: leave inequality rows out, as an ordinary projector must; the answer is marked where one is
    violated.
    """

    name: ClassVar[str] = "nullspace"
    inequalities: ClassVar[bool] = False
    accuracy: ClassVar[float] = 1e-8

    rank_tolerance: float = RANK_TOLERANCE
    damping: float | tuple[float, ...] = 0.0
    ignore_inequalities: bool = False

    def __post_init__(self) -> None:
        check_number("nullspace", "rank_tolerance", self.rank_tolerance, below=1.0)
        if isinstance(self.damping, (tuple, list)):
            object.__setattr__(self, "damping", tuple(self.damping))
        for value in self.damping if isinstance(self.damping, tuple) else (self.damping,):
            check_number("nullspace", "damping", value, closed=True)

    def require(self, shape: Shape) -> None:
        """As Solver.require; inequalities pass where they are to be ignored."""
        if shape.inequalities and not self.ignore_inequalities:
            raise UnsupportedProblem(
                f"{self.name} takes no inequalities; take an HQP solver such as 'lexicographic', or let it leave them "
                "out with ignore_inequalities=True"
            )
        if isinstance(self.damping, tuple) and len(self.damping) != len(shape.rows):
            raise DeclarationError(
                self.name, "one damping a level", value=self.damping, allowed=f"{len(shape.rows)} numbers"
            )

    def workspace(self, shape: Shape) -> NullspaceWorkspace:
        """Allocate; raises UnsupportedProblem for inequalities, unless they are to be ignored."""
        self.require(shape)
        return NullspaceWorkspace(self, shape)


class NullspaceWorkspace:
    """Buffers of one shape; there is no warm start."""

    def __init__(self, solver: Nullspace, shape: Shape) -> None:
        self.flat = Flat(shape)
        self.recursion = Recursion(shape.n, solver.rank_tolerance)
        levels = len(shape.rows)
        damping = solver.damping if isinstance(solver.damping, tuple) else (float(solver.damping),) * levels
        self.damping = damping if any(damping) else ()
        self._accuracy = solver.accuracy

    def reset(self) -> None:
        """Nothing is kept between solves."""

    def solve(self, problem: Hierarchy) -> Solution:
        """The solution; NOT_CERTIFIED where an ignored inequality is violated or damping moved a level."""
        began = perf_counter()
        flat, recursion = self.flat, self.recursion
        unusable = flat.load(problem)
        if unusable:
            return flat.refuse(problem, Stats(build_s=perf_counter() - began), unusable)
        A, b, stops = flat.A, flat.lower, flat.stops
        if not flat.equality.all():
            A, b = A[flat.equality], b[flat.equality]
            stops = [int(np.count_nonzero(flat.equality[:stop])) for stop in stops]
        shift = problem.origin if problem.metric is None else None
        if shift is not None:
            b = b - A @ shift
        built = perf_counter()
        recursion.solve(A, b, stops, self.damping)
        if problem.metric is not None and recursion.free:
            F = metric_factor(problem.metric)
            recursion.extend(F, np.zeros(F.shape[0]) if problem.origin is None else F @ problem.origin)
        x = recursion.point()
        if shift is not None:
            x = x + shift
        status, detail = self._verdict(A, b if shift is None else b + A @ shift, stops, x)
        stats = Stats(0, recursion.factorisations, built - began, perf_counter() - built)
        return flat.finish(problem, x, status, stats, detail)

    def _verdict(self, A: Vec, b: Vec, stops: list[int], x: Vec) -> tuple[Status, str]:
        if self.flat.inequality.any() and not self._inequalities_hold(x):
            return Status.NOT_CERTIFIED, "an inequality that was left out is violated"
        if self.damping:
            left = np.abs(A.T @ self.recursion.multipliers(A @ x - b, stops)).max(axis=0, initial=0.0)
            sizes = [np.abs(A[a:z]).max(initial=0.0) for a, z in zip([0, *stops], stops, strict=False)]
            if np.any(left > self._accuracy * np.square(sizes)):
                return Status.NOT_STRICT, "damping keeps a level from its optimum"
        if self.recursion.uncertain:
            return Status.RANK_UNCERTAIN, "a pivot lay near rank_tolerance"
        return Status.OPTIMAL, ""

    def _inequalities_hold(self, x: Vec) -> bool:
        rows = self.flat.inequality
        w = self.flat.slack(x)[rows]
        return bool(np.all(np.abs(w) <= 1e-9 * (1.0 + np.abs(self.flat.A[rows]) @ np.abs(x))))
