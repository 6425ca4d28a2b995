"""Sentis 2012, the fast subset: every row of the benchmark at few states, negative controls included."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from benchmarks.reports.checks import Check
from benchmarks.sentis2012.equations import constraints, equivalence, headline, posture, sessions, tasks
from benchmarks.sentis2012.equations.ground import Ground

PARTS: dict[str, Callable[[Ground, int], Iterator[Check]]] = {
    "constraints": constraints.checks,
    "tasks": tasks.checks,
    "posture": posture.checks,
    "equivalence": equivalence.checks,
    "sessions": sessions.checks,
    "headline": headline.checks,
}


@pytest.fixture(scope="module", params=[0.0, 7.0])
def ground(request: pytest.FixtureRequest) -> Ground:
    return Ground(request.param)


@pytest.mark.parametrize("part", PARTS)
def test_every_row_holds(ground: Ground, part: str) -> None:
    missed = [row for row in PARTS[part](ground, 6) if not row.passed]
    assert not missed, "\n".join(map(str, missed))


@pytest.mark.slow
def test_lyapunov_function_falls_as_predicted() -> None:
    missed = [row for row in posture.simulations(Ground(7.0), 0.3, signs=False) if not row.passed]
    assert not missed, "\n".join(map(str, missed))
