"""mink's tasks, limits and ``solve_ik`` on hqp: flat tasks share one level, sequences of tasks are strict levels.

from hqp.adapters.mink import solve_ik
velocity = solve_ik(configuration, [[feet], [hand], [posture]], dt)     # strict
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.robot import State
from hqp.solvers.base import Solver

from .displacement import velocity
from .foreign import ForeignTask


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

    solver: argument of Controller.  limits, constraints, safety_break: as mink's; ``damping`` and ``lm_damping`` have
    no counterpart.  Tasks without compute_error (kinetic energy) are refused by Python.  Raises NotSolved where no
    usable answer was found, DeclarationError for tasks mixed with levels, and mink's NotWithinConfigurationLimits.
    """
    configuration.check_limits(safety_break=safety_break)
    if limits is None:
        mink: Any = importlib.import_module("mink")
        limits = [mink.ConfigurationLimit(configuration.model)]
    inequalities = [
        (rows.G, rows.h) for limit in limits if not (rows := limit.compute_qp_inequalities(configuration, dt)).inactive
    ]
    return velocity(configuration, tasks, inequalities, constraints, dt, solver)


@dataclass(frozen=True, kw_only=True, eq=False)
class MinkTask(ForeignTask):
    """A mink task as an element: W J B v = -(gain / dt) W e, with B from our coordinates to MuJoCo's.

    task: a mink.Task, whose target stays its own to set.  model: the MjModel it was made for; its joints are matched
    with the robot's by name.  dt: control period [s].  Velocity level only.  Raises DeclarationError for fields,
    ModelError or JointNotFound where robot and model do not fit.
    """

    model: Any

    def _configuration(self, state: State) -> tuple[Any, Mat]:
        mink: Any = importlib.import_module("mink")

        from hqp.robots.model_map import ModelMap

        robot: Any = state.robot
        if robot not in self._held:
            self._held[robot] = (mink.Configuration(self.model), ModelMap(self.model, robot))
        configuration, states = self._held[robot]
        qpos, _ = states.to_mujoco(state.q, np.zeros(robot.nv))
        if not np.array_equal(configuration.q, qpos):
            configuration.update(qpos)
        return configuration, states.tangent(qpos)
