"""Interface of the sessions that a search steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias

from hqp.arrays import Vec
from hqp.declare.price import Price
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.programs.formulation import Formulation, Program
from hqp.solvers.base import Workspace


class Answer(Protocol):
    """Tick of a session: x of the command; held: 0 if the solver gave it."""

    held: int

    @property
    def x(self) -> Vec: ...


class Session(Protocol):
    """Compiled stack on a robot."""

    robot: Robot

    @property
    def stack(self) -> Stack: ...
    @property
    def program(self) -> Program: ...
    @property
    def workspace(self) -> Workspace: ...
    def step(self, state: State, *references: Reference) -> Answer:
        """Run a tick."""
        ...


Sessions: TypeAlias = Callable[[Stack, Robot, Formulation, Price], Session]
"""Make a session with a period of one second and without a deadline."""
