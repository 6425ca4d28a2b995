"""One stack through many solvers: residuals level by level, certificate, differences and time, in one table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from time import perf_counter_ns, process_time_ns
from typing import Literal

import numpy as np

from hqp.arrays import Vec
from hqp.commands.threads import one_thread
from hqp.comparison.table import Comparison, Line
from hqp.declare.price import Priced
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot
from hqp.declare.stack import Stack
from hqp.errors import UnsupportedProblem
from hqp.loop.session import Controller, Session
from hqp.numbers import number, whole
from hqp.problem import Hierarchy, Rows, Solution, Status, has_inequalities
from hqp.problem.certify import certificate
from hqp.programs.formulation import Formulation, Velocity
from hqp.progress import tracked
from hqp.solvers import load, select
from hqp.solvers.base import Solver, Workspace

BUDGET_US = 2000.0
"""The period of a 500 Hz loop [us]."""

STATES, TICKS = 20, 10
"""States of a comparison, and ticks of the loop from one to the next."""

SPREAD = 0.05
"""Standard deviation of the drawn targets, as a motion of all joints and the base from home [rad, m]."""


def compare(
    stack: Stack,
    robot: Robot,
    *,
    states: Iterable[tuple[Vec, Vec]] | None = None,
    references: Sequence[Reference] = (),
    solvers: str | Sequence[str | Solver] = "all",
    formulation: Formulation | None = None,
    dt: float = 0.002,
    repeats: int = 5,
    price: Priced | Literal["both"] = 0,
) -> Comparison:
    """Solve equal copied problems with every solver, each with one warm workspace.

    states: (q, v) pairs, with hold values taken at home; by default 20 that a loop passes, which follows targets drawn
    around home while ``subject_to`` holds.  references: take the place of drawn targets.  solvers: names, Solver
    values, or "all" that are available.  repeats: solves per state.  A solver without inequalities gets the problem
    without them and is judged on the whole of it.  price: argument of Controller, 0 (every level exact) by default, so
    that all solvers have one solution; "both" solves exact and priced levels side by side, the latter by the solvers
    that can.  BLAS takes one thread meanwhile: matrices are too small for more.
    """
    dt = number("compare", "dt", dt, 0.0, strict=True)
    repeats = whole("compare", "repeats", repeats, 1)
    chosen = select(solvers)
    named = [(item, load(item)) if isinstance(item, str) else (item.name, item) for item in chosen]
    states = None if states is None else tuple(states)
    session, problems = _problems(
        stack, robot, states, references, formulation or Velocity(), dt, None if price == "both" else price
    )
    runs = [(named, problems)]
    if price == "both":
        able = [(f"{name}, priced", solver) for name, solver in named if solver.priced]
        runs = [(named, [p.exact() for p in problems]), (able, problems)]
    with one_thread():
        found = [_run_all(solving, given, repeats) for solving, given in runs]
    return Comparison(
        str(stack), robot.name, session.program.level_names, len(problems), len(problems) * repeats,
        found[0][0], tuple(line for _, lines in found for line in lines),
    )  # fmt: skip


def _run_all(named: Sequence[tuple[str, Solver]], problems: list[Hierarchy], repeats: int) -> tuple[str, list[Line]]:
    """The first solver whose every answer is certified, and a line a solver with its distance from that one."""
    runs = [
        (name, solver, *_run(name, solver, problems, repeats)) for name, solver in tracked(named, "comparing solvers")
    ]
    sound = [(name, x) for name, solver, line, x in runs if x is not None and solver.strict and line.certified == 1.0]
    if not sound:
        return "", [line for *_, line, _ in runs]
    best, there = sound[0]
    return best, [
        line if x is None else replace(line, difference=float(np.abs(x - there).max())) for *_, line, x in runs
    ]


def _problems(
    stack: Stack,
    robot: Robot,
    states: Iterable[tuple[Vec, Vec]] | None,
    references: Sequence[Reference],
    formulation: Formulation,
    dt: float,
    price: Priced,
) -> tuple[Session, list[Hierarchy]]:
    robot = robot.copy()
    if states is None:
        session = Controller(stack, formulation, deadline=math.inf, price=price).session(robot, dt)
        return session, list(_followed(session, references))
    session = Controller(stack, formulation, solver=_Copier(), price=price).session(robot, dt)
    session.step(robot.state())
    problems = []
    for q, v in states:
        session.step(robot.state(q, v), *references)
        problems.append(session.problem.copy())
    return session, problems


def _followed(session: Session, references: Sequence[Reference]) -> Iterator[Hierarchy]:
    """Problems of a loop that starts at home and follows targets drawn anew for each of them."""
    robot, rng = session.robot, np.random.default_rng(0)
    given = {reference.name for reference in references}
    targets = [e for level in session.controller.stack.levels for e in level if e.equality and not e.is_contact]
    q, v = robot.home, np.zeros(robot.nv)
    session.step(robot.state(q, v))
    for _ in range(STATES):
        there = robot.state(robot.integrate(robot.home, SPREAD * rng.standard_normal(robot.nv), 1.0))
        drawn = [element.hold(there) for element in targets if element.name not in given]
        for _ in range(TICKS):
            q, v = session.step(robot.state(q, v), *references, *drawn).advance()
        yield session.problem.copy()


def _run(name: str, solver: Solver, problems: list[Hierarchy], repeats: int) -> tuple[Line, Vec | None]:
    given, note = problems, ""
    shape = problems[0].shape
    if any(p.shape.inequalities for p in problems):
        shape = replace(shape, inequalities=True)
        if not solver.inequalities:
            given, note = [_without_inequalities(p) for p in problems], "inequalities left out"
            shape = given[0].shape
    try:
        workspace = solver.workspace(shape)
    except UnsupportedProblem as error:
        return _refused(name, solver, str(error)), None
    wall, cpu, solutions = _solve(workspace, given, repeats)
    points = np.array([s.x for s in solutions])
    certificates = [certificate(p, s.x, stages=s.stage_points) for p, s in zip(problems, solutions, strict=True)]
    status = Status.worst(*(s.status for s in solutions))
    line = Line(
        name,
        solver.strict,
        status.name,
        tuple(float(r) for r in np.max([c.norms for c in certificates], axis=0)),
        certificates[0].ranks[:-1],
        max(c.gap for c in certificates),
        sum(c.ok for c in certificates) / len(certificates),
        0.0,
        float(np.median(wall)),
        float(np.percentile(wall, 99)),
        float(np.max(wall)),
        float(np.median(cpu)),
        int(np.sum(wall > BUDGET_US)),
        note,
    )
    return line, points


def _refused(name: str, solver: Solver, note: str) -> Line:
    nan = float("nan")
    return Line(name, solver.strict, "refused", (), (), nan, 0.0, nan, nan, nan, nan, nan, 0, note)


def _solve(workspace: Workspace, problems: list[Hierarchy], repeats: int) -> tuple[Vec, Vec, list[Solution]]:
    wall, cpu = [], []
    workspace.solve(problems[0])

    def timed(problem: Hierarchy) -> Solution:
        start, start_cpu = perf_counter_ns(), process_time_ns()
        solution = workspace.solve(problem)
        cpu.append(process_time_ns() - start_cpu)
        wall.append(perf_counter_ns() - start)
        return solution

    solutions = [[timed(problem) for _ in range(max(1, repeats))][-1] for problem in problems]
    return np.array(wall) / 1e3, np.array(cpu) / 1e3, solutions


def _without_inequalities(problem: Hierarchy) -> Hierarchy:
    def free(rows: Rows) -> Rows:
        if not has_inequalities(rows):
            return rows
        lower, upper = (
            np.where(rows.equality, side, limit) for side, limit in ((rows.lower, -np.inf), (rows.upper, np.inf))
        )
        return Rows(rows.A, lower, upper)

    return replace(problem, levels=tuple(free(rows) for rows in problem.levels))


class _Copier(Solver):
    """Solves nothing: lets a session fill its problem, to be copied."""

    name = "copier"
    priced = True

    def workspace(self, shape: object) -> Workspace:
        return _CopierWorkspace()


class _CopierWorkspace:
    def solve(self, problem: Hierarchy) -> Solution:
        return Solution(np.zeros(problem.n), Status.OPTIMAL, problem.slacks(np.zeros(problem.n)), ())

    def reset(self) -> None:
        """Nothing is kept."""
