"""One (q, v) of a robot on Pinocchio, computed lazily and once."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from hqp.arrays import FLOAT, Index, Mat, Vec
from hqp.errors import ModelError, StaleState

from . import carried
from .checks import normalise, not_finite
from .joints import matrix
from .releases import crba

if TYPE_CHECKING:
    from hqp.declare.robot import Load

    from .on_pinocchio import Robot

_joint_jacobians, _frame_placements = pin.computeJointJacobians, pin.updateFramePlacements
_frame_placement = pin.updateFramePlacement
_WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
_KINEMATICS, _COM, _SUBTREES, _DRIFT, _INERTIA, _MASS, _BIAS, _PLACED = (1 << i for i in range(8))


class PlainState(NamedTuple):
    """Plain numbers of a pickled state: robot by name, q ``(nq,)``, v ``(nv,)``, time [s]."""

    robot: str
    q: Vec
    v: Vec
    time: float | None


NOBODY: frozenset[str] = frozenset()


class State:
    """One (q, v) of a robot; see hqp.declare.robot.State.  Computes each quantity once, on first use.

    q and v are copies that cannot be written to; quaternions within 1e-3 of length one are normalised.  commanded: the
    velocity ``(nv,)`` that a session at velocity level sent last, written by the session, as are ``loads``, point
    masses that ``com`` and momenta count with the robot's, and ``out``, names of elements that are out of its tick.
    """

    __slots__ = (
        "_done", "_gravity", "_unit", "commanded", "finite", "loads", "out", "q", "robot", "square", "time", "v",
        "valid",
    )  # fmt: skip

    def __init__(self, robot: Robot, q: Vec, v: Vec | None, time: float | None = None) -> None:
        self.robot, self.time = robot, time
        self.commanded: Vec | None = None
        self.loads: tuple[Load, ...] = ()
        self.out = NOBODY
        if type(q) is np.ndarray is type(v) and q.dtype is FLOAT is v.dtype:
            q, v = q.copy(), v.copy()
        else:
            q, v = np.array(q, FLOAT), np.zeros(robot.nv) if v is None else np.array(v, FLOAT)
        self.q, self.v = q, v
        measured = robot._measure(q, v)
        if measured is None:
            raise ModelError(
                f"{robot.name}: a state needs q ({robot.nq},) and v ({robot.nv},), given {q.shape} and {v.shape}"
                + ("; robot.configuration(angles) makes q from joint angles" if q.shape == (robot.nv,) else "")
            )
        # a sum of squares is finite only if every entry is (entries whose square overflows are no states either)
        self.square, unit = measured
        self.finite = self.square < math.inf
        if self.finite and not unit:
            unit = not normalise(robot, q)
        self._unit = unit
        self.valid = self.finite and unit
        """True if q and v are finite and every quaternion has length one within 1e-3."""
        # not written to; the positional argument costs half of write=False
        q.setflags(False)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
        v.setflags(False)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
        self._done = 0
        self._gravity: Vec | None = None

    @property
    def fault(self) -> str:
        """Why the state is not valid, naming the joint or the base; "" where it is."""
        if not self.finite:
            return not_finite(self.robot, self.q, self.v)
        return "" if self._unit else normalise(self.robot, self.q.copy())

    def __reduce__(self) -> tuple[Any, ...]:
        """A state pickles as plain numbers: its computed quantities live in its robot."""
        return PlainState, (self.robot.name, self.q, self.v, self.time)

    def _compute(self, what: int) -> None:
        robot = self.robot
        if robot.current is not self:
            raise self._stale()
        model, data = robot.model, robot.data
        if what == _COM:
            self.kinematics()
            pin.jacobianCenterOfMass(model, data, False)
            self._done &= ~_SUBTREES  # it leaves sums in world axes where the subtrees' centres were, in joint axes
        elif what == _SUBTREES:
            self.kinematics()
            pin.centerOfMass(model, data, self.q, self.v, _zeros(robot.nv), True)
        elif what == _DRIFT:
            self.kinematics()
            pin.forwardKinematics(model, data, self.q, self.v, _zeros(robot.nv))
        elif what == _INERTIA:
            self.kinematics()
            crba(model, data, self.q)
        elif what == _MASS:
            self._need(_INERTIA)
            upper = _upper(robot.nv)
            data.M.T[upper] = data.M[upper]
        elif what == _BIAS:
            pin.nonLinearEffects(model, data, self.q, self.v)
        self._done |= what

    def kinematics(self) -> None:
        """Make placements and joint_twists those of this state; raises StaleState."""
        robot = self.robot
        if robot.current is not self:
            raise self._stale()
        if not self._done & _KINEMATICS:
            _joint_jacobians(robot.model, robot.data, self.q)
            _frame_placements(robot.model, robot.data)
            self._done |= _KINEMATICS

    def is_placed(self) -> None:
        """Placements of bodies and joint_twists are those of this state: something else has written them."""
        self._done |= _PLACED

    def _placement(self, frame: str) -> tuple[Vec, Mat]:
        robot, index = self.robot, self._at(frame)
        if not self._done & _KINEMATICS:  # bodies are where they belong, the frame may not be
            _frame_placement(robot.model, robot.data, index)
        return robot.placement(index)

    def _at(self, frame: str) -> int:
        """Index of a frame whose body is placed."""
        if not self._done & (_KINEMATICS | _PLACED) or self.robot.current is not self:
            self.kinematics()
        return self.robot.frame(frame)

    def _stale(self) -> StaleState:
        name = self.robot.name
        return StaleState(f"this state is stale, {name} has a newer one: call robot.state(q, v) again")

    def _need(self, what: int) -> None:
        if not self._done & what or self.robot.current is not self:
            self._compute(what)

    @property
    def angles(self) -> Vec:
        """Joint positions by tangent coordinate ``(nv,)``, zero for free bodies; a ball's is its rotation vector."""
        return self.robot._joints.angles(self.robot.model, self.q)

    def difference(self, q: Vec) -> Vec:
        """Tangent vector from q to this state's configuration, ``(nv,)``."""
        return self.robot.difference(q, self.q)

    def position(self, frame: str) -> Vec:
        """Origin of a frame in the world, ``(3,)`` [m]."""
        return self._placement(frame)[0].copy()

    def rotation(self, frame: str) -> Mat:
        """Rotation of a frame in the world, ``(3, 3)``."""
        return np.array(self._placement(frame)[1], order="C")

    def pose(self, frame: str) -> Mat:
        """Homogeneous matrix ``(4, 4)`` of a frame in the world, origin in [m]."""
        pose = np.eye(4)
        pose[:3, 3], pose[:3, :3] = self._placement(frame)
        return pose

    def jacobian(self, frame: str) -> Mat:
        """Geometric Jacobian ``(6, nv)`` of a frame, linear first, world axes."""
        index, robot = self._at(frame), self.robot
        return matrix(pin.getFrameJacobian(robot.model, robot.data, index, _WORLD))

    def velocity(self, frame: str) -> Vec:
        """Velocity ``(6,)`` of a frame's origin [m/s] and its rotation [rad/s], world axes."""
        if not self._done & _DRIFT or self.robot.current is not self:
            return self.jacobian(frame) @ self.v
        robot = self.robot
        motion = pin.getFrameVelocity(robot.model, robot.data, robot.frame(frame), _WORLD)
        return np.array(motion.vector)

    def drift(self, frame: str) -> Vec:
        """dJ/dt v of a frame's geometric Jacobian: its acceleration at zero generalised acceleration."""
        self._need(_DRIFT)
        robot = self.robot
        motion = pin.getFrameClassicalAcceleration(robot.model, robot.data, robot.frame(frame), _WORLD)
        return np.array(motion.vector)

    def com(self, subtree: int = 0) -> Vec:
        """Centre of mass of the robot or a subtree with their ``loads``, ``(3,)`` [m]."""
        if subtree == 0:
            self._need(_COM)
            centre = np.array(self.robot.data.com[0])
        else:
            self._need(_SUBTREES)
            placement = self.robot.data.oMi[subtree]
            centre = np.array(placement.translation + placement.rotation @ self.robot.data.com[subtree])
        return carried.mean(self, subtree, centre, carried.position) if self.loads else centre

    def com_jacobian(self, subtree: int = 0) -> Mat:
        """Jacobian of the centre of mass, ``(3, nv)``: a live view where subtree is 0 and there are no ``loads``."""
        robot = self.robot
        if subtree == 0:
            self._need(_COM)
            J = matrix(robot.data.Jcom)
        else:
            self.kinematics()
            self._done &= ~(_COM | _SUBTREES)  # Pinocchio writes the subtree's Jacobian over the whole robot's
            J = np.array(matrix(pin.jacobianSubtreeCenterOfMass(robot.model, robot.data, subtree)))
        return carried.mean(self, subtree, J, carried.jacobian) if self.loads else J

    def com_velocity(self, subtree: int = 0) -> Vec:
        """Velocity of the centre of mass, ``(3,)`` [m/s]."""
        return self.com_jacobian(subtree) @ self.v

    def com_drift(self, subtree: int = 0) -> Vec:
        """dJ/dt v of the centre of mass, ``(3,)``."""
        self._need(_SUBTREES)
        data = self.robot.data
        drift = np.array(data.oMi[subtree].rotation @ data.acom[subtree])
        return carried.mean(self, subtree, drift, carried.drift) if self.loads else drift

    def dynamics(self) -> None:
        """Make kinematics, ``inertia`` and ``bias_force`` those of this state; raises StaleState."""
        self.kinematics()
        self._need(_INERTIA)
        self._need(_BIAS)

    def inertia(self) -> Mat:
        """Upper triangle of A, ``(nv, nv)``, entries below the diagonal are undefined; a live view."""
        self._need(_INERTIA)
        return self.robot.data.M  # type: ignore[no-any-return]

    def mass_matrix(self) -> Mat:
        """Joint-space inertia A, ``(nv, nv)``, symmetric; a live view."""
        self._need(_MASS)
        return self.robot.data.M  # type: ignore[no-any-return]

    def bias_force(self) -> Vec:
        """b + g: Coriolis, centrifugal and gravity forces, ``(nv,)``; a live view."""
        self._need(_BIAS)
        return self.robot.data.nle  # type: ignore[no-any-return]

    def gravity_force(self) -> Vec:
        """g: gravity forces, ``(nv,)``."""
        if self._gravity is None:
            if self.robot.current is not self:
                raise self._stale()
            model, data = self.robot.model, self.robot.data
            self._gravity = np.array(pin.computeGeneralizedGravity(model, data, self.q), dtype=np.float64)
        return self._gravity

    def inertia_rate(self) -> Mat:
        """dA/dt ``(nv, nv)``: C + C^T of the Coriolis matrix."""
        self.kinematics()
        robot = self.robot
        C = np.array(pin.computeCoriolisMatrix(robot.model, robot.data, self.q, self.v))
        return np.asarray(C + C.T, dtype=np.float64)

    def momentum_map(self) -> tuple[Mat, Vec]:
        """Centroidal momentum matrix ``(6, nv)``, linear first, and its dJ/dt v ``(6,)``; world axes."""
        self.kinematics()
        robot = self.robot
        rate = np.array(pin.dccrba(robot.model, robot.data, self.q, self.v))
        found = np.array(robot.data.Ag), rate @ self.v
        return carried.momentum(self, *found) if self.loads else found


@cache
def _upper(n: int) -> tuple[Index, Index]:
    """Places above the diagonal."""
    return np.triu_indices(n, 1)


_ZEROS: dict[int, Vec] = {}


def _zeros(n: int) -> Vec:
    if n not in _ZEROS:
        _ZEROS[n] = np.zeros(n)
    return _ZEROS[n]
