"""Holding torque with damping: what a torque session sends while no answer is usable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hqp.arrays import Signs, Vec
from hqp.assembly import Assembly
from hqp.element import Element
from hqp.law import Law
from hqp.loads import Loads
from hqp.loop.rest import Rest
from hqp.loop.safety import Braking
from hqp.robot import Robot, State
from hqp.torque.dynamics import ConstrainedDynamics, coordinate_parents
from hqp.torque.gravity import Gravity


class Hold(Rest):
    """tau = tau_g(q) - D qd within the effort limits; D_i = 1 / (T phi*_ii), T = max(damping, n dt).

    phi*_ii is the reduced inverse inertia that motor i feels (Sentis 2012, eq. 15): phi* D has the diagonal 1 / T, so
    its largest eigenvalue is at most n / T and D never overshoots within one period.  q is that of the last good
    state, with the loads that were told last; qd as well, fading with T, for damping by an old velocity would push.
    out: live, 1 for rows of the constraints that are not there.
    """

    def __init__(
        self,
        held: Sequence[Element],
        robot: Robot,
        braking: Braking,
        dt: float,
        laws: Mapping[str, Law],
        loads: Loads | None = None,
        out: Signs | None = None,
    ):
        self._loads = Loads((), robot, None) if loads is None else loads
        self._held, self._robot, self._dt = tuple(held), robot, dt
        self._time = max(braking.damping, len(robot.joint_names) * dt)
        self._limit = robot.effort_limit[robot.actuated]
        self._twin = robot.copy()
        self._rows = Assembly(self._held, (), self._twin, dt, {e.name: laws[e.name] for e in self._held})
        m = self._rows.J.shape[0]
        self._gravity = Gravity(self._held, self._twin, dt)
        self._dynamics = ConstrainedDynamics(robot.nv, m, robot.actuated, coordinate_parents(robot))
        self._out = self._dynamics.out if out is None else out
        self._holding = self._damping = self._rate = np.zeros(self._limit.size)

    def begin(self, state: State | None, x: Vec, *, now: bool) -> None:
        """Start from the last good state; where there is none, or its dynamics fail, from the last torque."""
        try:
            found = None if state is None else self._at(state)
        except Exception:  # whatever broke the tick, an element of the user's perhaps, may break this as well
            found = None
        if found is None:
            self._holding, self._damping, self._rate = x.copy(), np.zeros(x.size), np.zeros(x.size)
        else:
            self._holding, self._damping, self._rate = found

    def _at(self, state: State) -> tuple[Vec, Vec, Vec] | None:
        twin = self._twin.state(state.q, state.v)
        self._rows.fill(twin, {e.name: e.hold(twin) for e in self._held}, ())
        gravity, dynamics = self._loads.gravity(twin), self._dynamics
        J = self._rows.J
        np.copyto(dynamics.out, self._out)
        dynamics.update(*self._loads.dynamics(twin), J, self._rows.lower[: J.shape[0]])
        tau = self._gravity.torque(gravity, dynamics.J)
        felt = np.diagonal(dynamics.phi).copy()
        felt[felt <= 1e-9 * felt.max(initial=0.0)] = np.inf  # motors that the constraints lock need no damping
        damping = 1.0 / (self._time * felt)
        rate = state.v[self._robot.actuated]
        if not np.isfinite(tau).all() or not np.isfinite(damping).all():
            return None
        return tau, damping, rate

    def next(self) -> Vec:
        """tau of the next tick ``(n,)`` [N m]."""
        tau = np.clip(self._holding - self._damping * self._rate, -self._limit, self._limit)
        self._rate = self._rate * max(0.0, 1.0 - self._dt / self._time)
        return tau
