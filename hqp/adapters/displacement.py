"""Tasks, limits and constraints on the displacement dq of one step, as pink and mink write them, as a hierarchy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.problem import Hierarchy, Rows, Selection, Solution
from hqp.solvers import load
from hqp.solvers.base import Solver, Workspace

_workspaces: dict[tuple[Any, Any], Workspace] = {}


def solve(
    nv: int,
    levels: Sequence[Rows],
    inequalities: Sequence[tuple[Mat, Vec]],
    equalities: Sequence[tuple[Mat, Vec]],
    solver: str | Solver,
) -> Solution:
    """The displacement ``(nv,)``: G dq <= h, then A dq = b, then each level in turn.

    The solver starts from its answer to the last problem of the same shape.
    """
    strict: list[Rows] = []
    if inequalities:
        G, h = (np.concatenate(part) for part in zip(*inequalities, strict=True))
        strict += _bounded(G, h)
    if equalities:
        A, b = (np.concatenate(part) for part in zip(*equalities, strict=True))
        strict.append(Rows(A, b, b))
    problem = Hierarchy((*strict, *levels), constraints=len(strict), n=nv)
    key = (solver, problem.shape)
    if key not in _workspaces:
        _workspaces[key] = (load(solver) if isinstance(solver, str) else solver).workspace(problem.shape)
    return _workspaces[key].solve(problem)


def _bounded(G: Mat, h: Vec) -> list[Rows]:
    """G dq <= h, as a box where rows have one entry each: several times faster than as general rows."""
    single = np.count_nonzero(G, axis=1) == 1
    general = ~single
    rows = [Rows(G[general], np.full(int(general.sum()), -np.inf), h[general])] if general.any() else []
    if not single.any():
        return rows
    G, h = G[single], h[single]
    column = np.abs(G).argmax(axis=1)
    factor = G[np.arange(column.size), column]
    bound, up = h / factor, factor > 0.0
    lower, upper = np.full(G.shape[1], -np.inf), np.full(G.shape[1], np.inf)
    np.minimum.at(upper, column[up], bound[up])
    np.maximum.at(lower, column[~up], bound[~up])
    if np.any(lower > upper):  # outside a limit by more than it can come back in a step: the least violation
        return [Rows(G, np.full(h.shape, -np.inf), h), *rows]
    touched = np.flatnonzero(np.bincount(column, minlength=G.shape[1]))
    return [Rows(Selection(touched), lower[touched], upper[touched]), *rows]


def task_rows(task: Any, configuration: Any) -> tuple[Mat, Vec]:
    """(W J, -gain W e) of a task with cost W; rows of cost zero are left out."""
    J, e = task.compute_jacobian(configuration), task.compute_error(configuration)
    cost = getattr(task, "cost", None)
    if cost is None or isinstance(cost, float):
        w = 1.0 if cost is None else cost
        return (w * J, (-task.gain * w) * e) if w else (J[:0], e[:0])
    W = cost_of(task, e.size)
    if W.all():
        return W[:, None] * J, -task.gain * W * e
    kept = W > 0.0
    W = W[kept]
    return W[:, None] * J[kept], -task.gain * W * e[kept]


def cost_of(task: Any, rows: int) -> Vec:
    """A task's cost ``(rows,)``, 1 where it has none."""
    cost = getattr(task, "cost", None)
    found = np.empty(rows)
    found[:] = 1.0 if cost is None else cost
    return found


def make_levels(tasks: Iterable[Any], configuration: Any) -> list[Rows]:
    """One level of a flat sequence of tasks, as many as there are of a sequence of sequences."""
    given = list(tasks)
    nested = [isinstance(item, (list, tuple)) for item in given]
    if any(nested) and not all(nested):
        raise DeclarationError("solve_ik", "tasks and levels mixed", allowed="tasks, or sequences of tasks")
    levels = []
    for members in given if all(nested) and given else [given]:
        parts = [task_rows(task, configuration) for task in members]
        parts = [part for part in parts if part[1].size]
        if parts:
            A, b = (np.concatenate(part) for part in zip(*parts, strict=True))
            levels.append(Rows(A, b, b))
    return levels
