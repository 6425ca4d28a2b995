"""Orientation of a frame: the whole rotation, or roll, pitch, yaw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hqp.angles import all_wrapped
from hqp.arrays import Mat, Vec
from hqp.declare import plans
from hqp.declare.element import Task, Unit
from hqp.declare.reference import Given, Reference, numbers
from hqp.declare.robot import Robot, State

from .fields import check_frame, check_relative, make_reference, set_names
from .relative import UPRIGHT, View
from .rotations import GIMBAL, as_rotation, axes_rate, rate_rows, roll_pitch_yaw

ANGLES = ("roll", "pitch", "yaw")


@dataclass(frozen=True, kw_only=True)
class Orientation(Task):
    """Orientation R of a frame: e = log(R R_ref^T) ``(3,)``, or named angles of R, e = angles - ref ``(k,)``.

    frame: whose rotation.  axes: None for the whole rotation, with J the angular geometric Jacobian and reference a
    matrix ``(3, 3)`` or quaternion xyzw; else one or more of "roll", "pitch", "yaw" of R = Rz(yaw) Ry(pitch)
    Rx(roll), in that order of rows, with J = E(rpy)^-1 J_omega, the error wrapped to (-pi, pi] and the reference as
    many angles [rad].  relative_to: frame in whose axes R, error and J are, the world by default.
    Roll and yaw mean nothing at pitch = +-90 degrees; J stays bounded there.
    Raises DeclarationError for fields, FrameNotFound on binding (Mistry 2008, eqs. 14, 15, with the analytic J).
    """

    frame: str
    axes: str | tuple[str, ...] | None = None
    relative_to: str | None = None
    units: ClassVar[tuple[Unit, ...]] = ("rad",)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_frame(self, "frame", self.frame)
        check_relative(self, self.relative_to)
        set_names(self, "axes")
        if not set(self._names) <= set(ANGLES):
            raise self.invalid("axes", self.axes, "None or some of roll, pitch, yaw")

    @property
    def _names(self) -> tuple[str, ...]:
        return () if self.axes is None else (self.axes,) if isinstance(self.axes, str) else self.axes

    @property
    def _indices(self) -> list[int]:
        return [ANGLES.index(name) for name in self._names]

    @property
    def rotation_rows(self) -> int | None:
        """0 without axes."""
        return 0 if self.axes is None else None

    def rows(self, robot: Robot) -> int:
        """3, or as many as axes; raises FrameNotFound."""
        robot.frame(self.frame)
        if self.relative_to is not None:
            robot.frame(self.relative_to)
        return 3 if self.axes is None else len(self._names)

    def value(self, state: State) -> Vec | Mat:
        """R ``(3, 3)``, or the angles ``(k,)`` [rad]."""
        R = self._rotation(state)
        return R if self.axes is None else np.array(roll_pitch_yaw(R.tolist()))[self._indices]

    def error(self, state: State, reference: Mat) -> Vec:
        """log(R R_ref^T) ``(3,)``, or the angles minus theirs, wrapped, ``(k,)`` [rad]."""
        if self.axes is None:
            return state.robot.log3(self.value(state) @ reference.T)
        return all_wrapped(self.value(state) - reference)

    def jacobian(self, state: State) -> Mat:
        """J ``(m, nv)`` of the angular velocity, or of the angles."""
        J = state.jacobian(self.frame)[3:]
        if self.relative_to is not None:
            J = View(state, self.relative_to).turn_jacobian(J)
        if self.axes is None:
            return J
        _, pitch, yaw = roll_pitch_yaw(self._rotation(state).tolist())
        return np.array(rate_rows(pitch, yaw))[self._indices] @ J

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(m,)`` [rad/s^2]."""
        drift = state.drift(self.frame)[3:]
        if self.axes is None and self.relative_to is None:
            return drift
        omega = state.velocity(self.frame)[3:]
        if self.relative_to is not None:
            view = View(state, self.relative_to)
            drift, omega = (
                view.turn_drift(omega, drift),
                view.rotation.T @ (omega - state.velocity(self.relative_to)[3:]),
            )
        if self.axes is None:
            return drift
        _, pitch, yaw = roll_pitch_yaw(self._rotation(state).tolist())
        rates = np.array(rate_rows(pitch, yaw))
        left = np.array(axes_rate(pitch, yaw, (rates @ omega).tolist()))
        angle_drift: Vec = rates[self._indices] @ (drift - left)
        return angle_drift

    def _rotation(self, state: State) -> Mat:
        R = state.rotation(self.frame)
        return R if self.relative_to is None else state.rotation(self.relative_to).T @ R

    def at(self, value: Given = None, *, velocity: Given = None, acceleration: Given = None) -> Reference:
        """Target rotation, or angles ``(k,)`` [rad], with angular or angle velocity [rad/s] and acceleration [rad/s^2].

        Raises DeclarationError for wrong shapes or a matrix that is no rotation.
        """
        if self.axes is None:
            remarks: list[str] = []
            R = None if value is None else as_rotation(self.name, value, remarks)
            return make_reference(self.name, 3, R, velocity, acceleration, remarks)
        k = len(self._names)
        if k == 1:  # a number will do
            given = value, velocity, acceleration
            value, velocity, acceleration = (None if x is None else np.array(x, ndmin=1) for x in given)
        angles = None if value is None else numbers(self.name, "value", value, (k,))
        return make_reference(self.name, k, angles, velocity, acceleration)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The angles, or the axes of rotation."""
        return self._names or ("rx", "ry", "rz")

    def plan(self, robot: Robot) -> plans.Rotation | plans.Angles:
        """The native operation."""
        relative = plans.relative_frame(robot, self.relative_to, False, UPRIGHT)
        own = plans.apart(plans.frame(robot, self.frame), relative)
        return plans.Rotation(*own) if self.axes is None else plans.Angles(*own, tuple(self._indices), GIMBAL)
