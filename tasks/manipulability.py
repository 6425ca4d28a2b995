"""Distance of a frame from a singular posture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec, cross
from hqp.declare import plans
from hqp.declare.element import Task
from hqp.declare.reference import Reference
from hqp.declare.robot import Robot, State

from .fields import check_axes, check_frame, indices
from .twists import twist_derivatives

SINGULAR = 1e-12
"""Determinant below which there is no gradient."""


@dataclass(frozen=True, kw_only=True)
class Manipulability(Task):
    """w = sqrt(det(J J^T)) of the joints' part J of a frame's Jacobian, dw/dq_i = w tr((J J^T)^-1 dJ/dq_i J^T),

    dJ/dq_i by the kinematic Hessian: omega_i x J_j in both parts for i before j, and omega_j x v_i in the linear part
    otherwise.  Raise it with ``at(w_ref)``, or keep it above a value with ``Within(Manipulability(...), lower=0.02)``.

    linear, angular: the rows of J that count, letters of "xyz", world axes; either may be empty.  Units are those of J:
    m and rad are mixed where both count.  If J J^T is singular the row is zero.  Raises DeclarationError for fields and
    where fewer joints move the frame than rows count, FrameNotFound on binding (Yoshikawa 1985, eq. 11).
    """

    frame: str
    linear: str = "xyz"
    angular: str = "xyz"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)
        for axes in (self.linear, self.angular):
            if axes != "" or not (self.linear or self.angular):
                check_axes(self, axes)

    def default_name(self) -> str:
        """The frame and ``_manipulability``."""
        return f"{self.frame}_manipulability"

    @property
    def picked(self) -> list[int]:
        """Rows of the frame's Jacobian that count."""
        return [*indices(self.linear or ""), *(3 + i for i in indices(self.angular or ""))]

    def columns(self, robot: Robot) -> tuple[list[int], list[int]]:
        """Coordinates that move the frame, and those of joints among them; raises FrameNotFound, DeclarationError."""
        moving = np.flatnonzero(robot.support(robot.frame(self.frame))).tolist()
        joints = [c for c in moving if not (robot.floating and c < 6)]
        if len(joints) < len(self.picked):
            raise self.invalid("linear and angular", (self.linear, self.angular), f"at most {len(joints)} rows in all")
        return moving, joints

    def rows(self, robot: Robot) -> int:
        """1; raises FrameNotFound, DeclarationError."""
        self.columns(robot)
        return 1

    def value(self, state: State) -> Vec:
        """w ``(1,)``."""
        J = state.jacobian(self.frame)[np.ix_(self.picked, self.columns(state.robot)[1])]
        return np.array([math.sqrt(max(float(np.linalg.det(J @ J.T)), 0.0))])

    def jacobian(self, state: State) -> Mat:
        """Gradient of w ``(1, nv)``, zero where the posture is singular."""
        moving, joints = self.columns(state.robot)
        whole = np.array(state.jacobian(self.frame))
        gradient, J = np.zeros((1, state.robot.nv)), whole[np.ix_(self.picked, joints)]
        A = J @ J.T
        square = float(np.linalg.det(A))
        if square < SINGULAR:
            return gradient
        X = np.zeros((len(joints), 6))
        X[:, self.picked] = np.linalg.solve(A, J).T  # tr(A^-1 dJ J^T) = sum over j of X_j . dJ_j
        v, w = whole[:3, moving].T, whole[3:, moving].T
        v_j, w_j = whole[:3, joints].T, whole[3:, joints].T
        starts = np.zeros(state.robot.nv, dtype=np.intp)  # the columns of a ball turn with all of its own
        for _, first, count, *_ in state.robot.bodies:
            starts[first : first + count] = first
        before = starts[moving][:, None] <= np.array(joints)[None]
        linear = np.where(before[:, :, None], cross(w[:, None], v_j[None]), cross(w_j[None], v[:, None]))
        angular = np.where(before[:, :, None], cross(w[:, None], w_j[None]), 0.0)
        turn = np.einsum("ijk,jk->i", linear, X[:, :3]) + np.einsum("ijk,jk->i", angular, X[:, 3:])
        gradient[0, moving] = math.sqrt(square) * turn
        return gradient

    def drift(self, state: State) -> Vec:
        """d(J_w v)/dt at zero acceleration ``(1,)``, by the first and second derivative of J J^T on the way."""
        _, joints = self.columns(state.robot)
        first, second = _derivatives(state, self.frame)
        J = state.jacobian(self.frame)[np.ix_(self.picked, joints)]
        J1, J2 = first[np.ix_(self.picked, joints)], second[np.ix_(self.picked, joints)]
        A = J @ J.T
        square = float(np.linalg.det(A))
        if square < SINGULAR:
            return np.zeros(1)
        A1 = J1 @ J.T
        A2 = J2 @ J.T + J1 @ J1.T
        inverse = np.linalg.inv(A)
        turn = inverse @ (A1 + A1.T)
        rate = 0.5 * float(np.trace(turn))
        change = 0.5 * (float(np.trace(inverse @ (A2 + A2.T))) - float(np.sum(turn * turn.T)))
        return np.array([math.sqrt(square) * (change + rate * rate)])

    def at(self, value: Any = None, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """w to have, its rate and its acceleration, a number each; raises DeclarationError."""
        return self._at((1,), *(None if x is None else np.atleast_1d(x) for x in (value, velocity, acceleration)))

    def plan(self, robot: Robot) -> plans.Manipulability:
        """The native operation."""
        joints = tuple(self.columns(robot)[1])
        return plans.Manipulability(plans.frame(robot, self.frame), tuple(self.picked), joints)


def _derivatives(state: State, frame: str) -> tuple[Mat, Mat]:
    """First and second time derivative of a frame's Jacobian ``(6, nv)`` at zero acceleration.

    Derivatives of the twists, moved from the world's origin to the frame's.
    """
    robot = state.robot
    V, A, first, second = twist_derivatives(state)
    twists = robot.joint_twists
    p, body = state.position(frame), robot.body(robot.frame(frame))
    rate = V[body, :3] + cross(V[body, 3:], p)
    change = A[body, :3] + cross(A[body, 3:], p) + cross(V[body, 3:], rate)
    t, t1, t2 = twists[3:].T, first[3:].T, second[3:].T
    second[:3] += (cross(t2, p) + 2.0 * cross(t1, rate) + cross(t, change)).T
    first[:3] += (cross(t1, p) + cross(t, rate)).T
    return first, second
