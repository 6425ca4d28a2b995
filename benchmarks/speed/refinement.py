"""Answers of each back end that are solved with refinement and without: python -m benchmarks.speed.refinement."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.reports import report, solver_sets
from hqp import Hierarchy, certificate, solvers
from hqp.solvers import Solver
from tests.scenes import problems, random_hierarchies

OF_A_SET, RANDOM = 8, 150
"""Problems taken of each stored set, and seeds of hard random hierarchies."""


def count(solver: Solver, chosen: Sequence[Hierarchy]) -> tuple[int, int]:
    """Answers that the solver calls solved, and those of them that the certificate refuses."""
    found = [(problem, solver.solve(problem)) for problem in chosen]
    solved = [(problem, solution) for problem, solution in found if solution.status.solved]
    return len(solved), sum(not certificate(problem, solution.x).ok for problem, solution in solved)


def main() -> None:
    """Solve and show."""
    chosen = [problem for name in problems.names() for problem in problems.load(name, OF_A_SET)]
    chosen += [random_hierarchies.hierarchy(seed) for seed in range(RANDOM)]
    rows = []
    for name in solver_sets.back_ends():
        (refined, wrong), (plain, off) = (count(solvers.load(name, refine=on), chosen) for on in (True, False))
        rows.append((name, f"{refined} of {len(chosen)}", f"{plain} of {len(chosen)}", str(wrong + off)))
    text = report.table(("solver", "refined", "refine=False", "solved but refused"), rows)
    report.console.print(text, markup=False, soft_wrap=True)


if __name__ == "__main__":
    main()
