"""The levels of the paper's stack as matrices, at random states."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import hqp
from hqp import PD, Level, Stack
from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.declare.robot import Robot
from hqp.problem import Hierarchy, Rows
from hqp.solvers.base import Solver
from hqp.tasks import Com, FixedContact, Orientation, Position
from tests.scenes.mistry2008 import HZ, roles


def states(robot: Robot, count: int, seed: int, spread: float = 1.0) -> Iterator[tuple[Vec, Vec]]:
    """Random (q, v): joints all over their ranges, the base anywhere, so that no stance is symmetric."""
    rng = np.random.default_rng([seed, robot.nv])
    for _ in range(count):
        yield robot.random_configuration(rng, spread), rng.standard_normal(robot.nv)  # type: ignore[attr-defined]


class Evaluated:
    """Elements of the library compiled together; J and drift of any state, through the session's own rows.

    order 2 gives the drift too.
    """

    def __init__(self, robot: Robot, elements: Sequence[Element], order: int = 1) -> None:
        self.robot = robot
        formulation = hqp.Velocity() if order == 1 else hqp.Acceleration()
        stack = Stack(*(Level(element) for element in elements))
        if order == 2:  # a law without gains reduces to J x = -dJ/dt v
            stack = stack.with_laws({element.name: PD(0.0, 0.0) for element in elements})
        self.session = hqp.Controller(stack, formulation, solver="nullspace", price=0, deadline=math.inf).session(
            robot, dt=1.0 / HZ
        )
        self.session.step(robot.state())

    def at(self, q: Vec, v: Vec | None = None) -> list[Mat]:
        """J of every element ``(m, nv)``, copied."""
        self.session.step(self.robot.state(q, v))
        return [rows.dense(self.robot.nv).copy() for rows in self.session.problem.levels]

    def drift(self) -> list[Vec]:
        """dJ/dt v of every element at the state of the latest ``at``, copied; for order 2."""
        return [-rows.lower for rows in self.session.problem.levels]


@dataclass(frozen=True)
class PaperLevels:
    """J_C (both feet), J_A, J_B, J_E at one state, and targets with feet at rest."""

    J_C: Mat
    J_A: Mat
    J_B: Mat
    J_E: Mat
    x_A: Vec
    x_B: Vec
    x_E: Vec

    @property
    def pairs(self) -> list[tuple[Mat, Vec]]:
        """The levels with their targets, most important first."""
        return [(self.J_A, self.x_A), (self.J_B, self.x_B), (self.J_E, self.x_E)]


def paper_levels(robot: Robot, count: int, seed: int) -> Iterator[PaperLevels]:
    """The levels of eqs. (12) to (15) at random states, with random targets but feet at rest."""
    frames = roles(robot)
    library = Evaluated(
        robot,
        (
            FixedContact(frame=frames.right),
            FixedContact(frame=frames.left),
            Com(axes="xy", name="com_xy"),
            Position(frame=frames.hand),
            Orientation(frame=frames.base),
            Com(axes="z", name="com_z"),
        ),
    )
    rng = np.random.default_rng([seed, 1])
    for q, v in states(robot, count, seed):
        right, left, com_xy, hand, base, com_z = library.at(q, v)
        J_C = np.concatenate((right, left))
        x_A = np.concatenate((np.zeros(12), rng.standard_normal(2)))
        yield PaperLevels(
            J_C,
            np.concatenate((J_C, com_xy)),
            hand,
            np.concatenate((base, com_z)),
            x_A,
            rng.standard_normal(3),
            rng.standard_normal(4),
        )


def hierarchy(levels: Sequence[tuple[Mat, Vec]]) -> Hierarchy:
    """Equality levels as a problem for a solver."""
    return Hierarchy(tuple(Rows(J, target, target) for J, target in levels))


def solve(solver: Solver, levels: Sequence[tuple[Mat, Vec]]) -> Vec:
    """Solve equality levels with a solver of the library."""
    return solver.solve(hierarchy(levels)).x
