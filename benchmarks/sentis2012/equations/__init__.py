"""Sentis, Petersen, Philippsen 2012: every equation on Dreamer, on the flat and on a slope of seven degrees."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from benchmarks.reports.checks import Check

SLOPES = (0.0, 7.0)
"""Inclinations of the ground [deg]."""

STATES, POSTURE_STATES, HQP_STATES = 200, 100, 60
"""Random states a slope for the identities, for the posture law and for the equivalences."""


def rows(progress: Callable[[str], None] | None = None, quick: bool = False) -> list[Check]:
    """All checks; quick takes a twentieth of the states and a shorter simulation."""
    from benchmarks.sentis2012.equations import constraints, equivalence, posture, sessions, tasks
    from benchmarks.sentis2012.equations.ground import Ground

    share = 20 if quick else 1
    found: list[Check] = []
    for degrees in SLOPES:
        ground = Ground(degrees)
        parts = (
            ("eqs. (2) to (15), (21), (22)", constraints.checks, STATES),
            ("eqs. (16) to (27), (45) to (62)", tasks.checks, STATES),
            ("eqs. (28) to (44)", posture.checks, POSTURE_STATES),
            ("equivalences", equivalence.checks, HQP_STATES),
            ("the library's stack", sessions.checks, HQP_STATES),
        )
        for text, checks, count in parts:
            if progress is not None:
                progress(f"Sentis 2012, {ground.label}: {text}")
            found += checks(ground, max(count // share, 3))
        if degrees:
            if progress is not None:
                progress(f"Sentis 2012, {ground.label}: V along simulated motion")
            found += posture.simulations(ground, quick)
    return found


def figures(folder: Path, quick: bool = False) -> list[Path]:
    """Write the Lyapunov function over time; returns what was written."""
    from benchmarks.sentis2012.equations import posture
    from benchmarks.sentis2012.equations.ground import Ground

    path = folder / "sentis2012_lyapunov.png"
    posture.figure(Ground(SLOPES[-1]), path, quick)
    return [path]
