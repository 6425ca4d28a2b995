"""Eqs. (12), (16), (17) and footnote 3: the prioritised inverse as printed, and the limits of its claims."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.mistry2008.equations.algebra import as_printed, largest, pinv, projector, rank, siciliano_slotine
from benchmarks.mistry2008.equations.levels import PaperLevels, paper_levels, solve
from benchmarks.reports.checks import Check, at_most, exactly, seen_to_fail
from hqp import solvers
from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot
from hqp.solvers.base import Solver

SEED = 16

LAMBDA = 1e-3
"""Damping of footnote 3 [units of J]."""

CONFLICT = 1e-7
"""Distance of level B's rows from the row space of level A."""


def checks(robot: Robot, count: int) -> Iterator[Check]:
    """Every row on one robot at ``count`` random states."""
    yield from _law(robot, count)
    yield from _projectors(robot, max(3, count // 4))
    yield from _footnote(robot, max(3, count // 4))
    yield from _near_conflict(robot, count)
    yield from _coordinates(robot, count)


def _law(robot: Robot, count: int) -> Iterator[Check]:
    chiaverini = solvers.load("chiaverini")
    ranks, printed, critical, feet, independent, above = [], [], [], [], [], []
    for levels in paper_levels(robot, count, SEED):
        A, B, E = levels.pairs
        ranks.append(rank(levels.J_A))
        x = solve(chiaverini, [A, B, E])
        printed.append(largest(x - as_printed([A, B, E])) / (1.0 + largest(x)))
        critical.append(largest(levels.J_A @ x - levels.x_A))
        feet.append(largest(levels.J_C @ x))
        other = solve(chiaverini, [A, B, (levels.J_E, -3.0 * levels.x_E)])
        independent.append(largest(levels.J_B @ (x - other)))
        above.append(largest(levels.J_A @ (x - other)))
    name = robot.name
    yield exactly("M(12)", "rank of J_A in double support", name, 14, ranks)
    yield at_most("M(16)", "solver `chiaverini` = the formula by SVD, relative", name, 1e-9, printed)
    yield at_most("M(16)", "J_A qd = xd_A", name, 1e-11, critical)
    yield at_most("M(16)", "J_C qd = 0", name, 1e-11, feet)
    yield at_most("M(16)", "levels A and B do not notice xd_E", name, 1e-11, [*independent, *above])


def solver_projector(solver: Solver, above: list[Mat]) -> Mat:
    """N of the levels above, column by column: a solver's answer to a unit vector as the target below them."""
    n = above[0].shape[1]
    zeros = [(J, np.zeros(J.shape[0])) for J in above]
    return np.stack([solve(solver, [*zeros, (np.eye(n), unit)]) for unit in np.eye(n)], axis=1)


def _projectors(robot: Robot, count: int) -> Iterator[Check]:
    chiaverini = solvers.load("chiaverini")
    algebra, zero, nested, definition = [], [], [], []
    for levels in paper_levels(robot, count, SEED + 1):
        N_A = solver_projector(chiaverini, [levels.J_A])
        N_AB = solver_projector(chiaverini, [levels.J_A, levels.J_B])
        n = robot.nv
        for N, J in ((N_A, levels.J_A), (N_AB, np.concatenate((levels.J_A, levels.J_B)))):
            algebra += [largest(N - N.T), largest(N @ N - N), abs(float(np.trace(N)) - (n - rank(J)))]
            zero.append(largest(J @ N))
            definition.append(largest(N - projector(J)))
        nested.append(largest(N_A @ N_AB - N_AB))
        projected = levels.J_B @ N_A
        nested.append(largest(N_AB - (N_A - pinv(projected, float(np.linalg.norm(levels.J_B, 2))) @ projected)))
    name = robot.name
    yield at_most("M(17)", "N_A, N_AB symmetric, idempotent, trace n - rank", name, 1e-11, algebra)
    yield at_most("M(17)", "J_A N_A = 0, [J_A; J_B] N_AB = 0", name, 1e-11, zero)
    yield at_most("M(17)", "N_A N_AB = N_AB, recursion N_AB = N_A - (J_B N_A)^+ J_B N_A", name, 1e-10, nested)
    yield at_most("M(17)", "the solver's projectors = I - J^+ J by SVD", name, 1e-10, definition)


def _footnote(robot: Robot, count: int) -> Iterator[Check]:
    damped = solvers.load("chiaverini", damping=LAMBDA)
    critical, second, formula, alone = [], [], [], []
    for levels in paper_levels(robot, count, SEED + 2):
        N = solver_projector(damped, [levels.J_A, levels.J_B])
        both = np.concatenate((levels.J_A, levels.J_B))
        inner = both @ both.T + LAMBDA**2 * np.eye(both.shape[0])
        N_lambda = np.eye(robot.nv) - both.T @ np.linalg.solve(inner, both)
        formula.append(largest(N - projector(levels.J_A) @ N_lambda))
        critical.append(largest(levels.J_A @ N))
        second.append(largest(levels.J_B @ N))
        alone.append(largest(levels.J_A @ N_lambda))
    name = robot.name
    yield at_most("M fn 3", "J_A N_A N_AB^lambda = 0", name, 1e-11, critical)
    yield at_most("M fn 3", "the solver's N_A N_AB^lambda = the formula", name, 1e-10, formula)
    note = f"lambda {LAMBDA:g}; erratum M8: damping moves level B, at most {max(second):.1e}"
    yield seen_to_fail("M fn 3", "J_A N_AB^lambda without the outer N_A", name, 1e-11, alone, note)


def _conflicting(levels: PaperLevels) -> Mat:
    """A J_B whose rows are combinations of those of J_A but for a share CONFLICT of the hand's."""
    mix = np.zeros((3, levels.J_A.shape[0]))
    mix[:, :3] = np.eye(3)
    mix[:, 12:] = 0.5
    return mix @ levels.J_A + CONFLICT * levels.J_B


def _near_conflict(robot: Robot, count: int) -> Iterator[Check]:
    """M7, M8: any recursive projector keeps level A; its velocities explode; the rank of (17) jumps."""
    nullspace, chiaverini = solvers.load("nullspace"), solvers.load("chiaverini")
    critical, printed, recursive, jump, moved = [], [], [], [], []
    for levels in paper_levels(robot, count, SEED + 3):
        J_B = _conflicting(levels)
        pairs = [(levels.J_A, levels.x_A), (J_B, levels.x_B)]
        x, y = solve(nullspace, pairs), solve(chiaverini, pairs)
        critical.append(largest(levels.J_A @ x - levels.x_A) / (1.0 + largest(x)))
        recursive.append(float(np.linalg.norm(x)))
        printed.append(float(np.linalg.norm(y)))
        reference = siciliano_slotine(pairs)
        moved.append(largest(x - reference) / (1.0 + largest(reference)))
        both = np.concatenate((levels.J_A, J_B))
        jump.append(largest(_cut(both, 1e-9) - _cut(both, 1e-5)))
    name = robot.name
    text = "level B within 1e-7 of conflict: the recursive projector keeps J_A qd = xd_A, relative"
    yield at_most("M(16)", text, name, 1e-11, critical, "erratum M7: (16) is not the only one")
    yield at_most("M(16)", "near a conflict the velocities of (16) stay bounded", name, 1e3, printed)
    yield seen_to_fail("M(16)", "near a conflict the recursive projector's do not", name, 1e3, recursive, "M7")
    yield seen_to_fail("M(17)", "N_AB does not depend on the rank cut-off (1e-9, 1e-5)", name, 1e-3, jump, "erratum M8")


def _cut(J: Mat, cut: float) -> Mat:
    _, s, Vt = np.linalg.svd(J)
    row_space = Vt[: int(np.count_nonzero(s > cut * s[0]))]
    return np.eye(J.shape[1]) - row_space.T @ row_space


def _coordinates(robot: Robot, count: int) -> Iterator[Check]:
    """M13: (16) depends on the units of the base translation; the hierarchy only in its null motion."""
    nullspace, chiaverini = solvers.load("nullspace"), solvers.load("chiaverini")
    scale = np.ones(robot.nv)
    scale[:3] = 1e-3  # base translation in mm
    hierarchy, printed = [], []
    for levels in paper_levels(robot, count, SEED + 4):

        def in_millimetres(pairs: list[tuple[Mat, Vec]], solver: Solver) -> Vec:
            return scale * solve(solver, [(J * scale, target) for J, target in pairs])

        x = in_millimetres(levels.pairs, nullspace)
        hierarchy += [largest(J @ x - target) for J, target in levels.pairs]
        y = in_millimetres(levels.pairs, chiaverini)
        printed.append(largest((y - solve(chiaverini, levels.pairs))[6:]))
    name = robot.name
    yield at_most("M(16)", "base translation in mm: the hierarchy still meets all three levels", name, 1e-9, hierarchy)
    yield seen_to_fail("M(16)", "base translation in mm: (16) gives the same qd_r", name, 1e-6, printed, "erratum M13")
