"""One solver in the loop for many ticks: every tick timed from state to command, and split."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter_ns, process_time_ns

import numpy as np
import pinocchio as pin

import hqp
from benchmarks.mistry2008 import loop
from benchmarks.mistry2008.stack import HZ, paper_stack, roles
from hqp.arrays import Vec
from hqp.robots import Robot
from hqp.solvers.base import Solver
from hqp.tasks import Com, Position

BUDGET_US = 1e6 / HZ
"""The control period [us]."""

WARM_UP = 50
"""Ticks before the first that counts."""

JUDGED = 100
"""Every so many ticks the answer is judged, outside the timed part: a fast wrong answer must not look good."""

PARTS = ("state", "assemble", "solve", "command")


@dataclass(frozen=True)
class Ticks:
    """Times ``(T,)`` [us] of one run; floor: the bare Pinocchio calls of the same stack at the same states.

    parts: ``(T, 4)`` as PARTS; the first holds ``robot.state`` and the kinematics, the second the references too.
    unsolved: ticks whose status is no optimum.  hand_rms [m]: that the work was done.  gap: the largest of the
    certificates of every JUDGED-th tick.
    """

    robot: str
    stack: str
    solver: str
    wall: Vec
    cpu: Vec
    parts: Vec
    floor: Vec
    unsolved: int
    hand_rms: float
    gap: float

    @property
    def without_solve(self) -> float:
        """Median of state + references + assemble + command [us]."""
        return float(np.median(self.wall - self.parts[:, PARTS.index("solve")]))

    @property
    def misses(self) -> int:
        """Ticks longer than the control period."""
        return int(np.sum(self.wall > BUDGET_US))

    def record(self) -> dict[str, object]:
        """The run as plain numbers."""
        return {
            "robot": self.robot,
            "stack": self.stack,
            "solver": self.solver,
            "ticks": int(self.wall.size),
            "wall_us": spread(self.wall),
            "cpu_us": spread(self.cpu),
            "split_us": dict(zip(PARTS, np.median(self.parts, axis=0).tolist(), strict=True)),
            "floor_us": float(np.median(self.floor)),
            "misses_2ms": self.misses,
            "without_solve_us": self.without_solve,
            "unsolved": self.unsolved,
            "hand_rms_mm": 1e3 * self.hand_rms,
            "gap": self.gap,
        }


def spread(values: Vec) -> dict[str, float]:
    """Median, 99th percentile and maximum."""
    return {
        "median": float(np.median(values)),
        "p99": float(np.percentile(values, 99.0)),
        "max": float(values.max()),
    }


def bare_calls(robot: Robot) -> Callable[[Vec], None]:
    """What the stack needs of Pinocchio at a configuration, on data of its own, and nothing else."""
    model, data = robot.model, robot.model.createData()

    def call(q: Vec) -> None:
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        pin.jacobianCenterOfMass(model, data, False)

    return call


def run(robot: Robot, name: str, solver: Solver, ticks: int) -> Ticks:
    """CoG side to side and hand on a figure-8 under joint limits, the command carried out exactly between ticks."""
    stack = paper_stack(roles(robot), limits=True)
    com, hand = stack.find("com_xy", Com), stack.find("hand", Position)
    session = hqp.Controller(stack, solver=solver).session(robot, dt=1.0 / HZ)
    floor_calls = bare_calls(robot)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    state = robot.state(q, v)
    com_0, hand_0 = com.value(state), hand.value(state)
    wall, cpu, floor, parts = (np.zeros(ticks), np.zeros(ticks), np.zeros(ticks), np.zeros((ticks, 4)))
    unsolved, square, gap = 0, 0.0, 0.0
    gc.collect()
    gc.disable()
    try:
        for i in range(-WARM_UP, ticks):
            t, later = max(i, 0) / HZ, max(i + 1, 0) / HZ
            goal, aim = com_0 + loop.side_to_side(t), hand_0 + loop.figure_eight(t)
            rate, speed = HZ * (com_0 + loop.side_to_side(later) - goal), HZ * (hand_0 + loop.figure_eight(later) - aim)
            cpu_start, start = process_time_ns(), perf_counter_ns()
            state = robot.state(q, v)
            made = perf_counter_ns()
            references = com.at(goal, velocity=rate), hand.at(aim, velocity=speed)
            referred = perf_counter_ns()
            tick = session.step(state, *references)
            end, cpu_end = perf_counter_ns(), process_time_ns()
            square += float(np.sum((state.position(hand.frame) - aim) ** 2)) if i >= 0 else 0.0
            q, v = tick.advance()
            floor_start = perf_counter_ns()
            floor_calls(q)
            floor_end = perf_counter_ns()
            if i < 0:
                continue
            wall[i], cpu[i], floor[i] = end - start, cpu_end - cpu_start, floor_end - floor_start
            times = tick.times
            if times is not None:
                parts[i] = times.state, times.assemble, times.solve, times.command
            parts[i] *= 1e9
            parts[i, 0] += made - start
            parts[i, 1] += referred - made
            unsolved += int(not tick.status.solved)
            if i % JUDGED == JUDGED - 1 and tick.solution is not None:
                gap = max(gap, hqp.certificate(session.problem, tick.solution.x).gap)
    finally:
        gc.enable()
    rms = float(np.sqrt(square / ticks))
    return Ticks(
        robot.name, str(stack), name, wall / 1e3, cpu / 1e3, parts / 1e3, floor / 1e3, unsolved, rms, gap
    )  # fmt: skip
