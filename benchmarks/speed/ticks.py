"""One solver in the lab's loop for many ticks, every tick timed and split; the paper's stack on a figure 8."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.mistry2008 import loop
from hqp import Stack, Velocity, solvers
from hqp.arrays import Vec
from hqp.lab import Trajectory
from hqp.lab.measures import PARTS
from hqp.lab.run import Run
from hqp.lab.run import run as run_loop
from hqp.programs.formulation import Formulation
from hqp.robots import Robot
from hqp.solvers.base import Solver
from hqp.tasks import Com, Position
from tests.scenes.mistry2008 import HZ, paper_stack, roles

JUDGED = 100
"""Ticks between two certificates, outside the timed part: a fast wrong answer must not look good."""


PATIENCE = 4.0
"""Time after which a slow solver's run ends [s]."""


@dataclass(frozen=True)
class Ticks:
    """A run of the lab; hand_rms: error of the hand, which shows that the solver did the work [m]."""

    robot: str
    stack: str
    solver: str
    run: Run
    hand_rms: float

    @property
    def wall(self) -> Vec:
        """Times of ticks ``(T,)`` [us], references included."""
        return self.run.total

    @property
    def median(self) -> float:
        """Median time of a tick [us]."""
        return float(np.median(self.wall))

    @property
    def unsolved(self) -> int:
        """Number of ticks without an optimal status."""
        return self.run.unsolved

    @property
    def gap(self) -> float:
        """Largest certificate gap of every JUDGED-th tick."""
        return float(self.run.gaps.max(initial=0.0))

    @property
    def without_solve(self) -> float:
        """Median of everything but the solve [us]."""
        return float(np.median(self.wall - self.run.times[:, PARTS.index("solve")]))

    @property
    def misses(self) -> int:
        """Ticks longer than the control period."""
        return int(np.sum(self.wall > 1e6 * self.run.dt))

    def record(self) -> dict[str, object]:
        """The run as plain numbers."""
        return {
            "robot": self.robot,
            "stack": self.stack,
            "solver": self.solver,
            "ticks": int(self.wall.size),
            "wall_us": spread(self.wall),
            "cpu_us": spread(self.run.cpu),
            "split_us": dict(zip(PARTS, np.median(self.run.times, axis=0).tolist(), strict=True)),
            "floor_us": float(np.median(self.run.floor)),
            "misses": self.misses,
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
    """Pinocchio's calls that the stack needs at a configuration, alone, on separate data."""
    model, data = robot.model, robot.model.createData()

    def call(q: Vec) -> None:
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        pin.jacobianCenterOfMass(model, data, False)

    return call


Goals = Callable[[float], Mapping[str, Any]]
"""Targets at a time [s], as a Trajectory of the lab takes them."""


def paper(robot: Robot, name: str, solver: Solver, ticks: int) -> Ticks:
    """CoG side to side and hand on a figure-8 under joint limits."""
    stack = paper_stack(roles(robot), limits=True)
    com, hand = stack.find("com_xy", Com), stack.find("hand", Position)
    home = robot.state()
    com_0, hand_0 = com.value(home), hand.value(home)

    def goals(t: float) -> Mapping[str, Any]:
        later = t + 1.0 / HZ
        goal, aim = com_0 + loop.side_to_side(t), hand_0 + loop.figure_eight(t)
        rate, speed = HZ * (com_0 + loop.side_to_side(later) - goal), HZ * (hand_0 + loop.figure_eight(later) - aim)
        return {com.name: (goal, rate), hand.name: (aim, speed)}

    return measure(robot, stack, goals, hand, Velocity(), name, solver, ticks, 1.0 / HZ, bare_calls(robot))


def measure(
    robot: Robot, stack: Stack, goals: Goals, hand: Position, formulation: Formulation, name: str, solver: Solver,
    ticks: int, dt: float, bare: Callable[[Vec], None] | None = None,
) -> Ticks:  # fmt: skip
    """Run a loop with exact integration of each command; a solver without inequalities gets none."""
    if not solver.inequalities:
        name, solver = f"{name} (limits ignored)", solvers.load(name, ignore_inequalities=True)
    found = run_loop(
        stack, robot, solver, name, formulation, Trajectory(goals, stack, robot, ticks * dt),
        dt=dt, ticks=ticks, plant="integrator", certify_every=JUDGED, progress=lambda done: None,
        bare=bare, patience=PATIENCE,
    )  # fmt: skip
    off = found.behaviour.errors[:, found.behaviour.tracked.index(hand.name)]
    return Ticks(robot.name, str(stack), name, found, float(np.sqrt(np.mean(np.square(off)))))
