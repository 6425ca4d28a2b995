"""QP back ends on problems with a known answer, raw beside refined."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.reports import solver_sets
from benchmarks.reports.checks import Check, at_most
from hqp.arrays import Vec
from hqp.problem import Hierarchy, Rows, Selection

Problem = tuple[Hierarchy, Vec]
"""A hierarchy of equalities and its answer, known from elsewhere."""


def bounded(problem: Hierarchy, answer: Vec) -> Hierarchy:
    """Add bounds at ten times the answer: solvers call a back end only for inequalities."""
    far = np.full(answer.size, 10.0 * (1.0 + float(np.abs(answer).max())))
    rows = Rows(Selection(np.arange(answer.size)), -far, far)
    return Hierarchy((rows, *problem.levels), constraints=1, metric=problem.metric, origin=problem.origin)


def answers(equation: str, what: str, label: str, tolerance: float, problems: Sequence[Problem]) -> Iterator[Check]:
    """A row for every solver that wraps a back end: its refined answer, and in the note the raw one.

    A row fails if the solver did not call its back end.
    """
    for name, solver in solver_sets.back_ends().items():
        metric = any(problem.metric is not None for problem, _ in problems)
        if name not in solver_sets.exact() or (metric and not solver.metric):
            continue
        bare = replace(solver, refine=False)  # type: ignore[type-var]
        off, raw, called, certified = [], [], 0, 0
        for problem, answer in problems:
            inside = bounded(problem, answer)
            refined, plain = solver.solve(inside), bare.solve(inside)
            size = float(np.abs(answer).max())
            off.append(float(np.abs(refined.x - answer).max()) / size)
            raw.append(float(np.abs(plain.x - answer).max()) / size)
            called += plain.stats.iterations > 0 or plain.stats.solve_s > 0.0  # some back ends report no iterations
            certified += plain.status.solved
        if called < len(problems):
            off.append(float("nan"))
        note = (
            f"back end called in {called} of {len(problems)}; its raw answer {max(raw):.1e} (median "
            f"{np.median(raw):.1e}), certified {certified}; refined by our recursion"
        )
        yield at_most(equation, f"{what}: {name}, relative", label, tolerance, off, note, kind="product")
