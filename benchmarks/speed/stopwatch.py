"""Times of solves and of their unit, measured in turns so that both share the machine's state."""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from time import perf_counter

import numpy as np
from scipy.linalg import lapack

from hqp import Hierarchy, Selection, Solution
from hqp.arrays import Mat, Vec
from hqp.solvers import Solver
from tests.scenes import problems


@dataclass(frozen=True, eq=False)
class Lap:
    """Solves of one problem: times ``(repeat,)`` [us], the last solution, and the unit's best time [us]."""

    times: Vec
    floor: float
    solution: Solution

    @property
    def best(self) -> float:
        """The fastest [us]."""
        return float(self.times.min())


@cache
def stacks(name: str) -> tuple[Mat, ...]:
    """Equality stacks of a set, all levels in one matrix in LAPACK's order."""
    return tuple(np.asfortranarray(np.vstack([r.dense(p.n) for r in p.levels])) for p in problems.load(name))


def factorisation(A: Mat, repeat: int) -> float:
    """The fastest dgeqp3 of A [us]."""
    return min(_factorise(A) for _ in range(repeat))


def solve(solver: Solver, problem: Hierarchy, A: Mat, repeat: int, warm: bool) -> Lap:
    """Solve in one workspace, reset before each solve unless warm, with a dgeqp3 of A in between."""
    workspace = solver.workspace(problem.shape)
    solution = workspace.solve(problem)
    times, floors = np.zeros(repeat), np.zeros(repeat)
    collecting = gc.isenabled()
    gc.disable()
    try:
        for i in range(repeat):
            if not warm:
                workspace.reset()
            begin = perf_counter()
            solution = workspace.solve(problem)
            times[i] = perf_counter() - begin
            floors[i] = _unit(A)
    finally:
        if collecting:
            gc.enable()
    return Lap(1e6 * times, float(floors.min()), solution)


def sequence(solver: Solver, sequence: Sequence[Hierarchy], A: Mat, repeat: int) -> list[Lap]:
    """Solve the problems in order, each refilled in place and warm from the previous one, ``repeat`` times."""
    live = sequence[0].copy()
    workspace = solver.workspace(live.shape)
    times, floors = np.zeros((repeat, len(sequence))), np.zeros((repeat, len(sequence)))
    solutions: list[Solution] = []
    for i in range(repeat):
        workspace.reset()
        solutions = []
        for j, problem in enumerate(sequence):
            _refill(live, problem)
            begin = perf_counter()
            solutions.append(workspace.solve(live))
            times[i, j] = perf_counter() - begin
            floors[i, j] = _unit(A)
    return [Lap(1e6 * times[:, j], float(floors[:, j].min()), solution) for j, solution in enumerate(solutions)]


def _refill(live: Hierarchy, problem: Hierarchy) -> None:
    """Copy a problem's numbers into the arrays of another of its shape, as a session does each tick."""
    for into, rows in zip(live.levels, problem.levels, strict=True):
        if isinstance(into.A, Selection) and isinstance(rows.A, Selection):
            into.A.index[:], into.A.scale[:] = rows.A.index, rows.A.scale
        else:
            np.copyto(into.A, rows.A)
        np.copyto(into.lower, rows.lower)
        np.copyto(into.upper, rows.upper)


def _unit(A: Mat) -> float:
    """Time the second of two factorisations: after a long solve the first one finds cold caches."""
    _factorise(A)
    return _factorise(A)


def _factorise(A: Mat) -> float:
    begin = perf_counter()
    lapack.dgeqp3(A)
    return 1e6 * (perf_counter() - begin)
