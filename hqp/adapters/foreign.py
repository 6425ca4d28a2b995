"""Common base of elements made from tasks of pink and mink."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.element import Task
from hqp.declare.law import P
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State

from .displacement import cost_of


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignTask(Task):
    """A task of another library as an element: W J B v = -(gain / dt) W e; rows of cost zero are left out.

    task: theirs, whose target stays its own to set.  dt: control period [s], which turns its gain, a share of the error
    per step, into P(gain / dt) [1/s].  Velocity level only.  Raises DeclarationError for fields.
    """

    task: Any
    dt: float
    _held: dict[Any, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if self.law is None:
            object.__setattr__(self, "law", P(float(self.task.gain) / self.dt))
        super().__post_init__()

    @abstractmethod
    def _configuration(self, state: State) -> tuple[Any, Mat | None]:
        """Their configuration at a state, and B from our coordinates to theirs, None for the identity."""

    def default_name(self) -> str:
        """The task's frame where it has one, its class otherwise."""
        frame = getattr(self.task, "frame_name", None) or getattr(self.task, "frame", None)
        return str(frame or type(self.task).__name__)

    def rows(self, robot: Robot) -> int:
        """Rows whose cost is not zero."""
        return self.value(robot.state(robot.home)).size

    def value(self, state: State) -> Vec:
        """W e ``(k,)``, to be brought to zero."""
        e = np.asarray(self.task.compute_error(self._configuration(state)[0]))
        weight = cost_of(self.task, e.size)
        return np.asarray((weight * e)[weight > 0.0])

    def jacobian(self, state: State) -> Mat:
        """W J B ``(k, nv)``."""
        configuration, B = self._configuration(state)
        J = np.asarray(self.task.compute_jacobian(configuration))
        weight = cost_of(self.task, J.shape[0])
        rows = (weight[:, None] * J)[weight > 0.0]
        return rows if B is None else np.asarray(rows @ B)

    def hold(self, state: State) -> Reference:
        """Zero: the target is the task's own."""
        return Reference(self.name, np.zeros(self.value(state).size))
