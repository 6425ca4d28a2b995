"""pink's tasks, limits and ``solve_ik`` on hqp: flat tasks share one level, sequences of tasks are strict levels.

from hqp.adapters.pink import solve_ik
velocity = solve_ik(configuration, [[feet], [hand], [posture]], dt)     # strict
velocity = solve_ik(configuration, [hand, posture], dt)                 # weighed by cost, as in pink
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

from hqp.arrays import Vec
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
    limits: Iterable[Any] | None = None,
    barriers: Iterable[Any] | None = None,
    constraints: Iterable[Any] | None = None,
    safety_break: bool = True,
) -> Vec:
    """Velocity ``(nv,)`` as pink's solve_ik gives it, from strict levels where ``tasks`` holds sequences of tasks.

    solver: argument of Controller.  limits, barriers, constraints, safety_break: as pink's; a barrier's penalty on safe
    displacements is left out, and so is ``lm_damping``.  Raises NotSolved where no usable answer was found,
    DeclarationError for tasks mixed with levels, and pink's NotWithinConfigurationLimits.
    """
    configuration.check_limits(safety_break=safety_break)
    if limits is None:
        model = configuration.model
        limits = [model.configuration_limit, model.velocity_limit]
        base = getattr(model, "floating_base_velocity_limit", None)
        if base is not None:
            limits.append(base)
    inequalities = [rows for limit in limits if (rows := _inequalities(limit, configuration, dt)) is not None]
    inequalities += [b.compute_qp_inequalities(configuration, dt) for b in barriers or ()]
    return velocity(configuration, tasks, inequalities, constraints, dt, solver)


def _inequalities(limit: Any, configuration: Any, dt: float) -> Any:
    """Rows of a limit, which before pink 4 took q and now takes the configuration."""
    takes_q = _takes_q(limit.__class__)
    return limit.compute_qp_inequalities(configuration.q if takes_q else configuration, dt)


@cache
def _takes_q(kind: type) -> bool:
    return list(inspect.signature(kind.compute_qp_inequalities).parameters)[1] == "q"  # type: ignore[attr-defined]


@dataclass(frozen=True, kw_only=True, eq=False)
class PinkTask(ForeignTask):
    """A pink task as an element: W J v = -(gain / dt) W e with its cost W; rows of cost zero are left out.

    task: a pink.Task, whose target stays its own to set.  dt: control period [s], which turns pink's gain, a share of
    the error per step, into P(gain / dt) [1/s].  Velocity level only.  Raises DeclarationError for fields.
    """

    def _configuration(self, state: State) -> tuple[Any, None]:
        pink: Any = importlib.import_module("pink")

        robot: Any = state.robot
        if robot not in self._held:
            self._held[robot] = pink.Configuration(robot.model, robot.model.createData(), state.q, copy_data=False)
        configuration = self._held[robot]
        if configuration.q is not state.q:
            configuration.update(state.q)
        return configuration, None
