"""Relations of eq. (16), the recursive projector and the hierarchical QP: six measured statements.

1 HQP = recursive projector at every rank.  2 (16) shares level A's residual, never has a smaller one at level B.
3, 4 when (16) coincides with the HQP.  5 (16) is an HQP for other targets.  6 how (16)'s second level converges.

A solver that wraps a QP back end may answer a problem without inequalities by its own recursion.  A box that is never
active makes each of them call its back end; a row fails if it does not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.mistry2008.equations.algebra import as_printed, largest, pinv, projector, siciliano_slotine
from benchmarks.mistry2008.equations.levels import PaperLevels, paper_levels, solve
from benchmarks.reports import solver_sets
from benchmarks.reports.checks import Check, at_most, exactly
from hqp import solvers
from hqp.arrays import Mat, Vec
from hqp.declare.robot import Robot
from hqp.problem import Hierarchy, Rows, Selection, Solution
from hqp.solvers.base import Solver

SEED = 2

SLACK = 1e-11
"""Rounding allowed when residuals are compared."""

Levels = list[tuple[Mat, Vec]]


def checks(robot: Robot, count: int) -> Iterator[Check]:
    """Every statement on one robot at ``count`` random states."""
    yield from _equal_to_projector(robot, count)
    yield from _never_better(robot, count)
    yield from _coincidence(robot, count)
    yield from _shifted(robot, count)
    yield from _second_level_rate(robot, count)


def variants(levels: PaperLevels, rng: np.random.Generator) -> dict[str, Levels]:
    """The paper's levels as they are, with dependent rows, and in conflict; the posture makes the answer unique."""
    n = levels.J_A.shape[1]
    last = (np.eye(n)[6:], rng.standard_normal(n - 6))
    A, B, E = levels.pairs
    doubled = np.concatenate((levels.J_B, levels.J_B[:2]))
    mix = rng.standard_normal((2, levels.J_A.shape[0]))
    crossing = np.concatenate((levels.J_B, mix @ levels.J_A))
    return {
        "full rank": [A, B, E, last],
        "dependent rows": [A, (doubled, np.concatenate((levels.x_B, levels.x_B[:2]))), E, last],
        "conflicting": [A, (crossing, rng.standard_normal(5)), E, last],
        "dependent and conflicting": [A, (doubled, rng.standard_normal(5)), E, last],
    }


def ask(solver: Solver, stack: Levels) -> Solution:
    """A solver's answer to levels under a box far outside the solution, without the box if it takes no bounds."""
    rows = [Rows(J, target, target) for J, target in stack]
    if not solver.inequalities:
        return solver.solve(Hierarchy(tuple(rows)))
    n = stack[0][0].shape[1]
    far = np.full(n, 10.0 * (1.0 + largest(siciliano_slotine(stack))))
    return solver.solve(Hierarchy((Rows(Selection(np.arange(n)), -far, far), *rows), constraints=1))


def asked(solver: Solver, solution: Solution) -> bool:
    """Return true if the solver called its back end: it reports iterations or time."""
    return not hasattr(solver, "refine") or solution.stats.iterations > 0 or solution.stats.solve_s > 0.0


def alone(solver: Solver) -> Solver | None:
    """The solver without our refinement of its back end's answer; None for a solver without back end."""
    return replace(solver, refine=False) if hasattr(solver, "refine") else None  # type: ignore[type-var]


def _equal_to_projector(robot: Robot, count: int) -> Iterator[Check]:
    rng = np.random.default_rng([SEED, 1])
    cases: dict[str, list[tuple[Levels, Vec]]] = {}
    for levels in paper_levels(robot, count, SEED):
        for kind, stack in variants(levels, rng).items():
            cases.setdefault(kind, []).append((stack, siciliano_slotine(stack)))
    for name, solver in solver_sets.exact().items():
        for kind, problems in cases.items():
            errors = []
            for stack, reference in problems:
                answer = ask(solver, stack)
                errors.append(_error(answer.x, reference) if asked(solver, answer) else math.nan)
            text = f"2.1.1: `{name}` = recursive projector by SVD, {kind}, relative"
            note = _back_end(solver, problems[: max(3, count // 4)])
            yield at_most("M equiv", text, robot.name, 1e-9, errors, note)


def _back_end(solver: Solver, problems: list[tuple[Levels, Vec]]) -> str:
    """Error of the back end's own answer in words, for the note; the row judges the refined answer."""
    bare = alone(solver)
    if bare is None:
        return ""
    answers = [(ask(bare, stack), reference) for stack, reference in problems]
    errors = [_error(answer.x, reference) for answer, reference in answers]
    certified = sum(answer.status.solved for answer, _ in answers)
    return f"refined by our recursion; back end alone {max(errors):.1e}, certified {certified} of {len(answers)}"


def _error(x: Vec, reference: Vec) -> float:
    return largest(x - reference) / (1.0 + largest(reference))


def _residuals(stack: Levels, x: Vec) -> Vec:
    return np.array([float(np.linalg.norm(J @ x - target)) for J, target in stack])


def _never_better(robot: Robot, count: int) -> Iterator[Check]:
    rng = np.random.default_rng([SEED, 2])
    chiaverini, candidates = solvers.load("chiaverini"), solver_sets.exact()
    critical, better, share = [], dict.fromkeys(candidates, 0), []
    for levels in paper_levels(robot, count, SEED + 1):
        for kind, stack in variants(levels, rng).items():
            printed = _residuals(stack, solve(chiaverini, stack))
            if kind == "full rank":
                share.append(printed[1] / float(np.linalg.norm(stack[1][1])))
            for name, solver in candidates.items():
                own = _residuals(stack, ask(solver, stack).x)
                critical.append(abs(own[0] - printed[0]))
                better[name] += int(own[1] > printed[1] + SLACK * (1.0 + printed[1]))
    yield at_most("M equiv", "2.1.2: (16) and the HQPs have the same level-A residual", robot.name, 1e-11, critical)
    note = f"(16) leaves {np.median(share):.2f} of level B unmet (median, {min(share):.2f} to {max(share):.2f})"
    for name, times in better.items():
        text = f"2.1.2: states where (16) has a smaller level-B residual than `{name}`"
        yield exactly("M equiv", text, robot.name, 0, [times], note)


def orthogonal(stack: Levels) -> Levels:
    """Make each level's row space orthogonal to those above, with equal targets (statement 3's condition)."""
    above: Mat = np.zeros((0, stack[0][0].shape[1]))
    result: Levels = []
    for J, target in stack:
        J = J @ projector(above) if above.size else J
        above = np.concatenate((above, J))
        result.append((J, target))
    return result


def _coincidence(robot: Robot, count: int) -> Iterator[Check]:
    chiaverini, nullspace = solvers.load("chiaverini"), solvers.load("nullspace")
    every, given, apart = [], [], []
    for levels in paper_levels(robot, count, SEED + 2):
        stack = orthogonal(levels.pairs)
        every.append(_difference(chiaverini, nullspace, stack))
        apart.append(_difference(chiaverini, nullspace, levels.pairs))
        # statement 4: J_B P_A J_B^+ x_B = J_B J_A^+ x_A has such x_B where the left factor is regular
        A, B = levels.pairs[:2]
        inverse = pinv(A[0])
        x_B = np.linalg.lstsq(B[0] @ inverse @ A[0] @ pinv(B[0]), B[0] @ inverse @ A[1], rcond=None)[0]
        given.append(_difference(chiaverini, nullspace, [A, (B[0], x_B)]))
    note = f"for the paper's own tasks they differ by {np.median(apart):.2f} (median, relative)"
    name = robot.name
    yield at_most("M equiv", "2.1.3: orthogonal row spaces: (16) = HQP for all targets", name, 1e-9, every, note)
    yield at_most("M equiv", "2.1.4: x_B with J_B P_A J_B^+ x_B = J_B J_A^+ x_A: (16) = HQP", name, 1e-9, given)


def _difference(first: Solver, second: Solver, stack: Levels) -> float:
    x = solve(second, stack)
    return largest(solve(first, stack) - x) / (1.0 + largest(x))


def _shifted(robot: Robot, count: int) -> Iterator[Check]:
    candidates = solver_sets.exact()
    differences: dict[str, list[float]] = {name: [] for name in candidates}
    for levels in paper_levels(robot, count, SEED + 3):
        A, B, E = levels.pairs
        x = as_printed([A, B, E])
        stack = [A, (B[0], B[0] @ x), (E[0], E[0] @ x)]
        for name, solver in candidates.items():
            differences[name].append(_error(ask(solver, stack).x, x))
    for name, values in differences.items():
        text = f"2.1.5: (16) = `{name}` for the targets x_A, J_B x_16, J_E x_16"
        yield at_most("M equiv", text, robot.name, 1e-9, values)


def _second_level_rate(robot: Robot, count: int) -> Iterator[Check]:
    """Statement 6: with x_A = 0 and x_B = -K e, (16) gives de/dt = -K J_B N_A J_B^+ e, eigenvalues in [0, 1]."""
    chiaverini = solvers.load("chiaverini")
    law, slowest = [], []
    for levels in paper_levels(robot, count, SEED + 4):
        rate = levels.J_B @ projector(levels.J_A) @ pinv(levels.J_B)
        eigenvalues = np.linalg.eigvals(rate)
        slowest.append(float(eigenvalues.real.min()))
        x = solve(chiaverini, [(levels.J_A, np.zeros(14)), (levels.J_B, -levels.x_B)])
        law.append(largest(levels.J_B @ x + rate @ levels.x_B))
    note = f"slowest {min(slowest):.3f}, median {np.median(slowest):.2f} of the gain asked for"
    text = "2.1.6: level B moves at J_B N_A J_B^+ times the rate asked for"
    yield at_most("M equiv", text, robot.name, 1e-9, law, note)
