"""Torque that holds joints against gravity."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hqp.arrays import Index, Mask, Mat, Vec, cross
from hqp.declare import plans
from hqp.declare.element import Task
from hqp.declare.reference import Given, Reference
from hqp.declare.robot import Robot, State

from .fields import motor_positions, set_names
from .twists import twist_derivatives


@dataclass(frozen=True, kw_only=True)
class HoldingTorque(Task):
    """Torques that hold joints against gravity, as shares of their motors' limits: s_j = -p_j . gravity / tau_max,j,

        p_j = m v_j + w_j x h,   ds_j/dq_i = -(w_j x p_i) . gravity / tau_max,j,   i carried by j (w_i x p_j else),

    with (v_j, w_j) the joint's twist, m and h = m c of all that it carries, payloads too.  Forces of contacts and
    other wrenches are left out: name joints that carry none.  ``Within(HoldingTorque(joints="torso"), lower=-0.8,
    upper=0.8)`` keeps a robot where its motors can hold it; at torque level a session adds this to ``TorqueLimits``.

    joints: joints of one axis, with a motor that has a limit, or groups of them; all such by default.  Raises
    DeclarationError for fields and other joints, JointNotFound on binding.
    """

    joints: str | Sequence[str] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        set_names(self, "joints")

    def columns(self, robot: Robot) -> Index:
        """Coordinates ``(k,)`` of the joints; raises DeclarationError, JointNotFound."""
        columns = robot.actuated[motor_positions(self, robot, self.joints)]
        single = np.array([robot.bodies[b][2] == 1 for b in carriers(robot)], dtype=bool)
        single &= ~pulled(robot)
        fit = single[columns] & np.isfinite(robot.effort_limit[columns]) & (robot.effort_limit[columns] > 0.0)
        if self.joints is None:
            columns, fit = columns[fit], fit[fit]
        if not columns.size or not fit.all():
            raise self.invalid("joints", self.joints, "joints of one axis with a limit of their own motor")
        return columns

    def rows(self, robot: Robot) -> int:
        """Number of joints k; raises DeclarationError, JointNotFound."""
        return self.columns(robot).size

    def value(self, state: State) -> Vec:
        """Shares ``(k,)``, positive where the motor pushes along its axis."""
        parts = carriers(state.robot)
        columns = self.columns(state.robot)
        masses = _masses(state)
        p = np.array([masses[parts[j]] * state.com_jacobian(parts[j])[:, j] for j in columns])
        return -(p @ state.robot.gravity) / state.robot.effort_limit[columns]

    def jacobian(self, state: State) -> Mat:
        """Rates of the shares ``(k, nv)`` [1/rad]."""
        robot, columns, parts = state.robot, self.columns(state.robot), carriers(state.robot)
        state.kinematics()
        w, weight = np.array(robot.joint_twists)[3:].T, -robot.gravity
        masses = _masses(state)
        moved = {body: masses[body] * state.com_jacobian(body) for body in {*parts}}
        own = np.array([moved[body][:, i] for i, body in enumerate(parts)])
        chains = {body: {*_chain(robot, body)} for body in {*parts}}
        J = np.zeros((columns.size, robot.nv))
        for row, j in zip(J, columns, strict=True):
            carried = np.array([parts[j] in chains[body] for body in parts])
            above = np.array([body in chains[parts[j]] for body in parts]) & ~carried
            row[carried] = cross(w[j], own[carried]) @ weight
            row[above] = cross(w[above], own[j]) @ weight
            row /= robot.effort_limit[j]
        return J

    def drift(self, state: State) -> Vec:
        """dJ/dt v ``(k,)`` [1/s^2]."""
        robot, columns, parts = state.robot, self.columns(state.robot), carriers(state.robot)
        _, _, first, second = twist_derivatives(state)
        masses, twists, found = _masses(state), robot.joint_twists, np.empty(columns.size)
        for k, j in enumerate(columns):
            part = parts[j]
            m = masses[part]
            h, rate, change = m * state.com(part), m * state.com_velocity(part), m * state.com_drift(part)
            turning = cross(second[3:, j], h) + 2.0 * cross(first[3:, j], rate) + cross(twists[3:, j], change)
            found[k] = -(m * second[:3, j] + turning) @ robot.gravity / robot.effort_limit[j]
        return found

    def at(self, value: Given = None, *, velocity: Given = None, acceleration: Given = None) -> Reference:
        """Shares to have ``(k,)`` with their rates, all of one length; raises DeclarationError."""
        size = next((np.size(x) for x in (value, velocity, acceleration) if x is not None), 0)
        return self._at((size,), value, velocity, acceleration)

    def row_names(self, robot: Robot) -> tuple[str, ...]:
        """The joints."""
        return tuple(robot.joint_name(int(j)) for j in self.columns(robot))

    def plan(self, robot: Robot) -> plans.HoldingTorque:
        """The native operation."""
        columns = self.columns(robot)
        limits = tuple(robot.effort_limit[columns].tolist())
        return plans.HoldingTorque(tuple(columns.tolist()), limits, tuple(robot.gravity.tolist()))


def pulled(robot: Robot) -> Mask:
    """Coordinates ``(nv,)`` that motors pull together with others: their torques depend on each other."""
    several = np.count_nonzero(robot.actuation, axis=1) > 1
    return np.asarray(np.any(robot.actuation[several] != 0.0, axis=0))


def carriers(robot: Robot) -> list[int]:
    """The body that each coordinate moves first, ``(nv,)``."""
    found = [0] * robot.nv
    for body, (_, first, count, *_) in enumerate(robot.bodies):
        found[first : first + count] = [body] * count
    return found


def _chain(robot: Robot, body: int) -> Iterator[int]:
    """The body and all that carry it."""
    while body:
        yield body
        body = robot.bodies[body][0]


def _masses(state: State) -> list[float]:
    """Masses of the bodies' subtrees with their loads [kg]."""
    robot = state.robot
    found = [mass for *_, mass, _, _ in robot.bodies]
    for frame, mass, _ in state.loads:
        found[robot.body(robot.frame(frame))] += mass
    for body in range(len(found) - 1, 0, -1):
        found[robot.bodies[body][0]] += found[body]
    return found
