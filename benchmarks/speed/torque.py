"""Torque ticks at 1 kHz through every solver: Dreamer on its wheels, Talos in double support, split into parts."""

from __future__ import annotations

import argparse
import gc
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter_ns

import numpy as np

import hqp
from benchmarks.reports import report, solver_sets
from benchmarks.reports.checks import write_json
from benchmarks.sentis2012 import stack as sentis2012
from benchmarks.speed.ticks import PATIENCE, spread
from hqp import PD, Level, Stack, native, robots, solvers
from hqp.arrays import Vec
from hqp.reference import Reference
from hqp.robot import State
from hqp.robots import Robot
from hqp.tasks import (
    CenterOfPressure,
    Com,
    FixedContact,
    FrictionCone,
    Orientation,
    Position,
    Posture,
    TorqueLimits,
)
from hqp.torque.program import TorqueProgram

GOALS_US = {"dreamer": 200.0, "talos": 400.0}
"""To reach with the native solver, median of the whole tick."""

BUDGETS_US = (1000.0, 2000.0)
"""Control periods of 1 kHz and 500 Hz."""

WARM_UP, JUDGED = 50, 100

GAP = 1e-6
"""Certificate gap that a solved tick of a strict solver must keep."""

PARTS = ("state", "assemble", "of it dynamics", "solve", "command")

Guide = Callable[[State, float], list[Reference]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--ticks", type=int, default=None, metavar="N", help="ticks a solver, default 2000")
    parser.add_argument("--solvers", nargs="+", default=None, metavar="NAME", help="default: all available")


def run(arguments: argparse.Namespace) -> int:
    """Measure, show, write; 1 where a solved answer was wrong.  Times depend on the machine and fail nothing."""
    count = arguments.ticks or (200 if arguments.quick else 2000)
    names = arguments.solvers or list(solver_sets.every())
    runs: list[Ticks] = []
    with report.bar() as bar:
        task = bar.add_task("torque", total=2 * len(names))
        for robot, stack, guide in (dreamer(), talos()):
            for name in names:
                bar.update(task, description=f"torque {name} on {robot.name}")
                solver = solvers.load(name)
                if solver.metric:
                    runs.append(measure(robot, stack, guide, name, count))
                bar.advance(task)
    records = [r.record() for r in runs]
    if arguments.json is not None:
        write_json(arguments.json, records)
    text, goals = report.table(HEADER, map(_cells, records)), report.table(GOAL_HEADER, _goals(runs))
    report.console.print(text, markup=False, soft_wrap=True)
    report.console.print(goals, markup=False, soft_wrap=True)
    report.section(
        arguments.output,
        "torque",
        f"{count} ticks of 1 kHz, one BLAS thread, garbage collection off, "
        f"{native.describe()}. Times in us, medians where not "
        "said otherwise. The state holds kinematics, inertia, bias forces and drifts; *of it dynamics* is the "
        "elimination of the constraint forces, timed by itself after the tick. *gap*: largest certificate gap of every "
        f"{JUDGED}th tick. Solvers marked (limits ignored) take no inequalities: they do less.",
        *(f"{r.name}: `{stack}`" for r, stack, _ in (dreamer(), talos())),
        text,
        goals,
    )
    return report.conclude(
        arguments.output,
        "torque",
        [*_summary(runs), *report.goals_of(_goals(runs))],
        [
            f"{r.solver} on {r.robot}: every tick solved, but the certificate's gap is {r.gap:.1e}"
            for r in runs
            if not r.unsolved and not r.gap <= GAP
        ],
    )


def _summary(runs: list[Ticks]) -> Iterator[str]:
    """A line a robot: median ticks of every solver, the fastest first."""
    for robot in dict.fromkeys(r.robot for r in runs):
        mine = sorted((r for r in runs if r.robot == robot), key=lambda r: float(np.median(r.wall)))
        yield f"{robot}, median us: " + ", ".join(f"{r.solver} {np.median(r.wall):.0f}" for r in mine)


def dreamer() -> tuple[Robot, Stack, Guide]:
    """Eqs. (48) to (59): balance, hand, posture, goals that move with the base."""
    robot = robots.load("dreamer")
    law = PD(400.0, 40.0, max_acceleration=2.5)
    com, hand = replace(sentis2012.COM, law=law), sentis2012.HAND
    stack = sentis2012.paper_stack([TorqueLimits()], com=com)
    at_home = robot.state()
    centre, place = com.value(at_home), hand.value(at_home)
    normal = np.array([0.0, 0.0, 1.0])

    def guide(state: State, t: float) -> list[Reference]:
        reach = 0.05 * np.array([np.sin(3.0 * t), np.cos(3.0 * t) - 1.0, np.sin(2.0 * t)])
        return [com.at(centre), hand.at(place + reach), *(w.at(normal=normal) for w in sentis2012.CONTACTS)]

    return robot, stack, guide


def talos() -> tuple[Robot, Stack, Guide]:
    """Both feet with friction and centre of pressure; CoM, hand and pelvis, posture; torque limits."""
    robot = robots.load("talos")
    soles, palm, base = robot.landmarks["soles"], robot.landmarks["palms"][0], robot.landmarks["base"][0]
    com, hand = Com(name="com", law=PD(50.0)), Position(frame=palm, law=PD(80.0))
    limits = [TorqueLimits()]
    for sole in soles:
        rectangle = (-0.1, 0.1, -0.05, 0.05)
        limits += [FrictionCone(contact=sole, mu=0.6), CenterOfPressure(contact=sole, rectangle=rectangle)]
    stack = Stack(
        Level(com, name="balance"),
        Level(hand, Orientation(frame=base, law=PD(50.0)), name="hand and pelvis"),
        Level(Posture(law=PD(30.0)), name="posture"),
        subject_to=[*(FixedContact(frame=s) for s in soles), *limits],
    )
    at_home = robot.state()
    centre, place = com.value(at_home), hand.value(at_home)

    def guide(state: State, t: float) -> list[Reference]:
        sway = np.array([0.0, 0.03 * np.sin(1.5 * t), 0.0])
        reach = 0.05 * np.array([np.sin(3.0 * t), 0.0, np.cos(3.0 * t) - 1.0])
        return [com.at(centre + sway), hand.at(place + reach)]

    return robot, stack, guide


@dataclass(frozen=True)
class Ticks:
    """Times ``(T,)`` [us] of one run and their parts ``(T, 5)`` as PARTS."""

    robot: str
    solver: str
    wall: Vec
    parts: Vec
    unsolved: int
    gap: float

    def record(self) -> dict[str, object]:
        """The run as plain numbers."""
        return {
            "robot": self.robot,
            "solver": self.solver,
            "ticks": int(self.wall.size),
            "wall_us": spread(self.wall),
            "split_us": dict(zip(PARTS, np.median(self.parts, axis=0).tolist(), strict=True)),
            "misses": {f"{budget:g}": int(np.sum(self.wall > budget)) for budget in BUDGETS_US},
            "unsolved": self.unsolved,
            "gap": self.gap,
        }


def measure(robot: Robot, stack: Stack, guide: Guide, name: str, count: int) -> Ticks:
    """From state to command, the torque carried out exactly between ticks."""
    solver = solvers.load(name)
    if not solver.inequalities:
        name, solver = f"{name} (limits ignored)", solvers.load(name, ignore_inequalities=True)
    session = hqp.Controller(stack, hqp.Torque(), solver=solver, deadline=math.inf).session(robot, dt=0.001)
    program = session.program
    if not isinstance(program, TorqueProgram):
        raise TypeError("the session was not compiled for torques")
    q, v = robot.home.copy(), np.zeros(robot.nv)
    wall, parts = np.zeros(count), np.zeros((count, len(PARTS)))
    unsolved, gap, done, began = 0, 0.0, 0, perf_counter_ns()
    gc.collect()
    gc.disable()
    try:
        for i in range(-WARM_UP, count):
            given = guide(robot.state(q, v), 0.001 * max(i, 0))
            start = perf_counter_ns()
            state = robot.state(q, v)
            made = perf_counter_ns()
            tick = session.step(state, *given)
            end = perf_counter_ns()
            m, rows = program.dynamics.m, program.assembly
            again = perf_counter_ns()
            program.dynamics.update(state.inertia(), state.bias_force(), rows.J[:m], rows.lower[:m])
            eliminated = perf_counter_ns() - again
            q, v = tick.advance()
            times = tick.times
            if i < 0 or times is None:
                continue
            wall[i], done = end - start, i + 1
            split = np.array((times.state, times.assemble, 0.0, times.solve, times.command)) * 1e9
            split[0] += made - start
            split[2] = eliminated
            parts[i] = split
            unsolved += tick.status is not hqp.Status.OPTIMAL
            if i % JUDGED == 0 and tick.solution is not None and solver.strict:
                gap = max(gap, float(np.max(hqp.certificate(session.problem, tick.solution.x).gaps)))
            if end - began > 1e9 * PATIENCE:
                break
    finally:
        gc.enable()
    return Ticks(robot.name, name, wall[:done] / 1e3, parts[:done] / 1e3, unsolved, gap)


HEADER = ("robot", "solver", "median", "p99", "max", *PARTS, "over 1 ms", "over 2 ms", "unsolved", "gap")


def _cells(record: dict[str, object]) -> tuple[str, ...]:
    wall, split, misses = (dict(record[key]) for key in ("wall_us", "split_us", "misses"))  # type: ignore[call-overload]
    return (
        str(record["robot"]), str(record["solver"]), *(f"{wall[key]:.0f}" for key in ("median", "p99", "max")),
        *(f"{split[part]:.1f}" for part in PARTS),
        *(f"{misses[f'{budget:g}']}/{record['ticks']}" for budget in BUDGETS_US), str(record["unsolved"]),
        f"{record['gap']:.0e}",
    )  # fmt: skip


GOAL_HEADER = ("", "goal", "measured", "outcome")


def _goals(runs: Sequence[Ticks]) -> list[tuple[str, str, str, str]]:
    """The goals with what was measured, misses as misses."""
    found = []
    for r in runs:
        if r.solver == "lexicographic":
            median, goal = float(np.median(r.wall)), GOALS_US[r.robot]
            outcome = "reached" if median <= goal else "MISSED"
            found.append(
                (f"whole torque tick on {r.robot} (lexicographic)", f"{goal:g} us", f"{median:.0f} us", outcome)
            )
    return found
