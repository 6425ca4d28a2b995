"""A net under stacks that bound no torques themselves: a few times the robot's motor torques."""

from __future__ import annotations

import math

import numpy as np

from hqp.arrays import Vec, rank
from hqp.declare.law import P
from hqp.declare.robot import Robot
from hqp.declare.stack import Stack
from hqp.programs.assembly import Assembly
from hqp.torque.gravity import holding_torque
from hqp.torque.motor_axes import passive_motions
from hqp.torque.reactions import reactions

OVERLOAD = 3.0
"""Fraction of a motor's limit: more is no plan but a singularity of the dynamics.  A motor that is a little too weak
for a target would, at its limit, set the whole body moving to make up for it: users can declare this themselves."""


def within_motors(stack: Stack, robot: Robot) -> tuple[Stack, str]:
    """The stack with ``TorqueLimits(scale=OVERLOAD)`` before everything else, and a note on omitted motors.

    A stack with bounds on torques in ``subject_to`` stays as it is.  Left out are joints for which that is not enough
    to hold the robot at home on the stack's contacts: it is a wrong number, and the robot would sink without a word.
    """
    if any(e.quantity == "effort" for e in stack.subject_to):
        return stack, ""
    names = [robot.joint_names[i] for i in range(robot.actuated.size)]
    limit, note = overload(stack, robot)
    kept = [name for name, most in zip(names, limit.tolist(), strict=True) if math.isfinite(most)]
    if not kept:
        return stack, note
    from hqp.tasks import TorqueLimits

    motors = TorqueLimits(name="motors", joints=None if len(kept) == len(names) else kept, scale=OVERLOAD)
    return Stack(*stack.levels, subject_to=(motors, *stack.subject_to)), note


def overload(stack: Stack, robot: Robot) -> tuple[Vec, str]:
    """``OVERLOAD`` times the limit of each motor ``(n_actuated,)`` [N m], infinite for motors too weak to hold the
    robot at home, and a note on those."""
    names, limit = robot.joint_names, OVERLOAD * robot.effort_limit[robot.actuated]
    needed = np.abs(_holding(stack, robot))
    weak = np.flatnonzero(needed > limit).tolist()
    note = ", ".join(f"{names[i]} {limit[i] / OVERLOAD:.3g} of {needed[i]:.3g} N m" for i in weak)
    limit[weak] = math.inf
    return limit, f"no torque limit for motors too weak to hold {robot.name} at home: {note}" if weak else ""


def _holding(stack: Stack, robot: Robot) -> Vec:
    """The torque ``(n_actuated,)`` [N m] that holds the robot at home; 0 where its contacts do not carry it."""
    twin, held = robot.copy(), reactions(stack)
    state = twin.state(twin.home)
    if not held:
        J = np.zeros((0, twin.nv))
    else:
        rows = Assembly(held, (), twin, 1.0, {e.name: P(0.0) for e in held})
        rows.fill(state, {e.name: e.hold(state) for e in held}, ())
        J = rows.J
    if rank(J @ passive_motions(twin.actuation)) < twin.nv - twin.actuated.size:
        return np.zeros(twin.actuated.size)
    return holding_torque(J, state.gravity_force(), twin.actuation)
