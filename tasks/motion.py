"""Motion itself: joint velocities, damping, low acceleration, momentum, and how fast a free base may go."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hqp.arrays import Index, Mat, Vec, floats
from hqp.declare import plans
from hqp.declare.element import Inequality, Task, Unit
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot, State
from hqp.errors import ProblemError

from .fields import check_axes, indices, joint_columns, set_names, set_number


@dataclass(frozen=True, kw_only=True)
class _RateTask(Task):
    """A velocity that is wanted for itself: e = 0, so that J x is the reference's velocity, zero by default.

    For accelerations, J x = a_ref - kd (J v - v_ref) - dJ/dt v.  A base class for tasks of one's own.
    """

    def value(self, state: State) -> Vec:
        """Zero ``(m,)``: there is no place to come back to."""
        return np.zeros(self.rows(state.robot))

    def at(self, value: Any = None, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """Velocity and acceleration ``(m,)`` to have; raises DeclarationError for a value that is not zero."""
        try:
            placed = value is not None and bool(np.any(floats("value", value)))
        except ProblemError:
            placed = True
        if placed:
            raise self.invalid("value", value, "None, this task follows velocity=...")
        given = [None if x is None else np.atleast_1d(np.asarray(x)) for x in (velocity, acceleration)]
        size = next((np.size(x) for x in given if x is not None), 0)
        rate, change = (
            None if x is None else numbers(self.name, what, x, (size,))
            for what, x in zip(("velocity", "acceleration"), given, strict=True)
        )
        return Reference(self.name, np.zeros(size) if size else None, rate, change)


@dataclass(frozen=True, kw_only=True)
class JointVelocity(_RateTask):
    """Velocities of joints: x_j = v_ref ``(k,)`` [rad/s or m/s], zero by default, which damps those joints.

    joints: joints or groups, all by default.  For accelerations x_j = a_ref - kd (v_j - v_ref).  Raises
    DeclarationError for fields, JointNotFound on binding.
    """

    units: ClassVar[tuple[Unit, ...]] = ("rad",)

    joints: str | Sequence[str] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")

    def rows(self, robot: Robot) -> int:
        """Number of tangent coordinates k; raises JointNotFound."""
        return self.selection(robot).size

    def selection(self, robot: Robot) -> Index:
        """Tangent coordinates of the joints ``(k,)``; raises JointNotFound, DeclarationError for one named twice."""
        return joint_columns(self, robot, self.joints)

    def jacobian(self, state: State) -> Mat:
        """A row of the identity for each, ``(k, nv)``."""
        return np.eye(state.robot.nv)[self.selection(state.robot)]

    def drift(self, state: State) -> Vec:
        """Zero ``(k,)``."""
        return np.zeros(self.rows(state.robot))

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The joints."""
        return tuple(robot.joint_name(int(c)) for c in self.selection(robot))

    def plan(self, robot: Robot) -> plans.Still:
        """The native operation."""
        return plans.Still(tuple(self.selection(robot).tolist()))


@dataclass(frozen=True, kw_only=True)
class LowAcceleration(Task):
    """Least change of velocity: x = v_last, where x is an acceleration x = 0; no law, no reference.

    nv rows; v_last is the velocity that was sent last, or that of the state.  A task for a low level: in the null space
    of the levels above the robot continues its motion, and comes to rest only if another element demands it.
    """

    def rows(self, robot: Robot) -> int:
        """nv."""
        return robot.nv

    def selection(self, robot: Robot) -> Index:
        """All tangent coordinates."""
        return np.arange(robot.nv, dtype=np.intp)

    def value(self, state: State) -> Vec:
        """Zero ``(nv,)``: there is no place to come back to."""
        return np.zeros(state.robot.nv)

    def error(self, state: State, reference: Any) -> Vec:
        """Zero ``(nv,)`` for any reference."""
        return np.zeros(state.robot.nv)

    def hold(self, state: State) -> Reference:
        """None."""
        return Reference(self.name)

    def jacobian(self, state: State) -> Mat:
        """The identity ``(nv, nv)``."""
        return np.eye(state.robot.nv)

    def drift(self, state: State) -> Vec:
        """Zero ``(nv,)``."""
        return np.zeros(state.robot.nv)

    def step_bounds(self, state: State, dt: float, order: int) -> tuple[Vec, Vec]:
        """(v_last, v_last) or (0, 0), ``(nv,)``."""
        last = state.v if state.commanded is None else state.commanded
        wanted = np.array(last) if order == 1 else np.zeros(state.robot.nv)
        return wanted, wanted

    def plan(self, robot: Robot) -> plans.Steady:
        """The native operation."""
        return plans.Steady(tuple(range(robot.nv)))


@dataclass(frozen=True, kw_only=True)
class Damping(_RateTask):
    """The whole motion damped: J = 1, or with kinetic_energy J = L^T with A = L L^T, |J v|^2 / 2 the kinetic energy.

    nv rows; e = 0 and the reference zero, so that x = 0 at velocity level; for accelerations J x = -kd J v - dJ/dt v.
    Raises DeclarationError for fields.
    """

    kinetic_energy: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.kinetic_energy, bool):
            raise self.invalid("kinetic_energy", self.kinetic_energy, "True or False")

    def rows(self, robot: Robot) -> int:
        """nv."""
        return robot.nv

    def selection(self, robot: Robot) -> Index | None:
        """All tangent coordinates, unless it is by kinetic energy."""
        return None if self.kinetic_energy else np.arange(robot.nv, dtype=np.intp)

    def jacobian(self, state: State) -> Mat:
        """1 or L^T, ``(nv, nv)``."""
        if not self.kinetic_energy:
            return np.eye(state.robot.nv)
        return np.asarray(np.linalg.cholesky(np.array(state.mass_matrix())).T, dtype=np.float64)

    def drift(self, state: State) -> Vec:
        """dL^T/dt v ``(nv,)`` with dL/dt = L Phi(L^-1 dA/dt L^-T), Phi the lower triangle, its diagonal halved."""
        if not self.kinetic_energy:
            return np.zeros(state.robot.nv)
        rate = state.inertia_rate()
        L = np.linalg.cholesky(np.array(state.mass_matrix()))
        inner = np.tril(np.linalg.solve(L, np.linalg.solve(L, rate).T))
        inner[np.diag_indices_from(inner)] *= 0.5
        return np.asarray((L @ inner).T @ state.v)

    def plan(self, robot: Robot) -> plans.Still | plans.KineticEnergy:
        """The native operation."""
        if not self.kinetic_energy:
            return plans.Still(tuple(range(robot.nv)))
        return plans.KineticEnergy(tuple(robot.inertias), tuple(robot.rotors.tolist()))


@dataclass(frozen=True, kw_only=True)
class Momentum(_RateTask):
    """Centroidal momentum: A(q) x = h_ref, linear m c' [kg m/s] and angular about the centre of mass [kg m^2/s],

    world axes; for accelerations A x = h'_ref - kd (A v - h_ref) - dA/dt v.  The reference is zero by default,
    ``at(velocity=h_ref, acceleration=h'_ref)`` gives another.

    linear, angular: the axes controlled, k letters of "xyz" in all; either may be empty.
    Raises DeclarationError for fields (Orin and Goswami 2008, eq. 14).
    """

    linear: str = "xyz"
    angular: str = "xyz"

    def __post_init__(self) -> None:
        super().__post_init__()
        for axes in (self.linear, self.angular):
            if axes != "" or not (self.linear or self.angular):
                check_axes(self, axes)

    def _picked(self) -> list[int]:
        return [*indices(self.linear or ""), *(3 + i for i in indices(self.angular or ""))]

    def rows(self, robot: Robot) -> int:
        """Number of axes."""
        return len(self._picked())

    def jacobian(self, state: State) -> Mat:
        """A ``(k, nv)``."""
        return state.momentum_map()[0][self._picked()]

    def drift(self, state: State) -> Vec:
        """dA/dt v ``(k,)`` [N, N m]."""
        return state.momentum_map()[1][self._picked()]

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes."""
        return (*(f"linear {a}" for a in self.linear), *(f"angular {a}" for a in self.angular))

    def plan(self, robot: Robot) -> plans.Momentum:
        """The native operation."""
        return plans.Momentum(tuple(self._picked()), tuple(robot.inertias))


@dataclass(frozen=True, kw_only=True)
class BaseVelocityLimits(Inequality):
    """Speed of a free base: |v| <= linear [m/s] and |omega| <= angular [rad/s], along each axis of the base.

    For accelerations the bounds are on v + dt x.  Raises DeclarationError for fields, and on binding to a robot whose
    base is fixed.
    """

    linear: float = 1.0
    angular: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "linear", 0.0, strict=True)
        set_number(self, "angular", 0.0, strict=True)

    def rows(self, robot: Robot) -> int:
        """6; raises DeclarationError for a fixed base."""
        if not robot.floating:
            raise self.invalid("robot", robot.name, "a robot with a free base")
        return 6

    def selection(self, robot: Robot) -> Index:
        """The six coordinates of the base; raises DeclarationError for a fixed base."""
        return np.arange(self.rows(robot), dtype=np.intp)

    def jacobian(self, state: State) -> Mat:
        """The first rows of the identity, ``(6, nv)``."""
        return np.eye(6, state.robot.nv)

    def bounds(self, state: State) -> tuple[float, float]:
        """No bounds on where the base is."""
        return -math.inf, math.inf

    def step_bounds(self, state: State, dt: float, order: int) -> tuple[Vec, Vec]:
        """(lower, upper) ``(6,)`` of the base's velocity, or of its acceleration for one period."""
        fastest = np.repeat((self.linear, self.angular), 3)
        if order == 1:
            return -fastest, fastest
        return (-fastest - state.v[:6]) / dt, (fastest - state.v[:6]) / dt

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The axes."""
        return ("x", "y", "z", "roll", "pitch", "yaw")

    def plan(self, robot: Robot) -> plans.JointBox:
        """The native operation: joints without position limits, whose places in q mean nothing."""
        base, none = plans.Joints(tuple(range(6)), (0,) * 6, (False,) * 6), (math.inf,) * 6
        speed = (self.linear,) * 3 + (self.angular,) * 3
        return plans.JointBox(base, (-math.inf,) * 6, none, speed, none, none, math.inf, 1.0)
