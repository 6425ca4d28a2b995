"""Tasks, limits and constraints on the displacement dq of one step, as pink and mink write them, as a hierarchy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.problem import Hierarchy, Rows, Solution
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
        strict.append(Rows(G, np.full(h.shape, -np.inf), h))
    if equalities:
        A, b = (np.concatenate(part) for part in zip(*equalities, strict=True))
        strict.append(Rows(A, b, b))
    problem = Hierarchy((*strict, *levels), constraints=len(strict), n=nv)
    key = (solver, problem.shape)
    if key not in _workspaces:
        _workspaces[key] = (load(solver) if isinstance(solver, str) else solver).workspace(problem.shape)
    return _workspaces[key].solve(problem)


def task_rows(task: Any, configuration: Any) -> tuple[Mat, Vec]:
    """(W J, -gain W e) of a task with cost W; rows of cost zero are left out."""
    J = np.asarray(task.compute_jacobian(configuration), dtype=np.float64)
    e = np.asarray(task.compute_error(configuration), dtype=np.float64)
    weight = cost_of(task, e.size)
    kept = weight > 0.0
    W = weight[kept]
    return W[:, None] * J[kept], -float(task.gain) * W * e[kept]


def cost_of(task: Any, rows: int) -> Vec:
    """A task's cost ``(rows,)``, 1 where it has none."""
    cost = getattr(task, "cost", None)
    return np.broadcast_to(np.asarray(1.0 if cost is None else cost, dtype=np.float64), (rows,)).copy()


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
