"""The paper's stack through every solver: equal if no limit is active, strict and certified if some are."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

import hqp
from benchmarks.mistry2008.equations.algebra import largest
from benchmarks.mistry2008.equations.theorems import alone, asked
from benchmarks.reports import report, solver_sets
from benchmarks.reports.checks import Check, at_most, exactly, seen_to_fail, write_json
from hqp import robots, solvers
from hqp.arrays import Vec
from hqp.problem import Hierarchy, Solution
from hqp.robots import Robot
from hqp.solvers.base import Solver
from hqp.tasks import Com, Position
from tests.scenes.mistry2008 import HZ, near_home, paper_stack, roles

ROBOTS = ("cbi", "talos")

CRITICAL, HAND = 1, 2
"""Places of the levels in a problem whose first level is the joint limits."""

REFERENCE = "lexicographic"
"""Solver of the reference residuals; the certificate alone judges it."""

GENTLE, HARD = (0.005, 0.02), (0.04, 1.0)
"""Distances of the targets of CoM and hand [m]: within the limits, and far outside them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--states", type=int, default=None, metavar="N", help="states a robot, default 50")
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), metavar="NAME", help="default: cbi talos")


def run(arguments: argparse.Namespace) -> int:
    """Check, show, write; returns 1 if a check fails."""
    count = arguments.states or (8 if arguments.quick else 50)
    checks: list[Check] = []
    tables: list[str] = []
    with report.bar() as bar:
        task = bar.add_task("compare", total=2 * len(arguments.robots))
        for name in arguments.robots:
            robot = robots.load(name)
            bar.update(task, description=f"compare on {name}, every solver")
            checks += agreement(robot, count) + under_limits(robot, count)
            bar.advance(task)
            bar.update(task, description=f"compare on {name}, table")
            table = hqp.compare(
                paper_stack(roles(robot), limits=True), robot, solvers=list(solver_sets.every()), repeats=3
            )
            tables.append(table.markdown())
            bar.advance(task)
    report.show(checks)
    if arguments.json is not None:
        write_json(arguments.json, checks)
    body = report.table(report.HEADER, map(report.cells, checks))
    report.section(arguments.output, "compare", f"{report.tally(checks)}; {count} states.", body, *tables)
    return report.conclude(arguments.output, "compare", [report.tally(checks)], report.failures_of(checks))


@dataclass(frozen=True)
class Case:
    """A copied problem with joint limits as level 0, and the recursive projector's answer that ignores them."""

    problem: Hierarchy
    projector: Solution

    @property
    def inside(self) -> bool:
        """Return true if the projector's answer keeps all limits."""
        return self.projector.status.solved


def cases(robot: Robot, count: int, away: tuple[float, float], seed: int) -> list[Case]:
    """Problems of the paper's stack with joint limits, near home, targets of CoM and hand up to ``away`` [m] off."""
    rng = np.random.default_rng([seed, robot.nv])
    stack = paper_stack(roles(robot), limits=True)
    com, hand = stack.find("com_xy", Com), stack.find("hand", Position)
    session = hqp.Controller(stack, solver="lexicographic", price=0).session(robot, dt=1.0 / HZ)
    session.step(robot.state())
    projector = solvers.load("nullspace", ignore_inequalities=True)
    found = []
    for _ in range(count):
        q = near_home(robot, rng, 0.1)
        state = robot.state(q)
        goal = com.value(state) + away[0] * rng.uniform(-1.0, 1.0, 2)
        aim = hand.value(state) + away[1] * rng.uniform(-1.0, 1.0, 3)
        feet = [
            stack.find(name).at(stack.find(name).value(state))  # type: ignore[attr-defined]
            for name in ("l_sole", "r_sole")
        ]
        session.step(state, com.at(goal), hand.at(aim), *feet)
        problem = session.problem.copy()
        found.append(Case(problem, projector.solve(problem)))
    return found


def agreement(robot: Robot, count: int) -> list[Check]:
    """No limit active: every strict solver gives the projector's answer; (16) never beats it at level B."""
    inside = [case for case in cases(robot, count, GENTLE, 1) if case.inside]
    checks = [
        exactly("no active limit", "states among those drawn: none would be a test of nothing", robot.name, 0,
                [int(not inside)], f"{len(inside)} of {count} states")
    ]  # fmt: skip
    for name, solver in solver_sets.bounded().items():
        errors = []
        for case in inside:
            answer = solver.solve(case.problem)
            errors.append(_error(answer.x, case.projector.x) if asked(solver, answer) else np.nan)
        text = f"`{name}` = `nullspace`, relative"
        note = _by_itself(solver, inside[: max(3, count // 5)])
        checks.append(at_most("no active limit", text, robot.name, 1e-9, errors, note))
    printed = solvers.load("chiaverini", ignore_inequalities=True)
    same, better = [], 0
    for case in inside:
        ours, theirs = case.projector.norms, printed.solve(case.problem).norms
        same.append(abs(ours[CRITICAL] - theirs[CRITICAL]))
        better += int(theirs[HAND] < ours[HAND] - 1e-11 * (1.0 + ours[HAND]))
    checks.append(at_most("eq. (16)", "critical residual of `chiaverini` - HQP's", robot.name, 1e-11, same))
    text = "states where `chiaverini` has a smaller second-level residual"
    checks.append(exactly("eq. (16)", text, robot.name, 0, [better]))
    return checks


def under_limits(robot: Robot, count: int) -> list[Check]:
    """Limits active: they hold, the certificate passes, and all agree level by level; baselines are seen to fail."""
    beyond = [case for case in cases(robot, count, HARD, 2) if not case.inside]
    name = robot.name
    checks = [
        exactly("limits active", "states among those drawn: none would be a test of nothing", name, 0,
                [int(not beyond)], f"{len(beyond)} of {count} states")
    ]  # fmt: skip
    reference = solvers.load(REFERENCE)
    best = [reference.solve(case.problem) for case in beyond]
    for key, solver in solver_sets.bounded().items():
        gaps, violation, levels, silent, unsolved = [], [], [], 0, 0
        for case, other in zip(beyond, best, strict=True):
            answer = solver.solve(case.problem)
            verdict = hqp.certificate(case.problem, answer.x)
            silent += int(answer.status.solved and not verdict.ok)
            if not answer.status.solved:
                unsolved += 1
                continue
            gaps.append(verdict.gap)
            violation.append(largest(answer.residuals[0]))
            levels.append(largest(answer.norms - other.norms) / (1.0 + largest(other.norms)))
        note = f"{unsolved} of {len(beyond)} not solved, by status" if unsolved else _by_itself(solver, beyond[:5])
        checks += [
            exactly("limits active", f"`{key}`: answers called solved that the certificate refuses", name, 0, [silent]),
            at_most("limits active", f"`{key}`: certificate gap", name, 1e-6, gaps, note),
            at_most("limits active", f"`{key}`: limits exceeded by [rad/s]", name, 1e-9, violation),
        ]
        if key != REFERENCE:
            text = f"`{key}`: residual of each level against `{REFERENCE}`"
            checks.append(at_most("limits active", text, name, 1e-8, levels))
    moved = [largest(w) for case in beyond for w in case.projector.residuals[:1]]
    checks.append(seen_to_fail("limits active", "`nullspace` keeps limits it cannot see [rad/s]", name, 1e-9, moved))
    weighted = solvers.load("weighted")
    lost = [float(weighted.solve(case.problem).norms[CRITICAL]) for case in beyond]
    text = "`weighted` keeps the critical level: its residual"
    checks.append(seen_to_fail("limits active", text, name, 1e-9, lost, "strict solvers: see above"))
    return checks


def _error(x: Vec, reference: Vec) -> float:
    return largest(x - reference) / (1.0 + largest(reference))


def _by_itself(solver: Solver, some: list[Case]) -> str:
    """Gap of a wrapped back end without our refinement, in words; it is reported, not judged."""
    bare = alone(solver)
    if bare is None or not some:
        return ""
    answers = [(bare.solve(case.problem), case) for case in some]
    gap = max(hqp.certificate(case.problem, answer.x).gap for answer, case in answers)
    certified = sum(answer.status.solved for answer, _ in answers)
    return f"refined by our recursion; back end alone: gap {gap:.1e}, certified {certified} of {len(answers)}"
