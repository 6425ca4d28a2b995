"""Random hierarchies of many kinds, solved and judged by the certificate: ``python -m tests.solvers.fuzz [--priced]``.

Every solved answer must pass the certificate; a second solve in the same workspace must give the same level norms.  A
failure is printed as ``kind seed tick``; ``problem(kind, seed)`` reproduces it.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import hqp
from hqp import Hierarchy, Solution, Status, certificate
from tests.scenes.kinds import KINDS, problem
from tests.scenes.priced import in_a_loop, is_unsure

TOLERANCES = (1e-6, 1e-8)
"""An answer is wrong if the certificate refuses it at every tolerance; the looser one also reads activity loosely."""

AGREEMENT = 1e-8
"""Allowed difference of norms between two solves of one problem, relative to the terms of the level."""


@dataclass
class Count:
    """Results on one kind."""

    problems: int = 0
    status: Counter[str] = field(default_factory=Counter)
    refused: list[str] = field(default_factory=list)
    unsolved: list[str] = field(default_factory=list)
    disagree: list[str] = field(default_factory=list)
    most_iterations: int = 0
    slowest: float = 0.0


def scales(problem: Hierarchy, x: np.ndarray) -> np.ndarray:
    """Size of the terms of each level at x: the unit of its norm."""
    return np.array(
        [
            1e-300 + float(np.max(np.abs(rows.dense(problem.n)) @ np.abs(x) + np.abs(rows.slack(x)), initial=0.0))
            for rows in problem.levels
        ]
    )


def differ(problem: Hierarchy, a: Solution, b: Solution) -> bool:
    """Return true if two answers differ in a norm."""
    return bool(np.any(np.abs(a.norms - b.norms) > AGREEMENT * scales(problem, a.x)))


def run(kinds: list[str], start: int, count: int, seconds: float, **options: object) -> dict[str, Count]:
    """Solve ``count`` problems of every kind from seed ``start``, for at most ``seconds``."""
    solver, found = hqp.solvers.load("lexicographic", **options), {name: Count() for name in kinds}
    begin = time.perf_counter()
    seed = start
    while min(found[name].problems for name in kinds) < count and time.perf_counter() - begin < seconds:
        for name in kinds:
            if found[name].problems >= count:
                continue
            sequence = problem(name, seed)
            workspace = solver.workspace(sequence[0].shape)
            before: Solution | None = None
            for tick, one in enumerate(sequence):
                now = workspace.solve(one)
                _judge(found[name], f"{name} {seed} {tick}", one, now)
                if (
                    before is not None
                    and sequence[tick - 1] is one
                    and now.status.solved
                    and before.status.solved
                    and differ(one, before, now)
                ):
                    found[name].disagree.append(f"{name} {seed} {tick}")
                before = now
        seed += 1
    return found


def run_priced(kinds: list[str], start: int, count: int, seconds: float) -> dict[str, Count]:
    """Solve ``count`` priced problems of every kind as in a loop, with and without flat motion.

    Answers with an uncertain status count as unsolved; each other one must pass the certificate at 1e-8.
    """
    solver, found = hqp.solvers.load("lexicographic"), {name: Count() for name in kinds}
    begin = time.perf_counter()
    for seed in range(start, start + count):
        for name, flat in itertools.product(kinds, (False, True)):
            if time.perf_counter() - begin > seconds:
                return found
            case, solution = in_a_loop(solver, name, seed, flat)
            one, title = found[name], f"{name} {seed}{' flat' * flat}"
            one.problems += 1
            one.status[solution.status.name] += 1
            one.slowest = max(one.slowest, solution.stats.solve_s)
            if not solution.status.solved or is_unsure(solution):
                one.unsolved.append(title)
            elif not (verdict := certificate(case, solution.x, TOLERANCES[-1], solution.stage_points)).ok:
                one.refused.append(f"{title} {solution.status.name} {verdict.gap:.1e}")
    return found


def _judge(count: Count, name: str, problem: Hierarchy, solution: Solution) -> None:
    count.problems += 1
    count.status[solution.status.name] += 1
    count.most_iterations = max(count.most_iterations, solution.stats.iterations)
    count.slowest = max(count.slowest, solution.stats.solve_s)
    if not solution.status.solved:
        count.unsolved.append(name)
    elif not any(certificate(problem, solution.x, tolerance).ok for tolerance in TOLERANCES):
        count.refused.append(f"{name} {solution.status.name}")
    elif not np.isfinite(solution.x).all() or solution.status is Status.NOT_CERTIFIED:
        count.refused.append(f"{name} not finite")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--count", type=int, default=1000, help="problems of each kind")
    parser.add_argument("--start", type=int, default=0, help="first seed")
    parser.add_argument("--priced", action="store_true", help="with prices, as in a control loop")
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--json", type=Path, default=None)
    arguments = parser.parse_args()
    solve = run_priced if arguments.priced else run
    found = solve(arguments.kinds, arguments.start, arguments.count, arguments.seconds)
    for name, count in found.items():
        print(
            f"{name:14} {count.problems:7} {dict(count.status)} refused {len(count.refused)} disagree "
            f"{len(count.disagree)} iterations {count.most_iterations} slowest {1e3 * count.slowest:.2f} ms"
        )
        for line in (*count.refused[:6], *(f"{u} UNSOLVED" for u in count.unsolved[:6])):
            print("    ", line)
        for line in count.disagree[:6]:
            print("    ", line, "disagrees")
    total = sum(count.problems for count in found.values())
    refused, unsolved = (sum(len(getattr(c, what)) for c in found.values()) for what in ("refused", "unsolved"))
    print(f"problems {total} refused {refused} unsolved {unsolved}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps({name: vars(count) for name, count in found.items()}, indent=1))
    return int(refused > 0)


if __name__ == "__main__":
    raise SystemExit(main())
