"""Interface of every solver: a frozen value that allocates a workspace, and the finish all of them share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from threading import get_ident
from typing import ClassVar, Protocol, TypeAlias

import numpy as np

from hqp.arrays import Mat, Signs, Vec, row_lengths
from hqp.errors import ProblemError, UnsupportedProblem
from hqp.numbers import set_numbers
from hqp.problem import EQUALITY, Hierarchy, Rows, Shape, Solution, Stats, Status
from hqp.problem.completion import allowed
from hqp.tolerances import ACTIVITY_TOLERANCE, FEASIBILITY_TOLERANCE, VIOLATION_TOLERANCE

UNSURE = "a rank decision was uncertain"
"""Detail of an answer that is RANK_UNCERTAIN, where a violated constraint has its status."""


class Workspace(Protocol):
    """Everything that changes while solving, allocated once for one Shape; keeps the warm start."""

    def solve(self, problem: Hierarchy) -> Solution:
        """The solution of a problem of the workspace's shape."""
        ...

    def reset(self) -> None:
        """Forget the warm start."""
        ...


def turn(workspace: object, out: Sequence[bool]) -> None:
    """Continue without the rows of these elements, if the workspace caches the end of each such set."""
    if turned := getattr(workspace, "turn", None):
        turned(out)


class OneThread:
    """Lets one thread at a time into a workspace; another one is refused by RuntimeError.

    After an interrupt between ``enter`` and ``leave`` only other threads are locked out: this one may enter again.
    """

    __slots__ = ("_inside",)

    def __init__(self) -> None:
        self._inside = dict[str, int]()

    def enter(self) -> None:
        """Raise RuntimeError while another thread is inside."""
        me = get_ident()
        if self._inside.setdefault("thread", me) != me:  # atomic
            raise RuntimeError("another thread is solving with this workspace: use one workspace per thread")

    def leave(self) -> None:
        """Let others in."""
        self._inside.clear()


class Solver(ABC):
    """A way of solving hierarchies: options are fields of a frozen dataclass, capabilities class attributes.

    inequalities: takes them at all.  strict: a lower level never moves a higher residual.
    metric: honours Hierarchy.metric and origin.  priced: solves levels with a price.  accuracy: the certificate gap it
    guarantees if OPTIMAL.
    """

    name: ClassVar[str]
    inequalities: ClassVar[bool] = True
    strict: ClassVar[bool] = True
    metric: ClassVar[bool] = True
    priced: ClassVar[bool] = False
    accuracy: ClassVar[float] = 1e-6

    @abstractmethod
    def workspace(self, shape: Shape) -> Workspace:
        """Allocate for problems of this shape; raises UnsupportedProblem for a capability that is lacking."""

    def solve(self, problem: Hierarchy) -> Solution:
        """Solve once, cold, in a workspace of its own."""
        require_hierarchy(problem)
        return self.workspace(problem.shape).solve(problem)

    def require(self, shape: Shape) -> None:
        """Raise UnsupportedProblem unless the capabilities cover the shape, ProblemError for an argument that is not a
        Shape."""
        if not isinstance(shape, Shape):
            raise ProblemError(f"workspace() needs a Shape, given {type(shape).__name__}")
        if shape.inequalities and not self.inequalities and not getattr(self, "ignore_inequalities", False):
            message = f"{self.name} cannot solve inequalities; use an HQP solver such as 'lexicographic'"
            if hasattr(self, "ignore_inequalities"):
                message += ", or drop them with ignore_inequalities=True"
            raise UnsupportedProblem(message)
        if (shape.metric or shape.origin) and not self.metric:
            raise UnsupportedProblem(f"{self.name} supports neither metric nor origin; use 'lexicographic'")
        if any(shape.priced) and not self.priced:
            raise UnsupportedProblem(f"{self.name} cannot solve priced levels; use 'lexicographic', or price=0")


def check_fields(solver: Solver, shares: Sequence[str], counts: Sequence[str]) -> None:
    """Raise DeclarationError unless the named options of a solver lie in (0, 1), and from 1 up."""
    set_numbers(solver, solver.name, shares, 0.0, strict=True, below=1.0)
    set_numbers(solver, solver.name, counts, 1)


def require_hierarchy(problem: object) -> None:
    """Raise ProblemError for an argument that is not a Hierarchy."""
    if not isinstance(problem, Hierarchy):
        raise ProblemError(f"a problem must be a Hierarchy, given {type(problem).__name__}")


def check_shape(problem: Hierarchy, shape: Shape) -> None:
    """Raise ProblemError unless the problem has the n, rows, metric and prices that the workspace was made for."""
    require_hierarchy(problem)
    rows = tuple(level.m for level in problem.levels)
    if problem.n != shape.n or rows != shape.rows:
        raise ProblemError(
            f"this workspace solves n = {shape.n}, rows {shape.rows}; given n = {problem.n}, rows {rows}"
        )
    if (problem.metric is not None) != shape.metric:
        given = "none" if problem.metric is None else "one"
        raise ProblemError(
            f"this workspace solves problems {'with' if shape.metric else 'without'} a metric; given {given}"
        )
    problem.check_prices(shape.priced)


Described: TypeAlias = tuple[tuple[Vec, ...], tuple[Signs, ...], bool]
"""Slacks and marks of every level, and whether a constraint is violated."""


def describe(problem: Hierarchy, x: Vec) -> Described:
    """Compute the fields of a Solution from x."""
    residuals = problem.slacks(x)
    return residuals, tuple(activity(rows, x) for rows in problem.levels), violated(problem, residuals, x)


def finish(
    problem: Hierarchy,
    x: Vec,
    status: Status,
    stats: Stats,
    detail: str = "",
    stages: Mat | None = None,
    describe: Callable[[Hierarchy, Vec], Described] = describe,
) -> Solution:
    """A Solution whose residuals, active sets and violation of constraints are computed from (problem, x).

    An x that is not finite becomes x = 0, NOT_CERTIFIED.
    """
    if not np.isfinite(x).all():
        x, status, detail = np.zeros(problem.n), Status.worst(status, Status.NOT_CERTIFIED), "x is not finite"
    residuals, active, broken = describe(problem, x)
    if status.solved and broken:
        detail = detail or (UNSURE if status is Status.RANK_UNCERTAIN else "")
        status = Status.worst(status, Status.CONSTRAINTS_VIOLATED)
    return Solution(x, status, residuals, active, stats, detail, stage_points=stages)


def activity(rows: Rows, x: Vec, tolerance: float = ACTIVITY_TOLERANCE) -> Signs:
    """Return the active side of each row, with the signs of Solution.active."""
    value = rows.A @ x
    with np.errstate(invalid="ignore"):
        at_lower = value <= rows.lower + tolerance * (1.0 + np.abs(rows.lower))
        at_upper = value >= rows.upper - tolerance * (1.0 + np.abs(rows.upper))
    marks = at_upper.astype(np.int8) - (at_lower & ~at_upper).astype(np.int8)
    marks[rows.lower == rows.upper] = EQUALITY
    return marks


def violated(problem: Hierarchy, residuals: tuple[Vec, ...], x: Vec) -> bool:
    """Return true if a row of the leading constraint levels is violated at x (VIOLATION_TOLERANCE), and by more than
    the completion may exceed it."""
    off = [np.zeros(0)]
    for rows, w in zip(problem.levels[: problem.constraints], residuals, strict=False):
        bound = np.where(w > 0.0, rows.upper, np.where(w < 0.0, rows.lower, 0.0))
        slop = VIOLATION_TOLERANCE * (1.0 + np.abs(bound))
        if np.any(np.abs(w) > slop):  # lengths are seldom needed
            slop += FEASIBILITY_TOLERANCE * float(np.linalg.norm(x)) * row_lengths(rows.dense(x.size))
        off.append(np.abs(w) - slop)
    return exceeded(problem, np.concatenate(off), x)


def exceeded(problem: Hierarchy, off: Vec, x: Vec) -> bool:
    """Return true if a row of the constraints is off by more than the completion may exceed it at x."""
    return bool(np.any(off > 0.0)) and bool(np.any(off > allowed(problem, x)))
