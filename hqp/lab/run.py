"""One closed loop of one solver, with everything that is measured of it tick by tick."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter_ns, process_time_ns
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.stack import Stack
from hqp.loop.session import Controller
from hqp.problem import Status
from hqp.problem.certify import certificate
from hqp.programs.formulation import Formulation
from hqp.solvers.base import Solver

from .behaviour import Behaviour, behaviour
from .plants import plant as make_plant
from .trajectory import Trajectory

WARM_UP = 50
"""Ticks at home before the clock starts."""


@dataclass(frozen=True)
class Run:
    """Every tick of one solver.

    times ``(k, 4)``: state, assemble, solve, command [us]; total ``(k,)``: the whole step [us].  floor ``(k,)``: a bare
    kinematics call of the same tick [us].  cpu ``(k,)``: processor time of the step [us].  residuals ``(k, levels)``.
    commands ``(k, n_actuated)``.  gaps: largest certificate gap of judged ticks ``(j,)``, certified: one flag per
    judged tick.  unsolved: ticks whose status is not solved.  behaviour: behaviour of the robot, rates: its velocities
    ``(k, nv)``.
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
    cpu: Vec
    unsolved: int
    behaviour: Behaviour
    rates: Mat


def run(
    stack: Stack,
    robot: Any,
    solver: Solver,
    name: str,
    formulation: Formulation,
    trajectory: Trajectory,
    *,
    dt: float,
    ticks: int,
    plant: str,
    certify_every: int,
    progress: Callable[[int], None],
    price: Any = None,
    bare: Callable[[Vec], None] | None = None,
    patience: float = math.inf,
) -> Run:
    """Run the loop; raises the errors of ``Controller.session``.  progress: called with the number of ticks done.

    price: argument of Controller.  bare: reference computation of the floor at a configuration, the state's kinematics
    by default.  No tick is cut short: one over the period is counted.  patience: after so long the loop ends with fewer
    ticks [s].
    """
    robot = robot.copy()
    session = Controller(stack, formulation, solver, price=price, deadline=math.inf).session(robot, dt)
    world = make_plant(plant, session)
    for _ in range(WARM_UP):
        session.step(robot.state(*world.state()))
    levels = session.program.level_names
    times, total, floor = np.zeros((ticks, 4)), np.zeros(ticks), np.zeros(ticks)
    residuals, commands = np.zeros((ticks, len(levels))), np.zeros((ticks, len(robot.joint_names)))
    cpu, unsolved = np.zeros(ticks), 0
    places, rates = np.zeros((ticks, robot.nq)), np.zeros((ticks, robot.nv))
    statuses: list[str] = []
    gaps: list[float] = []
    certified: list[bool] = []
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    done, start = 0, perf_counter_ns()
    try:
        for k in range(ticks):
            q, v = world.state()
            values = trajectory.values(k * dt)
            places[k], rates[k] = q, v
            begin = perf_counter_ns()
            if bare is None:
                robot.state(q, v).kinematics()
            else:
                bare(q)
            floor[k] = perf_counter_ns() - begin
            spent, begin = process_time_ns(), perf_counter_ns()
            tick = session.step(robot.state(q, v), *trajectory.references(values))
            total[k] = perf_counter_ns() - begin
            cpu[k] = process_time_ns() - spent
            if tick.times is not None:
                times[k] = (tick.times.state, tick.times.assemble, tick.times.solve, tick.times.command)
            statuses.append(tick.status.name)
            unsolved += not tick.status.solved
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
            done = k + 1
            if perf_counter_ns() - start > 1e9 * patience:
                break
            if k % 100 == 0:
                progress(k)
    finally:
        if enabled:
            gc.enable()
    progress(ticks)
    kept = slice(0, done)
    return Run(
        name, solver.strict, dt, levels, 1e6 * times[kept], 1e-3 * total[kept], 1e-3 * floor[kept], tuple(statuses),
        residuals[kept], commands[kept], np.array(gaps), tuple(certified), 1e-3 * cpu[kept], unsolved,
        behaviour(robot, stack, trajectory, places[kept], rates[kept], dt), rates[kept],
    )  # fmt: skip


def worst(statuses: tuple[str, ...]) -> str:
    """The worst of some statuses by name."""
    return Status.worst(*(Status[s] for s in set(statuses))).name
