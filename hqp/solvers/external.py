"""Solvers whose answer another package finds: made exact where that can be confirmed, marked where it cannot."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

from hqp.arrays import Vec
from hqp.problem import Hierarchy, Shape, Solution, Stats, Status
from hqp.problem.certify import certificate
from hqp.problem.completion import chosen
from hqp.solvers.base import Solver, Workspace, check_fields
from hqp.solvers.flat import Flat
from hqp.solvers.refine import Refiner
from hqp.tolerances import RANK_TOLERANCE


@dataclass(frozen=True)
class External(Solver):
    """Common base of solvers from other packages.

    tolerance: tolerance of the back end, absolute, on rows of length 1.  max_iterations: its own, a solve.
    rank_tolerance: see Nullspace.  refine: make the answer exact by its active set (at most ``exchanges`` changes of
    it), otherwise it is only judged.
    """

    accuracy: ClassVar[float] = 1e-8

    tolerance: float = 1e-9
    max_iterations: int = 2000
    rank_tolerance: float = RANK_TOLERANCE
    refine: bool = True
    exchanges: int = 100

    def __post_init__(self) -> None:
        check_fields(self, shares=("tolerance", "rank_tolerance"), counts=("max_iterations", "exchanges"))

    def workspace(self, shape: Shape) -> Workspace:
        """Allocate; raises UnsupportedProblem for levels with a price, DeclarationError for an unknown back end."""
        self.require(shape)
        return self.exact(shape)

    @abstractmethod
    def exact(self, shape: Shape) -> ExternalWorkspace:
        """The workspace itself."""


class ExternalWorkspace(ABC):
    """All rows of the hierarchy in one block; a subclass finds x, which is refined and judged here.

    trusted: distance to a bound below which x counts as active.
    """

    def __init__(self, solver: External, shape: Shape, trusted: float) -> None:
        self.flat = Flat(shape, complete=True)
        self.refiner = Refiner(self.flat, solver.rank_tolerance, solver.exchanges) if solver.refine else None
        self._trusted, self._accuracy = trusted, solver.accuracy

    def reset(self) -> None:  # noqa: B027
        """Forget the warm start; the default does nothing."""

    def solve(self, problem: Hierarchy) -> Solution:
        """The solution, exact where it could be confirmed; NOT_CERTIFIED, naming the level, where it could not."""
        began = perf_counter()
        unusable = self.flat.load(problem)
        if unusable:
            return self.flat.refuse(problem, Stats(build_s=perf_counter() - began), unusable)
        x, stats, complaint = self.find(began)
        return conclude(problem, self.flat, self.refiner, x, self._trusted, self._accuracy, stats, complaint)

    @abstractmethod
    def find(self, began: float) -> tuple[Vec, Stats, str]:
        """Return x for the rows of ``flat``, the effort since ``began``, and the complaint of the back end."""


def conclude(
    problem: Hierarchy,
    flat: Flat,
    refiner: Refiner | None,
    x: Vec,
    nearness: float,
    accuracy: float,
    stats: Stats,
    detail: str,
) -> Solution:
    """OPTIMAL where refining confirms the answer or else the certificate passes it at ``accuracy``.

    refiner: None leaves x as it is.  nearness: distance to a bound below which x counts as active.  detail: complaint
    of the back end, kept only if the solution cannot be certified.
    """
    uncertain = False
    if refiner is not None:
        refined = refiner.refine(x, nearness)
        if refined.confirmed:
            status = Status.RANK_UNCERTAIN if refined.uncertain else Status.OPTIMAL
            detail = "a pivot is near rank_tolerance" if refined.uncertain else ""
            return flat.finish(problem, chosen(problem, refined.x), status, stats, detail)
        uncertain = refined.uncertain
        if certificate(problem, better := chosen(problem, refined.x), accuracy).ok:
            x = better
    x = chosen(problem, x)
    verdict = certificate(problem, x, accuracy)
    if verdict.ok:
        return flat.finish(problem, x, Status.RANK_UNCERTAIN if uncertain else Status.OPTIMAL, stats)
    level = int((verdict.gaps > accuracy).argmax())
    where = f"level {level}" if level < len(problem.levels) else "the completion"
    text = f"{where} has a gap of {verdict.gaps[level]:.1e}"
    return flat.finish(problem, x, Status.NOT_CERTIFIED, stats, f"{text}; {detail}" if detail else text)
