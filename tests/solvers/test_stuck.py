"""Vertices so degenerate that the active set once gave up: legs stretched, every joint at a limit, a hand far away.

tests/data/stuck.npz: two ticks of Talos in a loop of its own, five levels under joint limits.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp import Hierarchy, Rows, Status, certificate

DATA = Path(__file__).parents[1] / "data" / "stuck.npz"


def problem(i: int) -> Hierarchy:
    with np.load(DATA) as data:
        count = sum(1 for name in data.files if name.startswith(f"{i}_A"))
        levels = tuple(Rows(*(data[f"{i}_{part}{k}"] for part in "Alu")) for k in range(count))
        return Hierarchy(levels, constraints=int(data[f"{i}_constraints"]))


@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize("options", [{}, {"native": False}, {"multipliers": True}], ids=str)
def test_the_answer_is_judged_before_it_is_given_up(i: int, options: dict[str, bool]) -> None:
    workspace = hqp.solvers.load("lexicographic", **options).workspace(problem(i).shape)
    for _ in range(2):
        solution = workspace.solve(problem(i))
        assert solution.status in (Status.OPTIMAL, Status.RANK_UNCERTAIN), solution.detail
        assert certificate(problem(i), solution.x).ok
        assert np.all(problem(i).levels[0].slack(solution.x) == 0.0)
