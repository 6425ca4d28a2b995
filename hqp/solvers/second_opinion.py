"""Certify a doubtful solution: the first that the certificate passes, of it, of others, and of the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

from hqp.problem import Hierarchy, Solution, Status
from hqp.problem.certify import certificate
from hqp.solvers.base import UNSURE, finish
from hqp.tolerances import ACCURATE

LAST_OPINION = 4e9
"""Budget of the reference solver in multiplications, in factorisations of (n + rows + OVERHEAD)^3 each.

A count and no time, so that status and x are the same on every machine; about a second.
"""

OVERHEAD = 100
"""Rows that cost as much as a call."""

ALLOWED = 1e-6
"""Gap that the certificate allows an answer of uncertain rank, ACCURATE an optimum: rounding over a value of 1e-9."""

STUCK = "no solution found passed the certificate: the problem is too ill-conditioned to certify"


def second_opinion(problem: Hierarchy, doubtful: Solution, others: Iterable[Callable[[], Solution]] = ()) -> Solution:
    """The first that the certificate passes, of the answer given, the others and the reference's, or NOT_CERTIFIED."""
    from hqp.solvers.reference import Reference  # rarely needed

    last = Reference(factorisations=effort(problem))
    answers: list[Callable[[], Solution]] = [lambda: doubtful, *others, lambda: last.solve(problem)]
    for answer in answers:
        found = answer()
        passes = partial(certificate, problem, found.x, stages=found.stage_points, settled=True)
        if (sure := passes(tolerance=ACCURATE).ok) or passes(tolerance=ALLOWED).ok:
            decided = found.status is Status.OPTIMAL or (
                found.status is Status.CONSTRAINTS_VIOLATED and not found.detail
            )
            if found is doubtful and sure and decided:  # the data's last digits do not move it
                return replace(found, detail="")
            status = finish(problem, found.x, Status.RANK_UNCERTAIN, found.stats).status
            return replace(found, status=status, detail="" if status is Status.RANK_UNCERTAIN else UNSURE)
    return replace(doubtful, status=Status.NOT_CERTIFIED, detail=STUCK)


def effort(problem: Hierarchy) -> int:
    """Factorisations that the reference may take for a second opinion."""
    size = problem.n + sum(rows.m for rows in problem.levels)
    return max(1, int(LAST_OPINION // (size + OVERHEAD) ** 3))
