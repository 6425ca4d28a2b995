"""Torque ticks with conflicting constraints: feet must bear more than the weight, kicks, distant hand targets."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from time import perf_counter, thread_time

import numpy as np

import hqp
from hqp import Stack, Status
from hqp.commands.arguments import formulation
from hqp.problem import Motion
from hqp.robots import Robot
from hqp.tasks import Com, Position, UnilateralContact
from hqp.tolerances import VIOLATION_TOLERANCE
from tests.scenes.changes import DT, stack

RETURN = 50
"""Ticks in which a command goes back to answers after a held one: it may be worse than the held one by then."""


@dataclass
class Record:
    """Record of a loop: wall and CPU time of its violated ticks [s], their statuses, and the count of worse answers."""

    robot: str
    deadline: str
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    statuses: Counter[str] = field(default_factory=Counter)
    worse: int = 0


def overloaded(robot: Robot) -> Stack:
    """The stack of ``changes`` with a minimum load of 0.6 times the robot's weight on each foot."""
    whole = stack(robot, "torque")
    weight = float(robot.state().mass_matrix()[0, 0]) * float(np.linalg.norm(robot.gravity))
    least = [UnilateralContact(contact=frame, minimum=0.6 * weight) for frame in robot.landmarks["soles"]]
    return Stack(*whole.levels, subject_to=[*whole.subject_to, *least])


def measure(robot: Robot, ticks: int, deadline: float | None, seed: int = 0) -> Record:
    """Closed loop of ``ticks`` ticks; counts only ticks with violated constraints."""
    found = Record(robot.name, "default" if deadline is None else "none")
    declared, rng = overloaded(robot), np.random.default_rng(seed)
    session = hqp.Controller(declared, formulation("torque"), deadline=deadline).session(robot, DT)
    q, v = robot.home.copy(), np.zeros(robot.nv)
    start = robot.state()
    palm, com = start.position(robot.landmarks["palms"][1]), start.com()
    hand, goal, before, held = declared.find("hand", Position), palm, None, -RETURN
    for k in range(ticks):
        if k % 100 == 0:
            goal = palm + rng.normal(0.0, 0.5, 3)
        if k % 250 == 249:
            v = v + rng.normal(0.0, 0.1, v.size)
        references = hand.at(goal), Com(name="com").at(com)
        state = robot.state(q, v)
        wall, cpu = perf_counter(), thread_time()
        tick = session.step(state, *references)
        wall, cpu = perf_counter() - wall, thread_time() - cpu
        if tick.status in (Status.CONSTRAINTS_VIOLATED, Status.TIME_LIMIT):
            found.wall.append(wall)
            found.cpu.append(cpu)
            found.statuses[tick.status.name] += 1
            if tick.status is Status.TIME_LIMIT and before is not None and k > held + RETURN:
                found.worse += not no_worse(session.problem, tick.x, before)
        before, held = tick.x.copy(), k if tick.held else held
        if tick.state.valid and tick.status is not Status.DYNAMICS_FAILED:
            q, v = tick.advance()
        if not np.isfinite(v).all() or np.abs(v).max() > 20.0 or np.abs(q[:3]).max() > 5.0:
            q, v = robot.home.copy(), np.zeros(robot.nv)  # fallen: start again
    return found


def no_worse(problem: hqp.Hierarchy, x: np.ndarray, last: np.ndarray) -> bool:
    """Return true if the levels of x are lexicographically no worse than those of the last x, clipped into today's box.

    The first level whose difference exceeds its concession to lower levels decides: by ||w|| or by ||w|| + price E(x).
    """
    last, motion = problem.boxed(last), problem.motion or Motion(np.ones(problem.n))
    for k, (new, old) in enumerate(zip(problem.slacks(x), problem.slacks(last), strict=True)):
        a, b = float(np.linalg.norm(new)), float(np.linalg.norm(old))
        price = 0.0 if problem.prices is None else float(problem.prices[k])
        band = VIOLATION_TOLERANCE * (1.0 + min(a, b)) + (problem.eta * min(a, b) if price > 0.0 else 0.0)
        if abs(a - b) > band:
            return a < b or a + price * motion(x) <= b + price * motion(last) + band
    return True
