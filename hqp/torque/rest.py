"""The torque that holds a robot up where no answer is usable, and how much inertia each motor feels there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hqp.arrays import Signs, Vec
from hqp.declare.element import Element
from hqp.declare.law import Law
from hqp.declare.robot import Robot, State
from hqp.programs.assembly import Assembly
from hqp.programs.loads import Loads
from hqp.torque.dynamics import ConstrainedDynamics, coordinate_parents
from hqp.torque.gravity import Gravity


class Held:
    """The torques that hold gravity and the momentum A qd, with the latest loads.

    out: live, 1 for rows of the constraints that are not there.
    """

    def __init__(
        self, held: Sequence[Element], robot: Robot, dt: float, laws: Mapping[str, Law], loads: Loads, out: Signs
    ) -> None:
        self._loads, self._held, self._out = loads, tuple(held), out
        self._twin = robot.copy()
        self._rows = Assembly(self._held, (), self._twin, dt, {e.name: laws[e.name] for e in self._held})
        m = self._rows.J.shape[0]
        self._dynamics = ConstrainedDynamics(robot.nv, m, robot.actuation, coordinate_parents(robot))
        self._gravity = Gravity(self._held, self._twin, dt, self._dynamics)

    def __call__(self, state: State) -> tuple[Vec, Vec]:
        """Torques ``(n,)`` that hold gravity [N m] and momentum [N m s]; raises the errors of the dynamics."""
        twin = self._twin.state(state.q, state.v)
        self._rows.fill(twin, {e.name: e.hold(twin) for e in self._held}, ())
        gravity, dynamics = self._loads.gravity(twin), self._dynamics
        J = self._rows.J
        np.copyto(dynamics.out, self._out)
        A, bias = self._loads.dynamics(twin)
        whole = np.triu(A) + np.triu(A, 1).T
        dynamics.update(A, bias, J, self._rows.lower[: J.shape[0]])
        return self._gravity.torque(gravity, dynamics.J), self._gravity.torque(whole @ state.v, dynamics.J)
