"""Motion that something else gives: coordinates as they are measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hqp.arrays import Index, Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Constraint, Task, Unit
from hqp.declare.reference import Reference, numbers
from hqp.declare.robot import Robot, State

from .fields import joint_columns, set_names


@dataclass(frozen=True, kw_only=True)
class PrescribedMotion(Task, Constraint):
    """Coordinates that another controller moves, as the state has them: the velocity v_j is measured, not commanded,

        x_j = v_j + dt a_j,    where x is an acceleration    x_j = a_j    ``(k,)``,

    a the reference's acceleration, zero by default.  In ``subject_to`` it stands before all else: limits, distances and
    tasks include this motion and cannot change it; rows that only these coordinates enter are met or violated, so let
    ``JointLimits`` name the other joints.  At torque level the dynamics keep it, like contacts: the forces
    of its coordinates are reactions, which the other controller's motors, the ground or a hand provide, and its motors
    have no part in x.

    joints: joints or groups.  base: true for the six coordinates of a floating base, too; no effect on a fixed
    base.  Raises DeclarationError for fields, a law, joints named twice and no coordinates, JointNotFound on binding
    (prescribed motion: Featherstone 2008, section 9.6, hybrid dynamics).
    """

    steered: ClassVar[bool] = True
    units: ClassVar[tuple[Unit, ...]] = ("rad",)

    joints: str | Sequence[str] = ()
    base: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.joints != ():
            set_names(self, "joints")
        if self.joints is None:
            raise self.invalid("joints", None, "names of joints or groups, or () for the base alone")
        if not isinstance(self.base, bool):
            raise self.invalid("base", self.base, "True or False")
        if self.law is not None:
            raise self.invalid("law", self.law, "None: measured motion is not corrected")

    def rows(self, robot: Robot) -> int:
        """Number of coordinates k; raises JointNotFound, DeclarationError."""
        return self.selection(robot).size

    def selection(self, robot: Robot) -> Index:
        """Tangent coordinates ``(k,)``, those of the base first; raises JointNotFound, DeclarationError."""
        base = np.arange(6 if self.base and robot.floating else 0, dtype=np.intp)
        joints = joint_columns(self, robot, self.joints) if self.joints else np.zeros(0, dtype=np.intp)
        if base.size + joints.size == 0:
            raise self.invalid(
                "joints", self.joints, "at least one joint, or base=True on a robot with a floating base"
            )
        return np.concatenate((base, joints))

    def value(self, state: State) -> Vec:
        """Zero ``(k,)``: there is no place to come back to."""
        return np.zeros(self.rows(state.robot))

    def error(self, state: State, reference: Any) -> Vec:
        """Zero ``(k,)`` for any reference."""
        return np.zeros(self.rows(state.robot))

    def jacobian(self, state: State, value: Any = None) -> Mat:
        """A row of the identity for each coordinate, ``(k, nv)``."""
        return np.eye(state.robot.nv)[self.selection(state.robot)]

    def drift(self, state: State, value: Any = None) -> Vec:
        """Zero ``(k,)``."""
        return np.zeros(self.rows(state.robot))

    def step_bounds(
        self,
        state: State,
        dt: float,
        order: int,
        value: Any = None,
        velocity: Vec | None = None,
        acceleration: Vec | None = None,
    ) -> tuple[Vec, Vec]:
        """(x_j, x_j) ``(k,)``; the velocity is that of the state, also after other commands."""
        x = np.zeros(self.rows(state.robot)) if acceleration is None else np.array(acceleration, dtype=np.float64)
        if order == 1:
            x = state.v[self.selection(state.robot)] + dt * x
        return x, x

    def at(self, value: Any = None, *, velocity: Any = None, acceleration: Any = None) -> Reference:
        """Accelerations ``(k,)`` [rad/s^2, m/s^2] of this tick; raises DeclarationError for a value or a velocity."""
        for what, given in (("value", value), ("velocity", velocity)):
            if given is not None:
                raise self.invalid(what, given, "None: positions and velocities come with the state")
        if acceleration is None:
            return Reference(self.name)
        a = numbers(self.name, "acceleration", np.atleast_1d(np.asarray(acceleration)), (np.size(acceleration),))
        return Reference(self.name, np.zeros(a.size), None, a)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The joints; coordinates of the base as ``base x``, ``base yaw``."""
        own = self.selection(robot)
        base = tuple(f"base {axis}" for axis in ("x", "y", "z", "roll", "pitch", "yaw"))
        first = 6 if self.base and robot.floating else 0
        return (*base[:first], *(robot.joint_name(int(c)) for c in own[first:]))

    def plan(self, robot: Robot) -> plans.Prescribed:
        """The native operation."""
        return plans.Prescribed(tuple(self.selection(robot).tolist()))
