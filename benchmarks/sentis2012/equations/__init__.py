"""Sentis, Petersen, Philippsen 2012: every equation on Dreamer, on the flat and on a slope of seven degrees."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from benchmarks.reports.checks import Check

SLOPES = (0.0, 7.0)
"""Inclinations of the ground [deg]."""

STATES, POSTURE_STATES, HQP_STATES = 200, 100, 60
"""Random states a slope for the identities, for the posture law and for the equivalences."""


def rows(progress: Callable[[str], None] | None = None, percent: int = 100, signs: bool = True) -> list[Check]:
    """All checks at ``percent`` of the states and of the simulated time; signs: also eq. (28) as printed."""
    from benchmarks.reports.checks import of_kind
    from benchmarks.sentis2012.equations import constraints, equivalence, headline, posture, sessions, tasks
    from benchmarks.sentis2012.equations.ground import Ground

    found: list[Check] = []
    for degrees in SLOPES:
        ground = Ground(degrees)
        parts = (
            ("eqs. (2) to (15), (21), (22)", constraints.checks, STATES, "product"),
            ("eqs. (16) to (27), (45) to (62)", tasks.checks, STATES, "identity"),
            ("eqs. (28) to (44)", posture.checks, POSTURE_STATES, "identity"),
            ("equivalences", equivalence.checks, HQP_STATES, "product"),
            ("the library's stack", sessions.checks, HQP_STATES, "product"),
            ("the experiments' controller", headline.checks, HQP_STATES, "product"),
        )
        for text, checks, count, kind in parts:
            if progress is not None:
                progress(f"Sentis 2012, {ground.label}: {text}")
            found += of_kind(checks(ground, max(count * percent // 100, 3)), kind)
        if degrees:
            if progress is not None:
                progress(f"Sentis 2012, {ground.label}: V along simulated motion")
            found += of_kind(posture.simulations(ground, duration(percent), signs), "identity")
    return found


def duration(percent: int) -> float:
    """Simulated time of the self motion [s]."""
    return max(0.3, 1.5 * min(percent, 100) / 100)


def figures(folder: Path, percent: int = 100) -> list[Path]:
    """Draw the Lyapunov function over time; return the written files."""
    from benchmarks.sentis2012.equations import posture
    from benchmarks.sentis2012.equations.ground import Ground

    path = folder / "sentis2012_lyapunov.png"
    posture.figure(Ground(SLOPES[-1]), path, duration(percent))
    return [path]
