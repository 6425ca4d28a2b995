"""The native lexicographic solver: all levels in one active set, one structured factorisation per change."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from numbers import Integral, Real
from time import perf_counter
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from hqp.arrays import Mat, Vec, readable
from hqp.errors import DeclarationError, SolverNotInstalled
from hqp.native import ADVICE
from hqp.numbers import number
from hqp.problem import Hierarchy, Selection, Shape, Solution, Stats, Status
from hqp.solvers.base import UNSURE, Solver, Workspace, check_shape
from hqp.solvers.flat import Flat
from hqp.solvers.lazy import LazySolution
from hqp.solvers.second_opinion import STUCK, second_opinion
from hqp.solvers.stages import Kernel, StagedWorkspace, row_parts, stage_tolerances
from hqp.tolerances import FEASIBILITY_TOLERANCE, MULTIPLIER_TOLERANCE, RANK_TOLERANCE, SOFTNESS

try:
    _native: Any = importlib.import_module("hqp._lexicographic")
except ImportError:
    _native = None

STATUSES = (
    Status.OPTIMAL,
    Status.RANK_UNCERTAIN,
    Status.CONSTRAINTS_VIOLATED,
    Status.NOT_CERTIFIED,
    Status.ITERATION_LIMIT,
    Status.TIME_LIMIT,
)

DOUBTFUL = (Status.NOT_CERTIFIED, Status.RANK_UNCERTAIN)
"""Statuses of answers that the certificate judges once more where no time is set."""

OTHER_RANKS = (1e-7, 1e-10, 1e-8, 1e-5, 1e-11)
"""Rank tolerances tried where the solver's own led to no answer that passes: no single one suits all problems."""

NO_KERNEL = f"lexicographic: hqp was built without its native kernel; {ADVICE}, or use the solver 'cascade'"


def native_module() -> Any:
    """The module of the native kernel, None where the package was built without a compiler."""
    return _native


def kernel() -> str:
    """The native kernel's instruction set, ``""`` where the package was built without a compiler."""
    return "" if _native is None else str(_native.instruction_set)


@dataclass(frozen=True, kw_only=True)
class Lexicographic(Solver):
    """Lexicographic least squares by one active set over all levels (docs/lexicographic.md).

    rank_tolerance: a pivot below this times the largest row norm of its level is no direction of that level.
    multiplier_tolerance, feasibility_tolerance: relative, below them a multiplier has no sign and a bound is met.
    max_iterations: working sets solved, None for 100 + 10 (rows + n).  deadline [s]: time limit of one solve, None for
    no limit; either cap returns the best point so far.  max_failed_exchanges: number of block exchanges without a
    decrease of violated bounds and wrong signs before single changes take over.  multipliers: return them.  Raises
    DeclarationError for a value out of range, SolverNotInstalled where the package was built without a compiler.
    """

    name: ClassVar[str] = "lexicographic"
    accuracy: ClassVar[float] = 1e-8
    priced: ClassVar[bool] = True

    rank_tolerance: float = RANK_TOLERANCE
    multiplier_tolerance: float = MULTIPLIER_TOLERANCE
    feasibility_tolerance: float = FEASIBILITY_TOLERANCE
    max_iterations: int | None = None
    deadline: float | None = None
    max_failed_exchanges: int = 3
    multipliers: bool = False

    def __post_init__(self) -> None:
        for option in ("rank_tolerance", "multiplier_tolerance", "feasibility_tolerance"):
            value = getattr(self, option)
            if not isinstance(value, Real) or not 0.0 < float(value) < 1e-2:
                raise DeclarationError(f"lexicographic.{option}", "out of range", value=value, allowed="(0, 0.01)")
        if self.max_iterations is not None and not _is_count(self.max_iterations, 1):
            raise DeclarationError("lexicographic.max_iterations", "need at least one", value=self.max_iterations)
        if self.deadline is not None and (not isinstance(self.deadline, Real) or not float(self.deadline) > 0.0):
            raise DeclarationError("lexicographic.deadline", "must be positive", value=self.deadline, unit="s")
        if not _is_count(self.max_failed_exchanges, 0):
            raise DeclarationError("lexicographic.max_failed_exchanges", "negative", value=self.max_failed_exchanges)
        if _native is None:
            raise SolverNotInstalled(NO_KERNEL)

    @property
    def options(self) -> dict[str, float]:
        """Options for native code and for a file; zero for no cap."""
        return {
            "rank_tolerance": self.rank_tolerance,
            "multiplier_tolerance": self.multiplier_tolerance,
            "feasibility_tolerance": self.feasibility_tolerance,
            "deadline": self.deadline or 0.0,
            "max_iterations": self.max_iterations or 0,
            "max_failed_exchanges": self.max_failed_exchanges,
            "softness": SOFTNESS,
        }

    def workspace(self, shape: Shape) -> Workspace:
        """Allocate for problems of this shape."""
        self.require(shape)
        if not shape.priced:
            return NativeWorkspace(self, shape)
        staged = StagedWorkspace(shape, NativeWorkspace(replace(self, multipliers=False), shape))
        if self.deadline is not None:
            staged.limit(self.deadline)
        return staged


def _is_count(value: object, least: int) -> bool:
    return isinstance(value, Integral) and least <= int(value) < 2**31


class NativeWorkspace:
    """A kernel bound to the arrays of the last hierarchy it saw, which may be refilled in place between calls.

    It solves hierarchies without prices; native: the workspace of a priced shape solves those as well.
    """

    def __init__(self, solver: Lexicographic, shape: Shape) -> None:
        self._solver, self._shape = solver, replace(shape, priced=())
        self._multipliers = solver.multipliers
        self._limited = self._ticking = bool(solver.deadline)
        self.native = _native.Workspace(
            shape.n,
            list(shape.rows),
            shape.metric,
            solver.options,
            solver.multipliers,
            shape.priced or (False,) * len(shape.rows),
            stage_tolerances(),
        )
        self._views = self.native.numbers(), self.native.multipliers()
        rows = [sum(shape.rows[:k]) for k in range(len(shape.rows) + 1)]
        pairs = [sum(rows[1 : k + 1]) for k in range(len(rows))]
        marks = (shape.n + rows[-1]) * 8
        self.native.report_as(
            LazySolution,
            STATUSES,
            tuple(slice(shape.n + a, shape.n + b) for a, b in pairwise(rows)),
            tuple(slice(marks + a, marks + b) for a, b in pairwise(rows)),
            tuple(slice(a, b) for a, b in pairwise(pairs)),
            STUCK,
            UNSURE,
        )

    def reset(self) -> None:
        """Forget the warm start."""
        self.native.reset()

    def turn(self, out: Sequence[bool]) -> None:
        """The next solves are without the rows of these elements: each such set goes on where its last solve ended."""
        self.native.turn(out)

    def exact_multipliers(self) -> Vec | None:
        """Multipliers of the latest answer, level by level as Solution.multipliers, live; None where not at hand."""
        found: Vec | None = self.native.exact_multipliers()
        return found

    def limit(self, seconds: float) -> None:
        """Time for the next solves [s], none for zero: a session passes the rest of its tick.

        Whoever sets one, infinity too, solves again and again: only answers that are not certified are doubted then.
        Raises DeclarationError for a negative or NaN time.
        """
        seconds = number("lexicographic", "time limit", seconds, 0.0, unit="s", infinite=True)
        self._limited, self._ticking = 0.0 < seconds < math.inf, seconds > 0.0
        self.native.limit(seconds if self._limited else 0.0)

    def solve(self, problem: Hierarchy) -> Solution:
        """The solution; raises ProblemError for a wrong shape, and marks numbers that are not usable.

        Raises RuntimeError while another thread solves in this workspace.
        """
        return self.judged(problem, *self.found(problem))

    def found(self, problem: Hierarchy) -> tuple[Solution, Any]:
        """The kernel's own solution, which ``judged`` may replace, and the problem as the kernel read it."""
        solution: Solution | None = self.native.solution(problem, 0.0, *self._views)
        return (solution, problem) if solution is not None else self._converted(problem)

    def kernel(self, problem: Hierarchy) -> Kernel | None:
        """The kernel bound to a problem that is refilled in place, see hqp.solvers.stages.Kernel.

        None where there is more to do than to solve.
        """
        if self._multipliers or not self.native.take(problem):
            check_shape(problem, self._shape)
            return None
        return self.native.solve, self.native.values(), self.native.active(), self.native.call()

    def parts(self, problem: Hierarchy) -> dict[str, Any]:
        """Data of a problem's kernel for a file (docs/plan_file.md)."""
        return {**levels(problem), **self._solver.options}

    def answer(self, problem: Hierarchy, counts: tuple[int, int, int, bool]) -> Solution:
        """The solution of the latest solve of ``kernel``."""
        return self.judged(problem, self.reported(counts), problem)

    def reported(self, counts: tuple[int, int, int, bool]) -> Solution:
        """The kernel's own solution of the latest solve of ``kernel``."""
        outcome, iterations, factorisations, _ = counts
        values, marks, n = self.native.values().copy(), self.native.active().copy(), self._shape.n
        ends = [sum(self._shape.rows[:k]) for k in range(len(self._shape.rows) + 1)]
        return Solution(
            values[:n],
            STATUSES[outcome],
            tuple(values[n + a : n + b] for a, b in pairwise(ends)),
            tuple(marks[a:b] for a, b in pairwise(ends)),
            Stats(iterations, factorisations),
            STUCK if STATUSES[outcome] is Status.NOT_CERTIFIED else "",
        )

    def is_doubtful(self, solution: Solution) -> bool:
        """Return true if the certificate is to judge the kernel's own solution: never where a time is set."""
        if self._limited:
            return False
        uncertain = solution.status is Status.RANK_UNCERTAIN or solution.detail == UNSURE
        stopped = solution.status is Status.ITERATION_LIMIT and not self._solver.max_iterations
        stuck = solution.status is Status.NOT_CERTIFIED and solution.detail == STUCK
        return stuck or stopped or (uncertain and not self._ticking)

    def judged(self, problem: Hierarchy, solution: Solution, bound: Any) -> Solution:
        """The solution, or another one where it is doubtful and the certificate refuses it.

        bound: the problem as the kernel read it.
        """
        if not self.is_doubtful(solution):
            return replace(solution, detail="") if solution.detail and solution.status is Status.OPTIMAL else solution
        others: list[Callable[[], Solution]] = [partial(self._again, bound)]
        others += [partial(self._with_rank, bound, rank) for rank in OTHER_RANKS]
        return second_opinion(problem, solution, others)

    def _again(self, bound: Any) -> Solution:
        self.native.reset(plain=True)
        return self._answer(bound)

    def _answer(self, bound: Any) -> Solution:
        solution: Solution = self.native.solution(bound, 0.0, *self._views)
        return solution

    def _with_rank(self, bound: Any, tolerance: float) -> Solution:
        other = NativeWorkspace(replace(self._solver, rank_tolerance=tolerance), self._shape)
        return other._answer(bound)

    def _converted(self, problem: Hierarchy) -> tuple[Solution, Any]:
        """As ``found`` where arrays have to be converted first, or numbers are not usable."""
        begin = perf_counter()
        check_shape(problem, self._shape)
        bound = _copied(problem)
        build = perf_counter() - begin
        solution = self.native.solution(bound, build, *self._views)
        if solution is None:
            solution = _refuse(problem, self._shape, Stats(build_s=build))
        return solution, bound


def levels(problem: Hierarchy) -> dict[str, Any]:
    """The arrays of a hierarchy by name."""
    return {
        "n": problem.n,
        "levels": [row_parts(rows) for rows in problem.levels],
        "constraints": problem.constraints,
        "metric": problem.metric,
        "origin": problem.origin,
    }


def _refuse(problem: Hierarchy, shape: Shape, stats: Stats) -> Solution:
    """Return the solution for unusable numbers: the culprit in the detail, never an exception."""
    flat = Flat(shape)
    for k, rows in enumerate(problem.levels):
        if isinstance(rows.A, Selection):
            index, scale = rows.A.index, rows.A.scale
            wrong = (index < 0) | (index >= problem.n) | ~np.isfinite(scale) | (scale == 0.0)
            if wrong.any():
                return flat.refuse(
                    problem,
                    stats,
                    f"level {k}: selection row {int(np.argmax(wrong))} needs a finite scale that is not zero",
                )
    return flat.refuse(problem, stats, flat.load(problem) or "numbers are too large: their squares overflow")


def _copied(problem: Hierarchy) -> SimpleNamespace:
    """The attributes of a hierarchy with arrays as the kernel reads them; Rows would refuse numbers of no use."""
    return SimpleNamespace(
        n=problem.n,
        levels=tuple(
            SimpleNamespace(A=_coefficients(rows.A), lower=readable(rows.lower), upper=readable(rows.upper))
            for rows in problem.levels
        ),
        constraints=problem.constraints,
        metric=None if problem.metric is None else readable(problem.metric),
        origin=None if problem.origin is None else readable(problem.origin),
    )


def _coefficients(A: Mat | Selection) -> Any:
    if isinstance(A, Selection):
        return SimpleNamespace(index=readable(A.index, np.int64), scale=readable(A.scale))
    return readable(A)
