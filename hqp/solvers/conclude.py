"""How a back end's answer becomes a Solution: made exact where that can be confirmed, marked where it cannot."""

from __future__ import annotations

from hqp.arrays import Vec
from hqp.certify import certificate
from hqp.problem import Hierarchy, Solution, Stats, Status
from hqp.solvers.flat import Flat
from hqp.solvers.refine import Refiner


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

    refiner: None leaves x as it is.  nearness: how close to a bound x is trusted to be active.  detail: what the
    back end complained of, kept only if the answer cannot be certified.
    """
    uncertain = False
    if refiner is not None:
        refined = refiner.refine(x, nearness)
        if refined.confirmed:
            status = Status.RANK_UNCERTAIN if refined.uncertain else Status.OPTIMAL
            detail = "a pivot lay near rank_tolerance" if refined.uncertain else ""
            return flat.finish(problem, refined.x, status, stats, detail)
        uncertain = refined.uncertain
        if certificate(problem, refined.x, accuracy).ok:
            x = refined.x
    verdict = certificate(problem, x, accuracy)
    if verdict.ok:
        return flat.finish(problem, x, Status.RANK_UNCERTAIN if uncertain else Status.OPTIMAL, stats)
    level = int((verdict.gaps > accuracy).argmax())
    where = f"level {level}" if level < len(problem.levels) else "the completion"
    text = f"{where} has a gap of {verdict.gaps[level]:.1e}"
    return flat.finish(problem, x, Status.NOT_CERTIFIED, stats, f"{text}; {detail}" if detail else text)
