"""`weighted`: all levels in one quadratic program, priorities by weight: the baseline of strictness."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import numpy as np

from hqp.arrays import Mask, Vec
from hqp.errors import BackendError, DeclarationError
from hqp.numbers import number, set_numbers
from hqp.problem import Hierarchy, Shape, Solution, Stats, Status
from hqp.solvers.backends import QpAnswer, QpWorkspace, load
from hqp.solvers.base import Solver
from hqp.solvers.flat import Flat


@dataclass(frozen=True)
class Weighted(Solver):
    """min sum_k (weight_k ||w_k||)^2 with the constraint levels hard, as one-QP libraries such as pink and mink do.

    Never strict: a lower level moves a higher one by about (weight below / weight above)^2, so no answer is OPTIMAL.
    Constraint levels that cannot all hold are softened, with the weight of a level above all others.  ratio: weight of
    a level over that of the level below it, on the norm; the last level has weight 1.  weights: one a level, in place
    of ratio.  regularisation: weight of the completion.  backend, tolerance, max_iterations: see Cascade.
    """

    name: ClassVar[str] = "weighted"
    strict: ClassVar[bool] = False

    ratio: float = 10.0
    weights: tuple[float, ...] | None = None
    regularisation: float = 1e-4
    backend: str = "proxqp"
    tolerance: float = 1e-8
    max_iterations: int = 2000

    def __post_init__(self) -> None:
        if self.weights is not None:
            weights = tuple(number("weighted", "weights", weight, 0.0, strict=True) for weight in self.weights)
            object.__setattr__(self, "weights", weights)
        set_numbers(self, "weighted", ("ratio", "regularisation", "tolerance"), 0.0, strict=True)
        set_numbers(self, "weighted", ("max_iterations",), 1)

    def require(self, shape: Shape) -> None:
        """As Solver.require; raises DeclarationError for weights of another number of levels."""
        super().require(shape)
        if self.weights is not None and len(self.weights) != len(shape.rows):
            raise DeclarationError(
                self.name, "one weight per level", value=self.weights, allowed=f"{len(shape.rows)} numbers"
            )

    def workspace(self, shape: Shape) -> WeightedWorkspace:
        """Allocate; raises DeclarationError for an unknown back end."""
        self.require(shape)
        return WeightedWorkspace(self, shape)


class WeightedWorkspace:
    """Buffers of one shape, and the back end's workspace of every size of QP met so far."""

    def __init__(self, solver: Weighted, shape: Shape) -> None:
        self.solver = solver
        self.flat = Flat(shape, complete=True)
        levels, extra = len(shape.rows), len(self.flat.sizes) - len(shape.rows)
        weights = solver.weights or tuple(solver.ratio ** (levels - 1 - k) for k in range(levels))
        # a metric that leaves ties is followed by the identity, far below it
        completion = [solver.regularisation * 10.0 ** (-2 * k) for k in range(extra)]
        self._weight = np.repeat(np.array([*weights, *completion]), self.flat.sizes)
        self._softened = solver.ratio * max(weights, default=1.0)
        self._backend = load(solver.backend, solver.tolerance, solver.max_iterations, feasible=False)
        self._programs: dict[tuple[int, int], QpWorkspace] = {}

    def reset(self) -> None:
        """Forget the warm starts."""
        self._programs.clear()

    def solve(self, problem: Hierarchy) -> Solution:
        """The weighted compromise, NOT_STRICT, or NOT_CERTIFIED where the back end failed."""
        began = perf_counter()
        flat = self.flat
        unusable = flat.load(problem)
        if unusable:
            return flat.refuse(problem, Stats(build_s=perf_counter() - began), unusable)
        hard = np.arange(self._weight.size) < (flat.stops[problem.constraints - 1] if problem.constraints else 0)
        detail = "levels are weighted, not strict"
        built = perf_counter()
        answer = self._program(hard, self._weight)
        if (answer is None or not answer.solved) and hard.any():
            detail += "; the constraints were softened"
            softened = np.where(hard, self._softened, self._weight)
            answer = self._program(np.zeros_like(hard), softened)
        status = Status.NOT_STRICT
        if answer is None or not answer.solved:
            status = Status.NOT_CERTIFIED
            detail += f"; {self.solver.backend} did not reach its tolerance"
        x = np.zeros(problem.n) if answer is None else answer.x[: problem.n]
        stats = Stats(answer.iterations if answer else 0, 0, built - began, perf_counter() - built)
        return flat.finish(problem, x, status, stats, detail)

    def _program(self, hard: Mask, weight: Vec) -> QpAnswer | None:
        """min over (x, w of the soft inequalities); None where the back end has no answer."""
        flat, n = self.flat, self.flat.shape.n
        sums = flat.equality & ~hard
        soft = np.flatnonzero(flat.inequality & ~hard)
        firm = np.flatnonzero((flat.equality | flat.inequality) & hard)
        scaled = flat.A[sums] * weight[sums, None]
        size = float(weight.max(initial=1.0))
        H = np.zeros((n + soft.size, n + soft.size))
        H[:n, :n] = scaled.T @ scaled
        H[range(n, n + soft.size), range(n, n + soft.size)] = weight[soft] ** 2
        g = np.concatenate([-(scaled.T @ (weight[sums] * flat.lower[sums])), np.zeros(soft.size)])
        rows = np.concatenate([firm, soft])
        C = np.zeros((rows.size, n + soft.size))
        C[:, :n] = flat.A[rows]
        C[range(firm.size, rows.size), range(n, n + soft.size)] = -1.0
        key = (n + soft.size, rows.size)
        if key not in self._programs:
            self._programs[key] = self._backend.workspace(*key)
        try:
            answer = self._programs[key].solve(H / size**2, g / size**2, C, flat.lower[rows], flat.upper[rows])
        except BackendError:
            answer = None
        if answer is None or not np.isfinite(answer.x).all():
            del self._programs[key]
            return None
        return answer
