"""Tasks, limits and constraints on the displacement dq of one step, as pink and mink write them, as a hierarchy.

Constant parts are kept between steps: the arrays of limits with one entry per row, of the hierarchy, and the solver's
workspace; a step only writes numbers.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.errors import DeclarationError, NotSolved
from hqp.problem import Hierarchy, Rows, Selection, Solution
from hqp.solvers import load
from hqp.solvers.base import Solver, Workspace

Part = tuple[Mat, Vec, "Vec | None"]
"""Rows of one task: J, -gain W e, and W where it is not 1."""


@dataclass
class _Kept(threading.local):
    """Cache of each thread: problems by their shape, limits by their place."""

    problems: dict[Any, tuple[Hierarchy, Workspace]] = field(default_factory=dict)
    limits: dict[Any, Singles] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Singles:
    """Rows of G dq <= h with one entry each: rows that bound coordinates from above and below, and their divisors.

    single: flags of all rows.  general: the other rows.
    """

    G: Mat
    general: Index
    up: tuple[Index, Index, Vec]
    down: tuple[Index, Index, Vec]
    touched: Index

    @staticmethod
    def of(G: Mat) -> Singles:
        single = np.count_nonzero(G, axis=1) == 1
        rows = np.flatnonzero(single)
        column = np.abs(G[rows]).argmax(axis=1)
        factor = G[rows, column]
        sides = []
        for chosen in (factor > 0.0, factor < 0.0):
            sides.append((rows[chosen], column[chosen], factor[chosen]))
        touched = np.unique(column)
        return Singles(G.copy(), np.flatnonzero(~single), sides[0], sides[1], touched)

    def bound(self, h: Vec, lower: Vec, upper: Vec) -> None:
        """Narrow the bounds ``(nv,)``."""
        rows, columns, factor = self.up
        np.minimum.at(upper, columns, h[rows] / factor)
        rows, columns, factor = self.down
        np.maximum.at(lower, columns, h[rows] / factor)


_kept = _Kept()


def solve(
    nv: int,
    levels: Sequence[Sequence[Part]],
    inequalities: Sequence[tuple[Mat, Vec]],
    equalities: Sequence[tuple[Mat, Vec]],
    solver: str | Solver,
) -> Solution:
    """The displacement ``(nv,)``: G dq <= h, then A dq = b, then each level in turn.

    The solver starts from its answer to the last problem of the same shape.
    """
    singles = [_singles(i, G) for i, (G, _) in enumerate(inequalities)]
    lower, upper = np.full(nv, -np.inf), np.full(nv, np.inf)
    for found, (_, h) in zip(singles, inequalities, strict=True):
        found.bound(h, lower, upper)
    outside = bool((lower > upper).any())  # by more than it can come back in a step: the least violation
    touched = _union(singles) if not outside else np.zeros(0, dtype=np.intp)
    general = [np.arange(len(s.G)) if outside else s.general for s in singles]
    rows = sum(map(len, general))
    fixed = sum(len(b) for _, b in equalities)
    counts = tuple(sum(len(b) for _, b, _ in parts) for parts in levels)
    key = (solver, nv, touched.tobytes(), rows, fixed, counts)
    if key not in _kept.problems:
        _kept.problems[key] = _make(nv, touched, rows, fixed, counts, solver)
    problem, workspace = _kept.problems[key]
    live = iter(problem.levels)
    if touched.size:
        box = next(live)
        box.lower[:], box.upper[:] = lower[touched], upper[touched]
    if rows:
        into = next(live)
        at = 0
        for chosen, (G, h) in zip(general, inequalities, strict=True):
            if chosen.size:
                into.A[at : at + chosen.size], into.upper[at : at + chosen.size] = G[chosen], h[chosen]  # type: ignore[index]
                at += chosen.size
    if fixed:
        _fill(next(live), [(A, b, None) for A, b in equalities])
    for parts in levels:
        _fill(next(live), parts)
    return workspace.solve(problem)


def _make(
    nv: int, touched: Index, rows: int, fixed: int, counts: tuple[int, ...], solver: str | Solver
) -> tuple[Hierarchy, Workspace]:
    """Arrays of a shape, to be filled at each step."""
    strict = [Rows(Selection(touched), np.zeros(touched.size), np.zeros(touched.size))] if touched.size else []
    if rows:
        strict.append(Rows(np.zeros((rows, nv)), np.full(rows, -np.inf), np.zeros(rows)))
    equal = [Rows(np.zeros((m, nv)), np.zeros(m), np.zeros(m)) for m in ((fixed,) if fixed else ()) + counts]
    problem = Hierarchy((*strict, *equal), constraints=len(strict) + (fixed > 0), n=nv)
    return problem, (load(solver) if isinstance(solver, str) else solver).workspace(problem.shape)


def _fill(into: Rows, parts: Sequence[Part]) -> None:
    A: Any = into.A
    at = 0
    for J, b, weight in parts:
        end = at + len(b)
        if weight is None:
            A[at:end] = J
        else:
            np.multiply(J, weight[:, None], out=A[at:end])
        into.lower[at:end] = b
        at = end
    into.upper[:] = into.lower


def _singles(place: int, G: Mat) -> Singles:
    """The structure of a limit's rows, which is the same at every step of nearly all limits."""
    key = place, G.shape
    found = _kept.limits.get(key)
    if found is None or not np.array_equal(found.G, G):
        found = _kept.limits[key] = Singles.of(G)
    return found


def _union(singles: Sequence[Singles]) -> Index:
    touched = [s.touched for s in singles if s.touched.size]
    if not touched:
        return np.zeros(0, dtype=np.intp)
    first = touched[0]
    if all(t is first or np.array_equal(t, first) for t in touched[1:]):
        return first
    return np.unique(np.concatenate(touched))


def task_rows(task: Any, configuration: Any) -> Part:
    """(J, -gain W e, W) of a task with cost W, None where that is 1; rows of cost zero are left out."""
    J, e = task.compute_jacobian(configuration), task.compute_error(configuration)
    cost = getattr(task, "cost", None)
    if cost is None or isinstance(cost, (int, float)):
        w = 1.0 if cost is None else float(cost)
        if w == 1.0:
            return J, -task.gain * e, None
        return (J, (-task.gain * w) * e, np.full(len(e), w)) if w else (J[:0], e[:0], None)
    W = np.asarray(cost, dtype=np.float64) if np.ndim(cost) == 1 and len(cost) == len(e) else cost_of(task, len(e))
    least, most = W.min(), W.max()
    if least == most == 1.0:
        return J, -task.gain * e, None
    if least > 0.0:
        return J, -task.gain * W * e, W
    kept = W > 0.0
    W = W[kept]
    return J[kept], -task.gain * W * e[kept], None if W.size and W.min() == W.max() == 1.0 else W


def cost_of(task: Any, rows: int) -> Vec:
    """A task's cost ``(rows,)``, 1 where it has none."""
    cost = getattr(task, "cost", None)
    found = np.empty(rows)
    found[:] = 1.0 if cost is None else cost
    return found


def make_levels(tasks: Iterable[Any], configuration: Any) -> list[list[Part]]:
    """One level of a flat sequence of tasks, as many as there are of a sequence of sequences."""
    given = list(tasks)
    nested = [isinstance(item, (list, tuple)) for item in given]
    if any(nested) and not all(nested):
        raise DeclarationError("solve_ik", "tasks and levels mixed", allowed="tasks, or sequences of tasks")
    levels = []
    for members in given if all(nested) and given else [given]:
        parts = [part for task in members if len((part := task_rows(task, configuration))[1])]
        if parts:
            levels.append(parts)
    return levels


def velocity(
    configuration: Any,
    tasks: Iterable[Any],
    inequalities: Sequence[tuple[Mat, Vec]],
    constraints: Iterable[Any] | None,
    dt: float,
    solver: str | Solver,
) -> Vec:
    """dq / dt ``(nv,)`` of their tasks, of limits G dq <= h and of hard tasks; raises NotSolved without an answer."""
    equalities = [
        (c.compute_jacobian(configuration), -c.gain * c.compute_error(configuration)) for c in constraints or ()
    ]
    solution = solve(int(configuration.model.nv), make_levels(tasks, configuration), inequalities, equalities, solver)
    if not solution.status.usable:
        raise NotSolved(f"{solution.status.name}: {solution.status.value}", None)
    return np.asarray(solution.x / dt)
