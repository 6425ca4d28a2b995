"""One closed loop of one solver, with everything that is measured of it tick by tick."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.certify import certificate
from hqp.formulation import Formulation
from hqp.problem import Hierarchy, Status
from hqp.reference import Reference
from hqp.session import Controller
from hqp.solvers.base import Solver
from hqp.stack import Stack

from .plants import plant as make_plant

WARM_UP = 50
"""Ticks at home before the clock starts."""


@dataclass(frozen=True)
class Run:
    """Every tick of one solver.

    times ``(k, 4)``: state, assemble, solve, command [us]; total ``(k,)``: the whole step [us].  floor ``(k,)``: a bare
    kinematics call of the same tick [us].  residuals ``(k, levels)``.  commands ``(k, n_actuated)``.
    gaps: largest certificate gap of judged ticks ``(j,)``, certified: whether each passed.
    """

    solver: str
    strict: bool
    dt: float
    levels: tuple[str, ...]
    times: Mat
    total: Vec
    floor: Vec
    statuses: tuple[str, ...]
    residuals: Mat
    commands: Mat
    gaps: Vec
    certified: tuple[bool, ...]


def run(
    stack: Stack,
    robot: Any,
    solver: Solver,
    name: str,
    formulation: Formulation,
    trajectory: Callable[[float], tuple[Reference, ...]],
    *,
    dt: float,
    ticks: int,
    plant: str,
    certify_every: int,
    told: Callable[[int], None],
) -> Run:
    """Run the loop; raises what ``Controller.session`` raises.  told: called with the number of ticks done."""
    robot = robot.copy()
    session = Controller(stack, formulation, solver).session(robot, dt)
    world = make_plant(plant, session)
    for _ in range(WARM_UP):
        session.step(robot.state(*world.state()))
    levels = level_names(session)
    times, total, floor = np.zeros((ticks, 4)), np.zeros(ticks), np.zeros(ticks)
    residuals, commands = np.zeros((ticks, len(levels))), np.zeros((ticks, len(robot.joint_names)))
    statuses: list[str] = []
    gaps: list[float] = []
    certified: list[bool] = []
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        for k in range(ticks):
            q, v = world.state()
            references = trajectory(k * dt)
            begin = perf_counter_ns()
            robot.state(q, v).kinematics()
            floor[k] = perf_counter_ns() - begin
            begin = perf_counter_ns()
            tick = session.step(robot.state(q, v), *references)
            total[k] = perf_counter_ns() - begin
            if tick.times is not None:
                times[k] = (tick.times.state, tick.times.assemble, tick.times.solve, tick.times.command)
            statuses.append(tick.status.name)
            commands[k] = tick.command
            if tick.solution is not None:
                residuals[k] = [float(np.sqrt(w @ w)) for w in tick.solution.residuals]
                if k % certify_every == 0:
                    verdict = certificate(
                        session.problem, tick.solution.x, stages=tick.solution.stage_points, settled=True
                    )
                    gaps.append(float(verdict.gap))
                    certified.append(bool(verdict.ok))
            else:
                residuals[k] = np.nan
            world.carry_out(tick)
            if k % 100 == 0:
                told(k)
    finally:
        if enabled:
            gc.enable()
    told(ticks)
    return Run(
        name, solver.strict, dt, levels, 1e6 * times, 1e-3 * total, 1e-3 * floor, tuple(statuses), residuals,
        commands, np.array(gaps), tuple(certified),
    )  # fmt: skip


def level_names(session: Any) -> tuple[str, ...]:
    """A name for each level of the compiled hierarchy."""
    problem: Hierarchy = session.problem
    found: dict[int, str] = {}
    for place in session.program.places.values():
        found.setdefault(place.level, place.declared)
    names = [found.get(k, f"level {k}") for k in range(len(problem.levels))]
    seen: Counter[str] = Counter()
    unique = []
    for name in names:
        seen[name] += 1
        unique.append(name if names.count(name) == 1 else f"{name} {seen[name]}")
    return tuple(unique)


def worst(statuses: tuple[str, ...]) -> str:
    """The worst of some statuses by name."""
    return Status.worst(*(Status[s] for s in set(statuses))).name
