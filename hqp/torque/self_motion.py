"""The posture law with a Lyapunov function: null space of the tasks above, and its derivative along the motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare.element import Element, selection_of
from hqp.declare.law import Law, SelfMotion
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError
from hqp.programs.assembly import Assembly
from hqp.programs.layout import Group
from hqp.tolerances import RANK_TOLERANCE

STEP = 2e-3
"""Tangent step [m, rad] of the differences that give dPhi/dt y; their error is of fourth order in it."""


class SelfMotions:
    """Adds the demand v of eq. (41), its sign set right, to the rows of elements whose law is a SelfMotion."""

    def __init__(
        self,
        stack: Stack,
        groups: Sequence[Group],
        held: Sequence[Element],
        robot: Robot,
        dt: float,
        laws: Mapping[str, Law],
        rows: Assembly,
    ) -> None:
        self._motions = []
        above: list[Element] = list(held)
        for group in groups:
            for element in group.elements:
                law = laws[element.name]
                if not isinstance(law, SelfMotion):
                    continue
                index = selection_of(element, robot)
                if index is None or not element.equality or len(group.elements) > 1:
                    raise DeclarationError(
                        element.name, "SelfMotion is a law for a Posture alone in its level", value=law, allowed="PD"
                    )
                twin = robot.copy()
                over = Assembly(above, (), twin, dt, {e.name: laws[e.name] for e in above})
                self._motions.append(_Motion(element.name, law, index, rows, twin, over))
            above += [e for e in group.elements if e.quantity == "motion" and e.equality]

    def __bool__(self) -> bool:
        return bool(self._motions)

    def go_without(self, out: Set[str]) -> None:
        """These elements are not there, above a posture or as one."""
        for motion in self._motions:
            motion.go_without(out)

    def add(self, state: State, references: Mapping[str, Reference]) -> None:
        """Add v to the demands that ``rows.fill`` has just written."""
        for motion in self._motions:
            motion.add(state, references)


class _Motion:
    def __init__(self, name: str, law: SelfMotion, index: Index, rows: Assembly, twin: Robot, over: Assembly) -> None:
        self._law, self._index, self._rows, self._twin, self._over = law, index, rows, twin, over
        self._part = rows.members[name].part
        self._weight = rows.members[name].element.weight
        self._name, self._out = name, False
        self._kept = np.ones((over.J.shape[0], 1))

    def go_without(self, out: Set[str]) -> None:
        self._out = self._name in out
        for name, member in self._over.members.items():
            self._kept[member.part] = name not in out

    def add(self, state: State, references: Mapping[str, Reference]) -> None:
        if self._out:
            return
        law, rows, part = self._law, self._rows, self._part
        over = {name: references[name] for name in self._over.members}
        rate = state.v[self._index] - rows.rate[part]
        y = -law.kp * rows.error[part] - law.kv * rate
        v = law.ke * self._project(state.q, over, y) - law.kp * rate + self._turn(state, over, y)
        demand = v * (self._weight / law.kv)
        rows.lower[part] += demand
        rows.upper[part] += demand

    def _turn(self, state: State, references: Mapping[str, Reference], y: Vec) -> Vec:
        """dPhi/dt y ``(k,)`` along the velocity of the state, by central differences of fourth order."""
        size = float(np.abs(state.v).max())
        if size == 0.0:
            return np.zeros_like(y)
        h = STEP / size

        def at(t: float) -> Vec:
            return self._project(state.robot.integrate(state.q, state.v, t), references, y)

        return (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)

    def _project(self, q: Vec, references: Mapping[str, Reference], y: Vec) -> Vec:
        """Phi y: onto the posture velocities S qd for which J_constr qd = 0 and every task above rests."""
        self._over.fill(self._twin.state(q), references, ())
        basis = free_directions(self._over.J * self._kept, self._index)
        return np.asarray(basis @ (basis.T @ y))


def free_directions(J: Mat, index: Index) -> Mat:
    """Orthonormal basis ``(k, r)`` of {qd[index] : J qd = 0}; Phi = basis basis^T (eqs. 37 to 39).

    With index the actuated joints and rank [J_constr; U] full it spans Null(J*_task).
    """
    _, sizes, directions = np.linalg.svd(J)
    rank = int(np.count_nonzero(sizes > RANK_TOLERANCE * sizes.max(initial=0.0)))
    left, shares, _ = np.linalg.svd(directions[rank:, index].T, full_matrices=False)
    return np.asarray(left[:, shares > RANK_TOLERANCE * max(1.0, shares.max(initial=0.0))])
