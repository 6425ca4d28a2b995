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
    from benchmarks.reports.checks import of_kind
    from benchmarks.sentis2012.equations import constraints, equivalence, headline, posture, sessions, tasks
    from benchmarks.sentis2012.equations.ground import Ground

    share = 20 if quick else 1
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
            found += of_kind(checks(ground, max(count // share, 3)), kind)
        if degrees:
            if progress is not None:
                progress(f"Sentis 2012, {ground.label}: V along simulated motion")
            found += of_kind(posture.simulations(ground, quick), "identity")
    return found


def figures(folder: Path, quick: bool = False) -> list[Path]:
    """Write the Lyapunov function over time; returns what was written."""
    from benchmarks.sentis2012.equations import posture
    from benchmarks.sentis2012.equations.ground import Ground

    path = folder / "sentis2012_lyapunov.png"
    posture.figure(Ground(SLOPES[-1]), path, quick)
    return [path]
