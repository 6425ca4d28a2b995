"""Neighbouring problems: rate of jumps between their answers, exact levels next to priced ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import hqp
from hqp import markdown
from hqp.solvers.base import Solver
from tests.scenes.calm.families import FAMILIES, MOVED, levels, neighbour, problem

__all__ = ["FAMILIES", "Continuity", "levels", "measure", "neighbour", "pairs", "problem", "table"]

JUMP = 0.01
"""Threshold of a jump on the change of the answer."""

STEEPEST = 1000.0
"""Limit on the 99th percentile of dx / ddata."""


@dataclass(frozen=True)
class Continuity:
    """Share of jumps and 99th percentile of dx / ddata, exact and priced; failed: number of unsolved problems."""

    family: str
    count: int
    jumps: tuple[float, float]
    slope: tuple[float, float]
    failed: int

    @property
    def misses(self) -> tuple[str, ...]:
        """Missed goals of priced answers."""
        found = [f"{100.0 * self.jumps[1]:.2g} % of neighbours jump"] if self.jumps[1] > 0.0 else []
        found += [f"slope {self.slope[1]:.2g}"] if self.slope[1] > STEEPEST else []
        found += [f"{self.failed} answers are not solved"] if self.failed else []
        return tuple(f"{self.family}: {text}" for text in found)


def pairs(family: str, seeds: Sequence[int]) -> Iterator[tuple[hqp.Hierarchy, hqp.Hierarchy]]:
    """A problem and its neighbour for each seed."""
    for seed in seeds:
        rng = np.random.default_rng([seed, list(FAMILIES).index(family)])
        one = problem(rng, family)
        yield one, neighbour(one, rng)


def measure(family: str, count: int, solver: Solver | None = None) -> Continuity:
    """Exact and priced answers of ``count`` pairs of neighbours; default solver ``lexicographic``."""
    plain = hqp.solvers.load("lexicographic")
    solver = solver or plain
    exact, priced, failed = list[float](), list[float](), 0
    for one, two in pairs(family, range(count)):
        exact.append(float(np.linalg.norm(plain.solve(one.exact()).x - plain.solve(two.exact()).x)))
        answers = solver.solve(one), solver.solve(two)
        failed += sum(not answer.status.solved for answer in answers)
        priced.append(float(np.linalg.norm(answers[0].x - answers[1].x)))
    jumps = [float((np.array(moved) > JUMP).mean()) for moved in (exact, priced)]
    slope = [float(np.percentile(moved, 99.0)) / MOVED for moved in (exact, priced)]
    return Continuity(family, count, (jumps[0], jumps[1]), (slope[0], slope[1]), failed)


def table(found: Iterable[Continuity]) -> str:
    """A row for each family; figures that miss their goal are bold."""
    header = ("family", "pairs", "exact: jumps", "p99 of dx/ddata", "priced: jumps", "p99 of dx/ddata", "not solved")
    rows = []
    for one in found:
        share, slope = f"{100.0 * one.jumps[1]:.2g} %", f"{one.slope[1]:.2g}"
        rows.append((
            f"{one.family}: {FAMILIES[one.family]}", f"{one.count}", f"{100.0 * one.jumps[0]:.2g} %",
            f"{one.slope[0]:.2g}", f"**{share}**" if one.jumps[1] > 0.0 else share,
            f"**{slope}**" if one.slope[1] > STEEPEST else slope, f"{one.failed}",
        ))  # fmt: skip
    return markdown.table(header, rows) + "\n"
