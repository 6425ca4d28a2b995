"""Known forces on the robot besides its contacts: wrenches from outside, things it carries, loads of joints."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Index, Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Element, Quantity
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Load, Robot, State
from hqp.numbers import number

from .fields import check_frame, joint_columns, set_names, set_number, set_vector
from .relative import skew


@dataclass(frozen=True, kw_only=True)
class _Load(Element):
    """A term of the equation of motion; no rows.  It belongs into ``subject_to``."""

    quantity: ClassVar[Quantity] = "load"
    is_mass: ClassVar[bool] = False
    """True if it changes centres of mass, so that it affects controllers of velocities and accelerations."""

    def carried(self, reference: Vec) -> Load | None:
        """The point mass on the robot, None for a load that has none."""
        return None

    @abstractmethod
    def terms(self, state: State, reference: Vec) -> tuple[Mat | None, Vec, Vec]:
        """Contributions to A ``(nv, nv)`` (None for nothing), to b + g and to g, ``(nv,)`` each."""


@dataclass(frozen=True, kw_only=True)
class _FrameLoad(_Load):
    """A load at a frame."""

    frame: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)

    def rows(self, robot: Robot) -> int:
        """None; raises FrameNotFound."""
        robot.frame(self.frame)
        return 0


@dataclass(frozen=True, kw_only=True)
class ExternalWrench(_FrameLoad):
    """A wrench w on a frame from outside, measured or known: A qdd + b + g = U^T tau + J_c^T f + J^T w.

    ``at(wrench)`` sets it each tick, force and moment ``(6,)`` [N, N m] at the frame's origin, zero without: in world
    axes, or in the frame's with local.  The dynamics, the forces of contacts, gravity compensation and the command at
    rest include it; without ``resisted`` the last two do not, and a person who pulls at the frame moves the robot.  In
    ``subject_to`` of a torque controller.  Raises DeclarationError for fields, FrameNotFound on binding.
    """

    local: bool = False
    resisted: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        for field in ("local", "resisted"):
            if not isinstance(getattr(self, field), bool):
                raise self.invalid(field, getattr(self, field), "True or False")

    def default_name(self) -> str:
        """The frame and ``_wrench``."""
        return f"{self.frame}_wrench"

    def hold(self, state: State) -> Reference:
        """No wrench."""
        return Reference(self.name, np.zeros(6))

    def at(self, wrench: ArrayLike) -> Reference:
        """The wrench of this tick ``(6,)`` [N, N m]; raises DeclarationError for shapes."""
        return Reference(self.name, numbers(self.name, "wrench", wrench, (6,)))

    def terms(self, state: State, reference: Vec) -> tuple[None, Vec, Vec]:
        """Nothing, -J^T w, -J^T w or zero."""
        w = reference
        if self.local:
            R = state.rotation(self.frame)
            w = np.concatenate((R @ w[:3], R @ w[3:]))
        force = -(state.jacobian(self.frame).T @ w)
        return None, force, force if self.resisted else np.zeros_like(force)

    def plan(self, robot: Robot) -> plans.ExternalWrench:
        """The native operation."""
        return plans.ExternalWrench(plans.frame(robot, self.frame), self.local, self.resisted)


@dataclass(frozen=True, kw_only=True)
class Payload(_FrameLoad):
    """A point mass m carried at a point of a frame: A + m J_p^T J_p, b + g + m J_p^T (dJ_p/dt v - gravity).

    ``at(mass, com)`` sets the mass [kg] and the centre ``(3,)`` [m] in the frame's axes for one tick; the fields mass
    and com are the default.  The dynamics, the forces of contacts, gravity compensation, the command at rest, and
    centres of mass and momenta (Com, SupportPolygon, Momentum) include it.  A negative mass is less than the model has.
    Its own moments of inertia are left out.  In ``subject_to``; for velocities or accelerations only centres of mass
    and momenta include it.  Raises DeclarationError for fields, FrameNotFound on binding.
    """

    is_mass: ClassVar[bool] = True

    mass: float = 0.0
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "mass")
        set_vector(self, "com")

    def default_name(self) -> str:
        """The frame and ``_payload``."""
        return f"{self.frame}_payload"

    def hold(self, state: State) -> Reference:
        """The declared mass and centre."""
        return Reference(self.name, np.array([self.mass, *self.com]))

    def at(self, mass: float, com: ArrayLike | None = None) -> Reference:
        """Mass in this tick [kg], and its centre ``(3,)`` [m]; raises DeclarationError for shapes."""
        where = numbers(self.name, "com", self.com if com is None else com, (3,))
        return Reference(self.name, np.concatenate((numbers(self.name, "mass", [mass], (1,)), where)))

    def terms(self, state: State, reference: Vec) -> tuple[Mat | None, Vec, Vec]:
        """m J_p^T J_p, m J_p^T (dJ_p/dt v - gravity), -m J_p^T gravity."""
        if not reference[0]:
            nothing = np.zeros(state.robot.nv)
            return None, nothing, nothing
        m, arm = float(reference[0]), state.rotation(self.frame) @ reference[1:]
        J, rate, drift = state.jacobian(self.frame), state.velocity(self.frame), state.drift(self.frame)
        J_p = J[:3] - skew(arm) @ J[3:]
        turn = skew(rate[3:])
        a = drift[:3] + skew(drift[3:]) @ arm + turn @ (turn @ arm)
        g = state.robot.gravity
        return m * (J_p.T @ J_p), m * (J_p.T @ (a - g)), -m * (J_p.T @ g)

    def carried(self, reference: Vec) -> Load:
        """The point mass that centres of mass and momenta include."""
        return self.frame, float(reference[0]), reference[1:]

    def plan(self, robot: Robot) -> plans.Payload:
        """The native operation."""
        return plans.Payload(plans.frame(robot, self.frame))


@dataclass(frozen=True, kw_only=True)
class JointLoad(_Load):
    """Torques d of joints beside their motors, and inertias I of their drives: A + S^T diag(I) S, b + g - S^T d,

    S picks the joints: friction, springs, estimated contacts, and servos whose torque falls by I qdd within a tick.

    ``at(torque)`` sets d for one tick ``(k,)`` [N m, N], zero without.  joints: joints or groups, the actuated ones by
    default.  base: true for the wrench on a floating base before them, force and moment ``(6,)`` [N, N m] in its axes:
    the base moves freely under it, and needs no contacts.  inertia: one number for all joints or one for each, at least
    0 [kg m^2, kg].  The dynamics, gravity compensation and the command at rest include d.  In ``subject_to`` of a
    torque controller.
    Raises DeclarationError for fields, JointNotFound on binding.
    """

    joints: str | Sequence[str] | None = None
    inertia: float | Sequence[float] = 0.0
    base: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")
        if not isinstance(self.base, bool):
            raise self.invalid("base", self.base, "True or False")
        if isinstance(self.inertia, Iterable):
            inertias = tuple(number(self.owner, "inertia", inertia, 0.0) for inertia in self.inertia)
            object.__setattr__(self, "inertia", inertias)
        else:
            set_number(self, "inertia", 0.0)

    def default_name(self) -> str:
        """``joint_load``."""
        return "joint_load"

    def rows(self, robot: Robot) -> int:
        """None; raises JointNotFound, DeclarationError."""
        self.inertias(robot)
        return 0

    def inertias(self, robot: Robot) -> tuple[Index, Vec]:
        """(tangent coordinates, inertias) ``(k,)``, the base first; raises DeclarationError for another number."""
        columns = robot.actuated if self.joints is None else joint_columns(self, robot, self.joints)
        given = np.atleast_1d(np.asarray(self.inertia, dtype=np.float64))
        if given.size not in (1, columns.size):
            raise self.invalid("inertia", self.inertia, f"one number, or {columns.size} for {columns.size} joints")
        free = np.arange(6 if self.base and robot.floating else 0, dtype=np.intp)
        return np.concatenate((free, columns)), np.concatenate(
            (np.zeros(free.size), np.broadcast_to(given, columns.shape))
        )

    def hold(self, state: State) -> Reference:
        """No torque."""
        return Reference(self.name, np.zeros(self.inertias(state.robot)[0].size))

    def at(self, torque: ArrayLike) -> Reference:
        """The torques of this tick ``(k,)`` [N m, N]; raises DeclarationError for a value that is not a vector."""
        return Reference(self.name, numbers(self.name, "torque", torque, (np.size(torque),)))

    def terms(self, state: State, reference: Vec) -> tuple[Mat, Vec, Vec]:
        """S^T diag(I) S, -S^T d, -S^T d."""
        columns, inertia = self.inertias(state.robot)
        A, force = np.zeros((state.robot.nv, state.robot.nv)), np.zeros(state.robot.nv)
        A[columns, columns] = inertia
        force[columns] = -reference
        return A, force, force

    def plan(self, robot: Robot) -> plans.JointLoad:
        """The native operation."""
        columns, inertia = self.inertias(robot)
        return plans.JointLoad(tuple(map(int, columns)), tuple(map(float, inertia)))


@dataclass(frozen=True, kw_only=True)
class NominalTorque(_Load):
    """The torque to which the command is nearest in directions that no level determines:

        min (tau - tau_n)^T Phi (tau - tau_n),   Phi the inverse of the inertia that the motors feel,

    so that constraints change tau_n as forces of contacts would (Gauss's principle of least constraint): a joint at its
    limit changes its own motor's torque alone.  ``at(tau)`` sets tau_n ``(n,)`` [N m] in the order of
    ``robot.joint_names``, zero without.  One in ``subject_to`` of a torque controller with ``price=0``, in place of
    ``gravity_compensation``.
    """

    def default_name(self) -> str:
        """``nominal_torque``."""
        return "nominal_torque"

    def rows(self, robot: Robot) -> int:
        """None."""
        return 0

    def hold(self, state: State) -> Reference:
        """No torque."""
        return Reference(self.name, np.zeros(state.robot.actuated.size))

    def at(self, torque: ArrayLike) -> Reference:
        """The torques of this tick ``(n,)`` [N m, N]; raises DeclarationError for a value that is not a vector."""
        return Reference(self.name, numbers(self.name, "torque", torque, (np.size(torque),)))

    def terms(self, state: State, reference: Vec) -> tuple[None, Vec, Vec]:
        """Nothing: it is no force."""
        nothing = np.zeros(state.robot.nv)
        return None, nothing, nothing

    def plan(self, robot: Robot) -> plans.NominalTorque:
        """The native operation."""
        return plans.NominalTorque((robot.actuated.size,))
