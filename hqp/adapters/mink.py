"""mink's tasks, limits and ``solve_ik`` on hqp: flat tasks share one level, sequences of tasks are strict levels.

from hqp.adapters.mink import solve_ik
velocity = solve_ik(configuration, [[feet], [hand], [posture]], dt)     # strict
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.element import Task
from hqp.errors import NotSolved
from hqp.law import P
from hqp.reference import Reference
from hqp.robot import Robot, State
from hqp.solvers.base import Solver

from .displacement import cost_of, make_levels, solve


def solve_ik(
    configuration: Any,
    tasks: Iterable[Any],
    dt: float,
    solver: str | Solver = "",
    *,
    safety_break: bool = False,
    limits: Iterable[Any] | None = None,
    constraints: Iterable[Any] | None = None,
) -> Vec:
    """Velocity ``(nv,)`` in MuJoCo's tangent space, as mink's solve_ik gives it.

    solver: as a Controller takes it.  limits, constraints, safety_break: as mink's; ``damping`` and ``lm_damping``
    have no counterpart.  Tasks without compute_error (kinetic energy) are refused by Python.  Raises NotSolved where
    no usable answer was found, DeclarationError for tasks mixed with levels, and mink's NotWithinConfigurationLimits.
    """
    configuration.check_limits(safety_break=safety_break)
    if limits is None:
        mink: Any = importlib.import_module("mink")
        limits = [mink.ConfigurationLimit(configuration.model)]
    inequalities = [
        (rows.G, rows.h) for limit in limits if not (rows := limit.compute_qp_inequalities(configuration, dt)).inactive
    ]
    equalities = [
        (c.compute_jacobian(configuration), -c.gain * c.compute_error(configuration)) for c in constraints or ()
    ]
    nv = int(configuration.model.nv)
    solution = solve(nv, make_levels(tasks, configuration), inequalities, equalities, solver)
    if not solution.status.usable:
        raise NotSolved(f"{solution.status.name}: {solution.status.value}", None)
    return np.asarray(solution.x / dt)


@dataclass(frozen=True, kw_only=True, eq=False)
class MinkTask(Task):
    """A mink task as an element: W J B v = -(gain / dt) W e, with B from our coordinates to MuJoCo's.

    task: a mink.Task, whose target stays its own to set.  model: the MjModel it was made for; its joints are matched
    with the robot's by name.  dt: control period [s].  Velocity level only.  Raises DeclarationError for fields,
    ModelError or JointNotFound where robot and model do not fit.
    """

    task: Any
    model: Any
    dt: float
    _held: dict[Any, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if self.law is None:
            object.__setattr__(self, "law", P(float(self.task.gain) / self.dt))
        super().__post_init__()

    def default_name(self) -> str:
        """The task's frame where it has one, its class otherwise."""
        return str(getattr(self.task, "frame_name", None) or type(self.task).__name__)

    def rows(self, robot: Robot) -> int:
        """Rows whose cost is not zero."""
        return self.value(robot.state(robot.home)).size

    def value(self, state: State) -> Vec:
        """W e ``(k,)``, to be brought to zero."""
        configuration, _ = self._configuration(state)
        e = np.asarray(self.task.compute_error(configuration))
        weight = cost_of(self.task, e.size)
        return np.asarray((weight * e)[weight > 0.0])

    def jacobian(self, state: State) -> Mat:
        """W J B ``(k, nv)``."""
        configuration, B = self._configuration(state)
        J = np.asarray(self.task.compute_jacobian(configuration))
        weight = cost_of(self.task, J.shape[0])
        return np.asarray((weight[:, None] * J)[weight > 0.0] @ B)

    def hold(self, state: State) -> Reference:
        """Zero: the target is the mink task's own."""
        return Reference(self.name, np.zeros(self.value(state).size))

    def _configuration(self, state: State) -> tuple[Any, Mat]:
        mink: Any = importlib.import_module("mink")

        from hqp.robots.state_map import StateMap

        robot: Any = state.robot
        if robot not in self._held:
            self._held[robot] = (mink.Configuration(self.model), StateMap(self.model, robot))
        configuration, states = self._held[robot]
        qpos, _ = states.to_mujoco(state.q, np.zeros(robot.nv))
        if not np.array_equal(configuration.q, qpos):
            configuration.update(qpos)
        return configuration, states.tangent(qpos)
