"""One command for one problem: torque problems of closed loops, solved with noise, by generic kernels, and cold.

A hand, or a quadruped's base, swings and leaves its reach, feet come to the edges of their friction cones, the state is
pushed every 250 ticks.  Answers are compared if both are OPTIMAL.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import hqp
from benchmarks.reports import report
from hqp import Hierarchy, Status
from hqp.arrays import Vec
from tests.scenes.noise import noisy
from tests.scenes.stacks import scene

ROBOTS = ("talos", "g1", "cbi", "icub", "romeo", "go2", "anymal")
ALLOWED = 1e-6
"""Largest change of a command, of the largest torque."""
PUSHED, KICK = 250, 0.05
"""Ticks between pushes, and the size of the change of every speed [rad/s, m/s]."""
MARK = "<!-- tables: python -m benchmarks rounding --page docs/results/solver.md -->"
END = "<!-- end of rounding -->"
WAYS = {"noise": "noise of 1e-12", "start": "cold beside warm", "kernel": "generic beside AVX2"}


@dataclass
class Compared:
    """Answers to the same problems found in another way: differences of certain ones [N m], and of the largest
    torque."""

    apart: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    uncertain: float = 0.0
    """Largest difference of answers of which one is not certain [N m]."""
    otherwise: int = 0
    """Ticks with another status."""

    def add(self, x: Vec, status: Status, y: Vec, other: Status) -> None:
        """Compare two answers."""
        apart = float(np.abs(x - y).max())
        self.otherwise += status is not other
        if status is other is Status.OPTIMAL:
            self.apart.append(apart)
            self.shares.append(apart / float(np.abs(x).max()))
        elif status.solved and other.solved:
            self.uncertain = max(self.uncertain, apart)

    def cells(self) -> str:
        """Largest difference [N m], ticks beyond the allowed share, ticks with another status, largest uncertain."""
        beyond = sum(share > ALLOWED for share in self.shares)
        return f"{max(self.apart, default=0.0):.1e} | {beyond} | {self.otherwise} ({self.uncertain:.1e})"


@dataclass
class Found:
    """Figures of a loop."""

    ways: dict[str, Compared] = field(default_factory=lambda: {way: Compared() for way in WAYS})
    statuses: Counter[str] = field(default_factory=Counter)
    judged: int = 0
    refused: int = 0
    step: float = 0.0
    """Largest change of a torque in a tick without a push [N m]."""


class Warm:
    """A workspace without a time limit, as a session has."""

    def __init__(self) -> None:
        self._solver = hqp.solvers.load("lexicographic")
        self._workspace: Any = None

    def solve(self, problem: Hierarchy) -> tuple[Vec, Status, Any]:
        """The answer, from where the last one ended."""
        if self._workspace is None:
            self._workspace = self._solver.workspace(problem.shape)
            self._workspace.limit(np.inf)
        found = self._workspace.solve(problem)
        return found.x.copy(), found.status, found.stage_points


_ELSEWHERE = Warm()


def elsewhere(problem: Hierarchy) -> tuple[Vec, Status]:
    """The answer in a process with other kernels."""
    x, status, _ = _ELSEWHERE.solve(problem)
    return x, status


def measure(name: str, price: float | None, ticks: int, every: int, pool: ProcessPoolExecutor) -> Found:
    """Run a loop and solve each of its problems in every way; each ``every``th certain answer is judged at 1e-8."""
    rng, found, before = np.random.default_rng(0), Found(), None
    session, given = scene(name, "torque", price)
    robot, warm, moved = session.robot, Warm(), Warm()
    q, v = robot.home.copy(), np.zeros(robot.nv)
    pool.submit(elsewhere_anew).result()
    for i in range(ticks):
        pushed = i % PUSHED == PUSHED - 1
        v = v + KICK * rng.standard_normal(robot.nv) * pushed
        tick = session.step(robot.state(q, v), *given(i))
        problem = session.problem.copy()
        future = pool.submit(elsewhere, problem)
        x, status, points = warm.solve(problem)
        found.statuses[status.name] += 1
        cold = Warm().solve(problem)
        for way, answer in (("noise", moved.solve(noisy(problem, rng))), ("start", cold), ("kernel", future.result())):
            found.ways[way].add(x, status, answer[0], answer[1])
        if i % every == 0 and status is Status.OPTIMAL:
            found.judged += 1
            found.refused += not hqp.certificate(problem, x, 1e-8, points).ok
        if before is not None and not pushed:
            found.step = max(found.step, float(np.abs(x - before).max()))
        before = x
        q, v = tick.advance()
    return found


def instruction_set() -> str:
    """Instruction set of a process."""
    from hqp.solvers.lexicographic import kernel

    return kernel()


def elsewhere_anew() -> None:
    """Forget the last robot."""
    global _ELSEWHERE
    _ELSEWHERE = Warm()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS), metavar="ROBOT")
    parser.add_argument("--ticks", type=int, default=2000, help="of each loop (2000)")
    parser.add_argument("--every", type=int, default=10, help="judge each such certain answer (10)")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table into this page")


def run(arguments: argparse.Namespace) -> int:
    """Run, show, write; returns 1 if a certain command differs by more than is allowed or is refused."""
    ticks = 100 if arguments.quick else arguments.ticks
    head = ["loop, price", "statuses of the warm answers"]
    for text in WAYS.values():
        head += [f"{text}: largest difference [N m]", "beyond 1e-6", "other status"]
    head += ["refused at 1e-8", "largest change in a tick [N m]"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    missed = 0
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        before = os.environ.get("HQP_ISA")
        os.environ["HQP_ISA"] = "generic"  # the other process begins with the first call and reads it
        kernel = pool.submit(instruction_set).result()
        if before is None:
            del os.environ["HQP_ISA"]
        else:
            os.environ["HQP_ISA"] = before
        for name in arguments.robots[:1] if arguments.quick else arguments.robots:
            for price in (None, 0.0):
                found = measure(name, price, ticks, arguments.every, pool)
                cells = [f"{name}, {'default' if price is None else '0'}"]
                cells.append(", ".join(f"{status} {count}" for status, count in found.statuses.most_common()))
                cells += [compared.cells() for compared in found.ways.values()]
                cells += [f"{found.refused} of {found.judged}", f"{found.step:.4g}"]
                lines.append("| " + " | ".join(cells) + " |")
                missed += found.refused + sum(s > ALLOWED for way in found.ways.values() for s in way.shares)
                print(lines[-1], flush=True)
    kernels = f"Instruction sets: {instruction_set()} and {kernel}.\n\n"
    text = (
        f"{kernels}{ticks} ticks of 2 ms a loop, a push of {KICK} rad/s and m/s each {PUSHED}.\n\n"
        + "\n".join(lines)
        + "\n"
    )
    report.section(arguments.output, "rounding", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    return int(missed > 0)
