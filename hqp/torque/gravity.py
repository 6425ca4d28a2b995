"""Gravity compensation in the remaining null space, optionally with separate ground normals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import get_lapack_funcs

from hqp.arrays import Mat, Vec
from hqp.declare.element import Element
from hqp.declare.law import P
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.programs.assembly import Assembly
from hqp.torque.dynamics import ConstrainedDynamics

_WORK = 4096

(gels,) = get_lapack_funcs(("gels",), (np.zeros(1),))


class Gravity:
    """The torque that holds the robot, on the ground of ``normal`` and on that of ``gravity_normal``.

    The second one is allocated at the first tick that has a reference with one.
    """

    def __init__(self, held: Sequence[Element], robot: Robot, dt: float, dynamics: ConstrainedDynamics) -> None:
        self._dynamics = dynamics
        self._held, self._robot, self._dt = held, robot, dt
        self._laws = {e.name: P(0.0) for e in held}  # only the rows are used: no drift
        self._rows: Assembly | None = None

    @staticmethod
    def takes_normals(given: Sequence[Reference]) -> bool:
        """True if a reference of this tick has a gravity_normal."""
        return any(reference.gravity_normal is not None for reference in given)

    def torque(self, g: Vec, J: Mat) -> Vec:
        """tau_g ``(n,)`` [N m] that holds g ``(nv,)`` on the constraints J."""
        U = self._robot.actuation
        tau = np.empty(len(U))
        return tau if self._dynamics.native.hold(J, g, tau) else holding_torque(J, g, U)

    def other(self, state: State, g: Vec, references: Mapping[str, Reference]) -> Vec:
        """tau_g ``(n,)`` [N m] that holds g on the ground of the gravity normals."""
        if self._rows is None:
            self._rows = Assembly(self._held, (), self._robot, self._dt, self._laws)
        other = {e.name: _on_gravity_normal(references[e.name]) for e in self._held}
        self._rows.fill(state, other, ())
        return self.torque(g, self._rows.J)


def _on_gravity_normal(r: Reference) -> Reference:
    if r.gravity_normal is None:
        return r
    return Reference(r.name, r.value, r.velocity, r.acceleration, r.gravity_normal)


def holding_torque(J: Mat, g: Vec, U: Mat) -> Vec:
    """tau ``(n,)`` with U^T tau - J^T lambda = g: the torque at rest, UNbar^T g (Sentis 2012, eqs. 22, 57).

    Needs rank [J; U] full; internal forces of redundant constraints are those of least norm.
    """
    nv, n, m = g.size, len(U), J.shape[0]
    system = np.zeros((nv, n + m), order="F")
    system[:, :n] = U.T
    system[:, n:] = -J.T
    right = np.zeros(max(system.shape))
    right[:nv] = g
    _, solved, _ = gels(system, right, lwork=_WORK, overwrite_a=1)
    return np.asarray(solved[:n])
