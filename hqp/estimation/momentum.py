"""The force at a frame from torques and motion: no force sensor (De Luca and Mattone 2003, in discrete time)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.reference import numbers
from hqp.declare.robot import Robot, State
from hqp.errors import DeclarationError
from hqp.kinds import require, require_robot, require_state
from hqp.numbers import number

COUPLED = "a mapping from passive joints to pairs of one of the joints and a ratio"


class MomentumObserver:
    """Estimates external joint torques beside motors and gravity, and the equivalent force at a frame.

    The residual of the generalised momentum A v follows the joint torques J^T f of external forces,

        dr/dt = k [A dv/dt + b + g - tau - r],     A dv/dt by differences of measured velocities, A at their middle,

    and f is its least-squares solution in the rows of ``joints``, S r = S J^T f.  Rows of a joint between the ground
    and those would hold contact forces, so ``joints`` are those of a limb or of an upper body.

    frame: point of application of the force.  joints: a group or names.  coupled: passive joints whose row is added to
    that of the joint which drives them, times the ratio of their rates, so that the force between the two drops out.
    period [s].  bandwidth: k [1/s].  damping: viscous, by tangent coordinate ``(nv,)`` [N m s/rad], none by default.
    Raises FrameNotFound, JointNotFound, DeclarationError for a bad period or bandwidth, or fewer than three rows.
    """

    def __init__(
        self,
        robot: Robot,
        frame: str,
        joints: str | Sequence[str],
        period: float,
        *,
        coupled: Mapping[str, tuple[str, float]] | None = None,
        bandwidth: float = 20.0,
        damping: Vec | None = None,
    ) -> None:
        period = number("observer", "period", period, 0.0, strict=True, unit="s")
        bandwidth = number("observer", "bandwidth", bandwidth, 0.0, strict=True, unit="1/s")
        require_robot("observer", robot)
        robot.frame(frame)
        columns = robot.joints(joints)
        if columns.size < 3:
            raise DeclarationError(
                "observer", "too few joints to estimate a force", value=joints, allowed="three or more"
            )
        self.frame, self._period = frame, period
        self._share = 1.0 - math.exp(-bandwidth * period)
        self._actuation = robot.actuation
        self._rows: Mat = np.zeros((columns.size, robot.nv))
        self._rows[range(columns.size), columns] = 1.0
        require("observer", "coupled", coupled, (Mapping, type(None)), COUPLED)
        for passive, pair in (coupled or {}).items():
            require("observer", "coupled", pair, Sequence, COUPLED)
            if len(pair) != 2 or not (row := np.flatnonzero(columns == robot.joints((pair[0],))[0])).size:
                raise DeclarationError("observer", "bad coupled", value=coupled, allowed=COUPLED)
            self._rows[row[0], robot.joints((passive,))[0]] = number("observer", "ratio", pair[1])
        self._damping = np.zeros(robot.nv) if damping is None else numbers("observer", "damping", damping, (robot.nv,))
        self.residual: Vec = np.zeros(robot.nv)
        """r ``(nv,)`` [N, N m]; for joints between the ground and the limb it holds contact forces too."""
        self._before: tuple[Mat, Vec, Vec] | None = None
        from scipy.linalg import lapack  # an exported plan is followed without SciPy

        self._gelsd = lapack.dgelsd  # pyright: ignore[reportAttributeAccessIssue]
        work, integers, _ = lapack.dgelsd_lwork(  # pyright: ignore[reportAttributeAccessIssue]
            columns.size, 3, 1
        )
        self._work, self._integers = int(work), int(integers)

    def update(self, state: State, torque: Vec) -> Vec:
        """The force on the robot at the frame ``(3,)`` [N], world axes, after a state and the torque sent for it.

        torque: torque of the motors during the period that follows ``state`` ``(n_actuated,)`` [N m]; it enters at the
        next update.  A state or torque that is not finite leaves the estimate as it is, and starts the differences
        anew.
        """
        torque = numbers("observer", "torque", torque, (len(self._actuation),))
        require_state("observer", state)
        if not state.finite or not np.isfinite(torque).all():
            self._before = None
            return self.force(state)
        A, bias = state.mass_matrix().copy(), state.bias_force()
        if self._before is not None:
            last_A, v, sent = self._before
            acting = 0.5 * ((A + last_A) @ ((state.v - v) / self._period)) + bias + self._damping * state.v
            acting -= self._actuation.T @ sent
            self.residual = self.residual + self._share * (acting - self.residual)
        self._before = A, state.v.copy(), torque
        return self.force(state)

    @property
    def rows(self) -> Mat:
        """S ``(k, nv)``: selection of the rows of the joints, coupled ones added."""
        return self._rows

    def force(self, state: State) -> Vec:
        """Least squares over the rows of the joints, at a state ``(3,)`` [N]."""
        transposed = self._rows @ state.jacobian(self.frame)[:3].T
        found, *_ = self._gelsd(transposed, self._rows @ self.residual, self._work, self._integers, cond=1e-6)
        return np.array(found[:3], dtype=np.float64)
