"""Robots on Pinocchio: the model, its names and limits, live views for the hot path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from hqp.arrays import Index, Mat, Vec
from hqp.errors import DeclarationError, FrameNotFound, JointNotFound, ModelError

from .state import State

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
        self._bodies: tuple[Any, ...] = ()
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
    def bodies(self) -> tuple[Any, ...]:
        """One for each of the model's joints; what is fixed in the world counts for nothing."""
        if not self._bodies:
            model, found = self.model, []
            for i, placement in enumerate(self.data.oMi):
                joint, inertia = model.joints[i], model.inertias[i]
                first, count, mass = (joint.idx_v, joint.nv, inertia.mass) if i else (0, 0, 0.0)
                views = placement.translation, placement.rotation
                centre = tuple(inertia.lever.tolist())
                found.append((int(model.parents[i]), int(first), int(count), float(mass), centre, views))
            self._bodies = tuple(found)
        return self._bodies

    def body(self, frame: int) -> int:
        """Index of the body that a frame is fixed in."""
        return int(self.model.frames[frame].parentJoint)

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
        """Index of the body that a joint carries; raises JointNotFound."""
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
