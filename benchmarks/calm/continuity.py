"""Neighbouring problems: how often their answers are far apart, exact levels beside priced ones.

The families were made for the study that led to priced levels: a box, two or three levels of a few rows, a posture on
every variable, with the faults that a family is named after.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

import hqp
from benchmarks.reports import report
from hqp import Hierarchy, Rows, Selection
from hqp.arrays import Mat

FAMILIES = {
    "plain": (0.0, 0.0), "small": (0.15, 0.44), "parallel": (0.007, 0.007), "contradictory": (0.0, 0.0),
    "beyond": (0.0, 0.0), "mixed": (0.055, 0.17),
}  # fmt: skip
"""Share of priced answers that jumped in that study, eta = 1e-3: without the guard, and with it, as it is here."""

TAU = 0.1
"""c_k over the longest column of its level."""

MOVED = 1e-6
"""Standard deviation by which all data of priced levels are moved."""

JUMP = 0.01
"""A change of the answer above this is a jump."""


def levels(rng: Generator, family: str, inequalities: bool = True) -> list[Rows]:
    """Random levels of a family: a box, two or three levels of a few rows, a posture on every variable.

    inequalities: with the box, and now and then a bound in place of a target.
    """
    n = int(rng.integers(4, 9))
    found: list[Rows] = []
    if inequalities:
        box = rng.uniform(0.5, 3.0, n)
        found.append(Rows(Selection(np.arange(n)), -box, box))
    above: Mat | None = None
    for _ in range(int(rng.integers(2, 4))):
        m = int(rng.integers(1, 4))
        A = 0.5 * rng.standard_normal((m, n))
        if family == "small" or (family == "mixed" and rng.random() < 0.5):
            U, sigma, Vt = np.linalg.svd(A, full_matrices=False)
            sigma[-1] = 10.0 ** rng.uniform(-6.0, -2.0)
            A = U * sigma @ Vt
        if above is not None and (family == "parallel" or (family == "mixed" and rng.random() < 0.4)):
            A[0] = above[0] + 10.0 ** rng.uniform(-6.0, -2.0) * rng.standard_normal(n)
        if above is not None and family == "contradictory":
            A[0] = above[0]
        lower = rng.standard_normal(m) * (4.0 if family == "beyond" else 0.5)
        upper = lower.copy()
        if inequalities and rng.random() < 0.3:
            upper[-1] = np.inf if rng.random() < 0.5 else lower[-1] + 0.3
        found.append(Rows(A, lower, upper))
        above = A
    posture = rng.uniform(-1.0, 1.0, n)
    return [*found, Rows(np.eye(n), posture, posture.copy())]


def problem(rng: Generator, family: str) -> Hierarchy:
    """A random hierarchy of a family, its levels but the box and the posture with a price."""
    box, *tasks, posture = levels(rng, family)
    longest = [float(np.sqrt(np.square(rows.A).sum(axis=0)).max()) for rows in tasks]
    return Hierarchy((box, *tasks, posture), constraints=1, prices=np.array([0.0, *(TAU * c for c in longest), 0.0]))


def neighbour(problem: Hierarchy, rng: Generator) -> Hierarchy:
    """The same with all data of priced levels moved a little."""
    moved = []
    for rows, priced in zip(problem.levels, problem.priced, strict=True):
        if priced:
            shift = MOVED * rng.standard_normal(rows.m)
            A = rows.dense(problem.n) + MOVED * rng.standard_normal((rows.m, problem.n))
            rows = Rows(A, rows.lower + shift, rows.upper + shift)
        moved.append(rows)
    return replace(problem, levels=tuple(moved))


@dataclass(frozen=True)
class Continuity:
    """Of one family: shares of problems whose answer jumps, and the 99th percentile of |dx| / |ddata|."""

    family: str
    count: int
    jumps: tuple[float, float]
    slope: tuple[float, float]

    @property
    def kept(self) -> bool:
        """Whether priced answers jump no more often than in the study, within three standard deviations."""
        share = FAMILIES[self.family][1]
        return self.jumps[1] <= share + 3.0 * np.sqrt((share + 1e-3) / self.count)


def measure(family: str, count: int, seed: int = 0) -> Continuity:
    """Exact and priced answers of ``count`` pairs of neighbours."""
    solver = hqp.solvers.load("lexicographic")
    moved: tuple[list[float], list[float]] = ([], [])
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        one = problem(rng, family)
        two = neighbour(one, rng)
        for found, a, b in ((moved[0], one.exact(), two.exact()), (moved[1], one, two)):
            found.append(float(np.linalg.norm(solver.solve(a).x - solver.solve(b).x)))
    exact, priced = map(np.array, moved)
    jumps = float((exact > JUMP).mean()), float((priced > JUMP).mean())
    slope = float(np.percentile(exact, 99.0) / MOVED), float(np.percentile(priced, 99.0) / MOVED)
    return Continuity(family, count, jumps, slope)


def table(found: Iterable[Continuity]) -> str:
    """A row for each family; a share above that of the study is bold."""
    header = (
        "family", "pairs", "exact: jumps", "p99 of dx/ddata", "priced: jumps", "p99 of dx/ddata",
        "in the study: no guard, guard",
    )  # fmt: skip
    rows = []
    for one in found:
        share = f"{100.0 * one.jumps[1]:.1f} %"
        known = " / ".join(f"{100.0 * each:.1f} %" for each in FAMILIES[one.family])
        rows.append((
            one.family, f"{one.count}", f"{100.0 * one.jumps[0]:.1f} %", f"{one.slope[0]:.2g}",
            share if one.kept else f"**{share}**", f"{one.slope[1]:.2g}", known,
        ))  # fmt: skip
    return report.table(header, rows)
