"""Priced levels through any solver of exact hierarchies: a stage for each level from the first that is not clear.

A level is clear where it is met at its point of least motion, that point keeps to all rows above, and the shortest u
with A_k'u + c F'(F x - f) + (rows above) = 0 has ||u|| <= 1.  While every priced level is clear, the answer is that of
the exact hierarchy, to the bit.  From the first level that is not, each stage is min ||w||^2 + m |y|^2, y the motion,
for the m with m = c ||w||, found by a secant on log m; the last solve is of the exact hierarchy with what the levels
hand down (hqp.pricing).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.pricing import Coordinates, after_stages, at_optimum, feasible_set, room, stack_rows
from hqp.problem import Hierarchy, Rows, Shape, Solution, Stats
from hqp.solvers.base import Workspace, check_shape, finish

LEAST = 1e-6
"""sqrt(m) of a priced level below which it counts as met, relative to its largest row."""

ROOT = 1e-12
"""m is found to this relative accuracy."""

StagePoint = Callable[[Hierarchy, Coordinates, Rows, Vec, int], Vec]
"""x_k of (problem, coordinates, S_{k-1} as hard rows, a point of it, k)."""


def multiplier(unmet: Callable[[float], float], price: float, size: float) -> float | None:
    """The m with m = c ||w(m)||, None where the level is met for its price.

    unmet: ||w(m)|| of argmin ||w||^2 + m |y|^2, which grows with m more slowly than m does.  size: largest row.
    """

    def excess(log: float) -> float:
        return log - math.log(max(price * unmet(math.exp(log)), 1e-300))

    low = 2.0 * math.log(LEAST * size)
    if excess(low) >= 0.0:
        return None
    high = low + 4.0
    while (far := excess(high)) < 0.0:
        low, high = high, 2.0 * high - low + 4.0
    near, guess = excess(low), high
    for _ in range(100):  # regula falsi with the Illinois rule, halving where it is slow
        guess = high - far * (high - low) / (far - near)
        here = excess(guess)
        if abs(here) <= ROOT or high - low <= ROOT:
            break
        if here > 0.0:
            high, far, near = guess, here, 0.5 * near
        else:
            low, near, far = guess, here, 0.5 * far
    return math.exp(guess)


def first_unclear(problem: Hierarchy, x: Vec, at: Coordinates) -> int | None:
    """The first priced level that the exact answer x does not settle; None where it settles all of them."""
    A, b, hard = np.zeros((0, problem.n)), np.zeros(0), []
    prices = problem.prices if problem.prices is not None else np.zeros(len(problem.levels))
    last = max((k for k, price in enumerate(prices) if price > 0.0), default=-1)
    for k in range(last + 1):
        rows = at_optimum(problem.levels[k], x) if prices[k] == 0.0 else problem.levels[k]
        dense, equal = rows.dense(problem.n), rows.equality
        A = np.concatenate([A, at.rows(dense[equal])])
        b = np.concatenate([b, rows.lower[equal] - dense[equal] @ at.still])
        hard.append(rows)
        if prices[k] == 0.0:
            continue
        shares, *_ = np.linalg.lstsq(A @ A.T, b, rcond=1e-12)
        y = shares @ A
        own = shares[shares.size - int(equal.sum()) :]
        terms = 1.0 + np.abs(A) @ np.abs(y)
        clear = bool(np.all(np.abs(A @ y - b) <= 1e-9 * terms)) and prices[k] * float(np.sqrt(own @ own)) <= 1.0
        point = at.point(y)
        if not clear or any(np.any(np.abs(r.slack(point)) > 1e-9 * (1.0 + np.abs(r.A @ point))) for r in hard):
            return k
    return None


class StagedWorkspace:
    """A workspace for priced hierarchies: one for the exact hierarchy, one for what the stages leave."""

    def __init__(self, shape: Shape, exact: Callable[[Shape], Workspace], stage: StagePoint | None = None) -> None:
        self._shape = shape
        self._exact = exact(replace(shape, priced=()))
        rows = tuple(m + 1 if priced else m for m, priced in zip(shape.rows, shape.priced, strict=True))
        selections = tuple(s and not p for s, p in zip(shape.selections, shape.priced, strict=True))
        self._last = exact(replace(shape, rows=rows, selections=selections, inequalities=True, priced=()))
        self._workspaces: dict[Shape, Workspace] = {}
        self._make = exact
        self._stage = stage or self._by_secant
        self._problem: Hierarchy | None = None

    def reset(self) -> None:
        """Forget the warm starts."""
        self._exact.reset()
        self._last.reset()
        self._workspaces.clear()

    def solve(self, problem: Hierarchy) -> Solution:
        """The exact answer where every priced level is clear, else that of the stages, with their points."""
        check_shape(problem, self._shape)
        if self._problem is not problem:
            self._problem, self._plain = problem, problem.exact()
        solution = self._exact.solve(self._plain)
        if not problem.priced or not solution.status.usable:
            return solution
        began = perf_counter()
        at = Coordinates.of(problem.motion, problem.n)
        first = first_unclear(problem, solution.x, at)
        if first is None:
            return solution
        stages, x = self._stages(problem, at, solution.x, first)
        final = after_stages(problem, stages, at)
        levels = [
            room(rows) if priced and rows.m == problem.levels[k].m else rows
            for k, (rows, priced) in enumerate(zip(final.levels, problem.priced, strict=True))
        ]
        answer = self._last.solve(replace(final, levels=tuple(levels)))
        best = answer.x if answer.status.solved else x
        stats = Stats(
            solution.stats.iterations + answer.stats.iterations,
            solution.stats.factorisations + answer.stats.factorisations,
            solution.stats.build_s,
            solution.stats.solve_s + perf_counter() - began,
        )
        return finish(problem, best, answer.status, stats, answer.detail, stages)

    def _stages(self, problem: Hierarchy, at: Coordinates, x: Vec, first: int) -> tuple[Mat, Vec]:
        """The stage points from the first level on, and the last of them."""
        stages = np.full((len(problem.levels), problem.n), np.nan)
        # levels above the first are met by x, so x stands for the point of their stage
        known = stages.copy()
        known[:first] = x
        for k in range(first, len(problem.levels)):
            if problem.priced[k]:
                x = self._stage(problem, at, feasible_set(problem, known, k, x, at.still), x, k)
                stages[k] = known[k] = x
            elif any(problem.priced[k + 1 :]):
                hard = feasible_set(problem, known, k, x, at.still)
                x = self._ask(Hierarchy((hard, problem.levels[k]), constraints=1, n=problem.n), x)
        return stages, x

    def _by_secant(self, problem: Hierarchy, at: Coordinates, above: Rows, x: Vec, k: int) -> Vec:
        rows, n = problem.levels[k], problem.n
        dense = rows.dense(n)
        size = float(np.sqrt(np.square(dense).sum(axis=1).max(initial=0.0)))
        price = 0.0 if problem.prices is None else float(problem.prices[k])
        inverse = np.diag(at.inverse) if at.inverse.ndim == 1 else at.inverse
        still = inverse @ at.still
        point = x

        def unmet(m: float) -> float:
            nonlocal point
            root = math.sqrt(m)
            level = stack_rows([rows, Rows(root * inverse, root * still, root * still)], n)
            point = self._ask(Hierarchy((above, level), constraints=1), x)
            w = rows.slack(point)
            return float(np.sqrt(w @ w))

        if size == 0.0:
            return x
        if multiplier(unmet, price, size) is None:
            motion = Rows(inverse, still, still)
            point = self._ask(Hierarchy((above, rows, motion), constraints=1, n=n), x)
        return point

    def _ask(self, problem: Hierarchy, otherwise: Vec) -> Vec:
        """The answer of an exact hierarchy, in a workspace kept for its shape."""
        shape = replace(problem.shape, inequalities=True)
        if shape not in self._workspaces:
            self._workspaces[shape] = self._make(shape)
        answer = self._workspaces[shape].solve(problem)
        return answer.x if np.isfinite(answer.x).all() else otherwise
