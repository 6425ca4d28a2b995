"""What becomes of a doubtful answer: the first that the certificate passes, of it, of others, and of the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from hqp.certify import certificate
from hqp.problem import Hierarchy, Solution, Status
from hqp.solvers.base import UNSURE, finish

LAST_OPINION = 0.25
"""Time for the reference where nothing that the kernel found passed the certificate [s]."""

TOLERANCES = (1e-8, 1e-6)
"""Gaps that the certificate allows; the second is rounding over a singular value of 1e-9."""

STUCK = "no answer that was found passed the certificate: the problem is too ill-conditioned to be judged"


def second_opinion(problem: Hierarchy, doubtful: Solution, others: Iterable[Callable[[], Solution]] = ()) -> Solution:
    """The first that the certificate passes, of the answer given, the others and the reference's, or NOT_CERTIFIED."""
    answers: list[Callable[[], Solution]] = [lambda: doubtful, *others, lambda: _by_reference(problem)]
    for answer in answers:
        found = answer()
        if any(certificate(problem, found.x, tolerance, found.stage_points).ok for tolerance in TOLERANCES):
            if found is doubtful and found.status is Status.OPTIMAL:  # the data's last digits do not move it
                return replace(found, detail="")
            status = finish(problem, found.x, Status.RANK_UNCERTAIN, found.stats).status
            return replace(found, status=status, detail="" if status is Status.RANK_UNCERTAIN else UNSURE)
    return replace(doubtful, status=Status.NOT_CERTIFIED, detail=STUCK)


def _by_reference(problem: Hierarchy) -> Solution:
    from hqp.solvers.reference import Reference  # it is seldom asked

    return Reference(seconds=LAST_OPINION).solve(problem)
