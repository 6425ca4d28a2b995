"""The controller of the experiments rebuilt from Pinocchio's calls alone: rows, errors, laws, and the velocities.

Eqs. (12) to (17): feet, CoG over the ground and its goal's velocity; the hand; pelvis orientation and CoG height; the
posture.  It uses nothing of the session that it judges.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import hqp
from benchmarks.mistry2008.equations.algebra import as_printed, siciliano_slotine
from benchmarks.reports.back_ends import answers
from benchmarks.reports.checks import Check, at_most, seen_to_fail
from hqp.arrays import Mat, Vec
from hqp.robots import Robot
from tests.scenes.mistry2008 import HZ, Gains, near_home, paper_stack, roles

SEED = 12
GAINS = Gains(cog=2.0, foot=1.0, hand=2.0, extraneous=1.0, posture=1.0)
"""Gains of the experiments."""
_WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
Levels = list[tuple[Mat, Vec]]


@dataclass(frozen=True)
class Where:
    """One configuration: placements and Jacobians in world axes, by Pinocchio."""

    robot: Robot
    q: Vec

    def __post_init__(self) -> None:
        data: Any = self.robot.model.createData()
        object.__setattr__(self, "data", data)
        pin.computeJointJacobians(self.robot.model, data, self.q)
        pin.updateFramePlacements(self.robot.model, data)
        object.__setattr__(self, "J_com", np.array(pin.jacobianCenterOfMass(self.robot.model, data, self.q)))
        object.__setattr__(self, "com", np.array(data.com[0]))

    def frame(self, name: str) -> tuple[Vec, Mat, Mat]:
        """Position, rotation and J ``(6, nv)``."""
        model, data = self.robot.model, self.data  # type: ignore[attr-defined]
        index = model.getFrameId(name)
        placement = data.oMf[index]
        J = pin.getFrameJacobian(model, data, index, _WORLD)
        return placement.translation.copy(), placement.rotation.copy(), J


def levels(here: Where, start: Where, goals: tuple[Vec, Vec, Vec, Vec], sign: float = 1.0) -> Levels:
    """Rows and reference velocities; feet, pelvis, CoG height and posture hold their values at ``start``.

    goals: CoG over the ground and its velocity ``(2,)``, hand and its velocity ``(3,)``.  sign: factor of the
    rotations' errors; -1 is a deliberate mistake.
    """
    frames = roles(here.robot)
    com_goal, com_rate, hand_goal, hand_rate = goals
    J_com, com = here.J_com, here.com  # type: ignore[attr-defined]
    A, a = [], []
    for name in (frames.left, frames.right):
        p, R, J = here.frame(name)
        p_0, R_0, _ = start.frame(name)
        A.append(J)
        a.append(-(GAINS.foot or 0.0) * np.concatenate((p - p_0, sign * np.array(pin.log3(R @ R_0.T)))))
    A.append(J_com[:2])
    a.append(com_rate - GAINS.cog * (com[:2] - com_goal))
    p, _, J_hand = here.frame(frames.hand)
    _, R, J_base = here.frame(frames.base)
    _, R_0, _ = start.frame(frames.base)
    height = com[2] - start.com[2]  # type: ignore[attr-defined]
    posture = np.array(pin.difference(here.robot.model, start.q, here.q))[6:]
    nv = here.robot.nv
    return [
        (np.vstack(A), np.concatenate(a)),
        (J_hand[:3], hand_rate - GAINS.hand * (p - hand_goal)),
        (
            np.vstack((J_base[3:], J_com[2:])),
            -GAINS.extraneous * np.concatenate((sign * np.array(pin.log3(R @ R_0.T)), [height])),
        ),
        (np.eye(nv)[6:], -GAINS.posture * posture),
    ]


def checks(robot: Robot, count: int) -> Iterator[Check]:
    """The session of the experiments against the formulas, at random states near a stance and goals off them."""
    rng = np.random.default_rng([SEED, robot.nv])
    start = Where(robot, near_home(robot, rng))
    tasks = paper_stack(roles(robot), GAINS)
    names = ("lexicographic", "nullspace", "chiaverini")
    sessions = {
        name: hqp.Controller(tasks, hqp.Velocity(), name, calm=False, deadline=math.inf).session(robot, 1.0 / HZ)
        for name in names
    }
    for session in sessions.values():
        session.step(robot.state(start.q))  # takes the hold values
    off: dict[str, list[float]] = {name: [] for name in names}
    wrong, cases = [], []
    for _ in range(count):
        here = Where(robot, near_home(robot, rng))
        com, hand = here.com[:2], here.frame(roles(robot).hand)[0]  # type: ignore[attr-defined]
        goals = (
            com + 0.05 * rng.normal(size=2),
            0.2 * rng.normal(size=2),
            hand + 0.1 * rng.normal(size=3),
            0.2 * rng.normal(size=3),
        )
        made = levels(here, start, goals)
        strict, printed = siciliano_slotine(made), as_printed(made)
        for name, session in sessions.items():
            references = (
                tasks.find("com_xy", hqp.tasks.Com).at(goals[0], velocity=goals[1]),
                tasks.find("hand", hqp.tasks.Position).at(goals[2], velocity=goals[3]),
            )
            tick = session.step(robot.state(here.q), *references)
            qd = (printed if name == "chiaverini" else strict)[robot.actuated]
            off[name].append(float(np.abs(tick.command - qd).max() / np.abs(qd).max()))
            if name == "lexicographic":
                cases.append((session.problem.copy(), strict))
        turned = siciliano_slotine(levels(here, start, goals, sign=-1.0))
        wrong.append(float(np.abs(turned - strict).max() / np.abs(strict).max()))
    text = "joint velocities of the experiments' session = rows and laws by hand: {}, relative"
    for name, values in off.items():
        equation = "M(16)" if name == "chiaverini" else "M(12)-(17)"
        yield at_most(equation, text.format(name), robot.name, 1e-8, values, kind="product")
    yield seen_to_fail("M(12)-(17)", "the same, rotation errors turned round", robot.name, 1e-8, wrong)
    text = "joint velocities of the experiments by hand"
    yield from answers("M(12)-(17)", text, robot.name, 1e-8, cases[: max(3, count // 4)])
