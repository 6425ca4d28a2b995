"""Robots on Pinocchio: model, lazily computed state, live views for the hot path."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from hqp.arrays import Index, Mat, Vec
from hqp.errors import DeclarationError, FrameNotFound, JointNotFound, ModelError, StaleState

_WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
_UNLIMITED = 1e6  # a limit at or beyond this [rad, m] is no limit


@dataclass(frozen=True)
class Wheel:
    """A wheel's radius [m] and its axle, a unit vector in the wheel's frame."""

    radius: float
    axle: tuple[float, float, float]


class Robot:
    """A Pinocchio model with one Data; see hqp.robot.Robot for what the properties mean.

    model: a pinocchio.Model, floating if its first joint is a free flyer.  actuated: names of the actuated
    joints, all single-axis joints by default.  groups: joint groups by name.  home: ``(nq,)``.
    wheels: by frame.  landmarks: frames by role, such as ``soles``, ``palms``, ``base``.
    Raises ModelError where the model has joints that are neither free flyer nor single-axis.
    """

    log3 = staticmethod(pin.log3)

    def __init__(
        self,
        model: Any,
        *,
        name: str | None = None,
        actuated: Sequence[str] | None = None,
        groups: Mapping[str, Sequence[str]] | None = None,
        home: Vec | None = None,
        wheels: Mapping[str, Wheel] | None = None,
        landmarks: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        self.model = model
        self.data = model.createData()
        self.name: str = name or model.name
        self.nq, self.nv = int(model.nq), int(model.nv)
        self.floating = model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer"
        self._columns = self._read_joints()
        self.groups = {key: tuple(value) for key, value in (groups or {}).items()}
        self.wheels = dict(wheels or {})
        self.landmarks = {key: tuple(value) for key, value in (landmarks or {}).items()}
        self.joint_names = tuple(self._columns) if actuated is None else tuple(actuated)
        self.actuated: Index = np.array([self._column(n) for n in self.joint_names], dtype=np.intp)
        self.lower, self.upper, self.velocity_limit, self.effort_limit = self._read_limits()
        self.frame_names: tuple[str, ...] = tuple(f.name for f in model.frames)
        self._frames = {n: i for i, n in reversed(list(enumerate(self.frame_names)))}
        self.home: Vec = pin.neutral(model) if home is None else np.array(home, dtype=np.float64)
        if self.home.shape != (self.nq,):
            raise DeclarationError(self.name, f"home has shape {self.home.shape}", allowed=f"({self.nq},)")
        self._views: dict[int, tuple[Vec, Mat]] = {}
        self.current: State | None = None

    def _read_joints(self) -> dict[str, int]:
        model = self.model
        columns: dict[str, int] = {}
        single: list[tuple[int, int]] = []
        double: list[tuple[int, int]] = []
        for i in range(2 if self.floating else 1, model.njoints):
            joint = model.joints[i]
            if joint.nv != 1:
                raise ModelError(
                    f"{self.name}: joint {model.names[i]!r} is a {joint.shortname()}; "
                    "hqp takes a free flyer as first joint and single-axis joints after it"
                )
            columns[model.names[i]] = joint.idx_v
            (single if joint.nq == 1 else double).append((joint.idx_v, joint.idx_q))
        pairs: Index = np.array(single, dtype=np.intp).reshape(-1, 2)
        self._single_v, self._single_q = pairs[:, 0].copy(), pairs[:, 1].copy()
        self._double = tuple(double)
        self.continuous: Index = np.array([v for v, _ in double], dtype=np.intp)
        return columns

    def _read_limits(self) -> tuple[Vec, Vec, Vec, Vec]:
        model = self.model
        lower, upper = np.full(self.nv, -np.inf), np.full(self.nv, np.inf)
        lower[self._single_v] = model.lowerPositionLimit[self._single_q]
        upper[self._single_v] = model.upperPositionLimit[self._single_q]
        velocity, effort = np.array(model.velocityLimit), np.array(model.effortLimit)
        if self.floating:
            velocity[:6] = effort[:6] = np.inf
        for limit in (lower, upper, velocity, effort):
            limit[np.abs(limit) >= _UNLIMITED] = np.copysign(np.inf, limit[np.abs(limit) >= _UNLIMITED])
        velocity[velocity <= 0.0] = np.inf  # zero in a description means that nobody gave one
        effort[effort <= 0.0] = np.inf
        unset = lower >= upper
        lower[unset], upper[unset] = -np.inf, np.inf
        return lower, upper, velocity, effort

    def _column(self, joint: str) -> int:
        try:
            return self._columns[joint]
        except KeyError:
            raise JointNotFound(joint, [*self._columns, *self.groups], self.name) from None

    @property
    def actuation(self) -> Mat:
        """U ``(n_actuated, nv)``: maps generalised to actuated velocities (Sentis 2012, eq. 6)."""
        U = np.zeros((self.actuated.size, self.nv))
        U[np.arange(self.actuated.size), self.actuated] = 1.0
        return U

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(pin.computeTotalMass(self.model))

    def frame(self, name: str) -> int:
        """Index of a frame; raises FrameNotFound with the closest names."""
        try:
            return self._frames[name]
        except (KeyError, TypeError):
            raise FrameNotFound(str(name), self.frame_names, self.name) from None

    def joints(self, names: str | Sequence[str] | None = None) -> Index:
        """Tangent coordinates of joints or groups, all single-axis joints for None; raises JointNotFound."""
        if names is None:
            return np.array(list(self._columns.values()), dtype=np.intp)
        found: list[int] = []
        for name in (names,) if isinstance(names, str) else names:
            members = self.groups.get(name)
            found += [self._column(name)] if members is None else [self._column(m) for m in members]
        return np.array(found, dtype=np.intp)

    def joint_name(self, column: int) -> str:
        """Name of the joint of a tangent coordinate, 'base' for the free base."""
        return next((name for name, c in self._columns.items() if c == column), "base")

    def placement(self, frame: int) -> tuple[Vec, Mat]:
        """Live views of a frame's position and rotation in the world, as of the current state."""
        if frame not in self._views:
            placement = self.data.oMf[frame]
            self._views[frame] = (placement.translation, placement.rotation)
        return self._views[frame]

    @property
    def centre(self) -> tuple[Vec, Mat]:
        """Live views of the centre of mass and its Jacobian, once the state has computed them."""
        return self.data.com[0], self.data.Jcom

    def positions(self, columns: Index) -> list[int] | None:
        """Places in q of single-axis joints, None if one of them is continuous (two numbers in q)."""
        places = dict(zip(self._single_v.tolist(), self._single_q.tolist(), strict=True))
        found = [places.get(c) for c in columns.tolist()]
        return None if None in found else [i for i in found if i is not None]

    def support(self, frame: int) -> Vec:
        """1 for each tangent coordinate that moves the frame, 0 elsewhere, ``(nv,)``."""
        mask = np.zeros(self.nv)
        joint = self.model.frames[frame].parentJoint
        while joint > 0:
            model = self.model.joints[joint]
            mask[model.idx_v : model.idx_v + model.nv] = 1.0
            joint = self.model.parents[joint]
        return mask

    @property
    def joint_twists(self) -> Mat:
        """Live view ``(6, nv)``: world twist at the origin of each tangent coordinate, linear first."""
        return self.data.J  # type: ignore[no-any-return]

    def subtree(self, joint: str) -> int:
        """Index of the subtree that hangs on a joint; raises JointNotFound."""
        self._column(joint)
        return int(self.model.getJointId(joint))

    def state(self, q: Vec | None = None, v: Vec | None = None) -> State:
        """Move the robot to (q, v), home at rest by default; earlier states become stale.

        Raises ModelError for wrong shapes; NaN is taken and shows as ``state.finite``.
        """
        state = State(self, self.home if q is None else q, v)
        self.current = state
        return state

    def integrate(self, q: Vec, v: Vec, dt: float) -> Vec:
        """The configuration after moving with velocity v for dt [s]."""
        return pin.integrate(self.model, q, v * dt)  # type: ignore[no-any-return]

    def difference(self, q0: Vec, q1: Vec) -> Vec:
        """The tangent vector from q0 to q1."""
        return pin.difference(self.model, q0, q1)  # type: ignore[no-any-return]

    def random_configuration(self, rng: np.random.Generator, spread: float = 1.0) -> Vec:
        """Home plus a random tangent step: joints within limits, the base within ``spread`` [m, rad]."""
        step = rng.uniform(-spread, spread, self.nv)
        q = self.integrate(self.home, step, 1.0)
        for v, i in zip(self._single_v, self._single_q, strict=True):
            low, high = max(self.lower[v], -np.pi), min(self.upper[v], np.pi)
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            q[i] = middle + 0.95 * half * rng.uniform(-1.0, 1.0) * min(spread, 1.0)
        return q

    def copy(self) -> Robot:
        """The same robot with data of its own; the model is shared."""
        return Robot(
            self.model,
            name=self.name,
            actuated=self.joint_names,
            groups=self.groups,
            home=self.home,
            wheels=self.wheels,
            landmarks=self.landmarks,
        )

    def __repr__(self) -> str:
        base = "floating" if self.floating else "fixed"
        return f"<Robot {self.name}: {base} base, nv = {self.nv}, {len(self.joint_names)} actuated>"


class State:
    """One (q, v) of a robot; see hqp.robot.State.  Computes each quantity when first asked for, and once."""

    __slots__ = ("_done", "_gravity", "finite", "q", "robot", "v")

    def __init__(self, robot: Robot, q: Vec, v: Vec | None) -> None:
        self.robot = robot
        self.q = np.array(q, dtype=np.float64)
        self.v = np.zeros(robot.nv) if v is None else np.array(v, dtype=np.float64)
        if self.q.shape != (robot.nq,) or self.v.shape != (robot.nv,):
            raise ModelError(
                f"{robot.name}: a state takes q ({robot.nq},) and v ({robot.nv},), "
                f"given {self.q.shape} and {self.v.shape}"
            )
        # a dot product is finite only if every entry is (entries whose square overflows are no states either)
        self.finite = bool(self.q @ self.q + self.v @ self.v < math.inf)
        self._done = 0
        self._gravity: Vec | None = None

    def _compute(self, what: int) -> None:
        robot = self.robot
        if robot.current is not self:
            raise StaleState(f"{robot.name} has moved on to another state; ask robot.state(q, v) again")
        model, data = robot.model, robot.data
        if what == _KINEMATICS:
            pin.computeJointJacobians(model, data, self.q)
            pin.updateFramePlacements(model, data)
        elif what == _COM:
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
            pin.crba(model, data, self.q, pin.Convention.WORLD)
        elif what == _MASS:
            self._need(_INERTIA)
            upper = np.triu_indices(robot.nv, 1)
            data.M.T[upper] = data.M[upper]
        elif what == _BIAS:
            pin.nonLinearEffects(model, data, self.q, self.v)
        self._done |= what

    def kinematics(self) -> None:
        """Make placements and joint_twists those of this state; raises StaleState."""
        if not self._done & _KINEMATICS or self.robot.current is not self:
            self._compute(_KINEMATICS)

    def _need(self, what: int) -> None:
        if not self._done & what or self.robot.current is not self:
            self._compute(what)

    @property
    def angles(self) -> Vec:
        """Joint positions by tangent coordinate ``(nv,)``, zero for the free base."""
        robot = self.robot
        angles = np.zeros(robot.nv)
        angles[robot._single_v] = self.q[robot._single_q]
        for v, i in robot._double:
            angles[v] = math.atan2(self.q[i + 1], self.q[i])
        return angles

    def difference(self, q: Vec) -> Vec:
        """Tangent vector from q to this state's configuration, ``(nv,)``."""
        return self.robot.difference(q, self.q)

    def position(self, frame: str) -> Vec:
        """Origin of a frame in the world, ``(3,)`` [m]."""
        self.kinematics()
        return self.robot.placement(self.robot.frame(frame))[0].copy()

    def rotation(self, frame: str) -> Mat:
        """Rotation of a frame in the world, ``(3, 3)``."""
        self.kinematics()
        return np.array(self.robot.placement(self.robot.frame(frame))[1], order="C")

    def jacobian(self, frame: str) -> Mat:
        """Geometric Jacobian ``(6, nv)`` of a frame, linear first, world axes."""
        self.kinematics()
        robot = self.robot
        return pin.getFrameJacobian(robot.model, robot.data, robot.frame(frame), _WORLD)  # type: ignore[no-any-return]

    def velocity(self, frame: str) -> Vec:
        """Velocity ``(6,)`` of a frame's origin [m/s] and its rotation [rad/s], world axes."""
        return self.jacobian(frame) @ self.v

    def drift(self, frame: str) -> Vec:
        """dJ/dt v of a frame's geometric Jacobian: its acceleration at zero generalised acceleration."""
        self._need(_DRIFT)
        robot = self.robot
        motion = pin.getFrameClassicalAcceleration(robot.model, robot.data, robot.frame(frame), _WORLD)
        return np.concatenate((motion.linear, motion.angular))

    def com(self, subtree: int = 0) -> Vec:
        """Centre of mass of the robot or a subtree, ``(3,)`` [m]."""
        if subtree == 0:
            self._need(_COM)
            return np.array(self.robot.data.com[0])
        self._need(_SUBTREES)
        placement = self.robot.data.oMi[subtree]
        return np.array(placement.translation + placement.rotation @ self.robot.data.com[subtree])

    def com_jacobian(self, subtree: int = 0) -> Mat:
        """Jacobian of the centre of mass, ``(3, nv)``: a live view where subtree is 0."""
        robot = self.robot
        if subtree == 0:
            self._need(_COM)
            return robot.data.Jcom  # type: ignore[no-any-return]
        self.kinematics()
        self._done &= ~(_COM | _SUBTREES)  # Pinocchio writes the subtree's Jacobian over the whole robot's
        return np.array(pin.jacobianSubtreeCenterOfMass(robot.model, robot.data, subtree))

    def com_velocity(self, subtree: int = 0) -> Vec:
        """Velocity of the centre of mass, ``(3,)`` [m/s]."""
        return self.com_jacobian(subtree) @ self.v

    def com_drift(self, subtree: int = 0) -> Vec:
        """dJ/dt v of the centre of mass, ``(3,)``."""
        self._need(_SUBTREES)
        data = self.robot.data
        return np.array(data.oMi[subtree].rotation @ data.acom[subtree])

    def dynamics(self) -> None:
        """Make kinematics, drifts, ``inertia`` and ``bias_force`` those of this state; raises StaleState."""
        for what in (_KINEMATICS, _DRIFT, _INERTIA, _BIAS):
            self._need(what)

    def inertia(self) -> Mat:
        """Upper triangle of A, ``(nv, nv)``, what lies below it is not meant; a live view."""
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
                self._compute(_KINEMATICS)
            model, data = self.robot.model, self.robot.data
            self._gravity = np.array(pin.computeGeneralizedGravity(model, data, self.q), dtype=np.float64)
        return self._gravity


_KINEMATICS, _COM, _SUBTREES, _DRIFT, _INERTIA, _MASS, _BIAS = (1 << i for i in range(7))
_ZEROS: dict[int, Vec] = {}


def _zeros(n: int) -> Vec:
    if n not in _ZEROS:
        _ZEROS[n] = np.zeros(n)
    return _ZEROS[n]
