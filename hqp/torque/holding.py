"""Bound the holding torque of each motor below its limit: bounds on holding torques beside those on torques."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqp.arrays import Mask, Mat, Vec
from hqp.declare.element import Element
from hqp.declare.law import P
from hqp.declare.robot import Robot
from hqp.declare.stack import Stack
from hqp.programs.assembly import Assembly
from hqp.torque.reactions import reactions

RECOVERY = 0.1
"""Fraction of a motor's limit per second: speed of return of a joint that its motor can hardly hold."""


def within_holding(stack: Stack, robot: Robot, share: float) -> tuple[Stack, str]:
    """The stack with ``Within(HoldingTorque(...))``: motors hold the robot with a share of their limits, in any pose.

    It bounds joints with torque limits in ``subject_to`` that can come to need more, and that no contact or coupling
    helps to hold.  Joints that need more at home are left out and listed in the text.  A stack that bounds holding
    torques itself stays as it is.
    """
    from hqp.tasks import HoldingTorque, Within

    scales = _scales(stack, robot)
    if not scales or any(isinstance(getattr(e, "task", None), HoldingTorque) for e in stack):
        return stack, ""
    twin = robot.copy()
    carried = _carried(stack, twin)
    needed, shared = most_needed(twin), _shared(reactions(stack), twin)
    bounds = {}
    for body, (_, column, count, *_) in enumerate(robot.bodies):
        bound = share * scales.get(column, np.inf)
        limit = bound * robot.effort_limit[column] if count == 1 else np.inf
        if not shared[column] and 0.0 < limit < (np.inf if carried[body] else needed[body]):
            bounds[robot.joint_name(column)] = bound
    if not bounds:
        return stack, ""
    at_home = HoldingTorque(joints=tuple(bounds)).value(twin.state(twin.home))
    weak = {name: value for (name, bound), value in zip(bounds.items(), np.abs(at_home), strict=True) if value > bound}
    note = ", ".join(f"{name} {value:.2g} of its limit" for name, value in weak.items())
    note = (
        f"motors that hold {robot.name} at home with more than {share:g} of their limits are not kept from it: {note}"
        if weak
        else ""
    )
    kept = {name: bound for name, bound in bounds.items() if name not in weak}
    if not kept:
        return stack, note
    most = tuple(kept.values())
    held = Within(
        HoldingTorque(joints=tuple(kept)),
        name="holding_torque",
        lower=tuple(-x for x in most),
        upper=most,
        recovery=RECOVERY,
    )
    return Stack(*stack.levels, subject_to=(*stack.subject_to, held)), note


def _scales(stack: Stack, robot: Robot) -> dict[int, float]:
    """The share of its motor's limit that each joint may use, by coordinate."""
    from hqp.tasks import TorqueLimits, TorqueSpeedLimits

    found: dict[int, float] = {}
    for element in stack.subject_to:
        if isinstance(element, (TorqueLimits, TorqueSpeedLimits)):
            for column in robot.actuated[element.selection(robot)].tolist():
                found[column] = min(element.scale, found.get(column, np.inf))
    return found


def _carried(stack: Stack, robot: Robot) -> Mask:
    """Bodies ``(n,)`` that may carry a payload."""
    from hqp.tasks import Payload

    found = np.zeros(len(robot.bodies), dtype=bool)
    for element in stack.subject_to:
        body = robot.body(robot.frame(element.frame)) if isinstance(element, Payload) else 0
        while body:
            found[body] = True
            body = robot.bodies[body][0]
    return found


def most_needed(robot: Robot) -> Vec:
    """Upper bound on the gravity torque at the joint of each body ``(n,)`` [N m or N]: its subtree stretched out."""
    robot.state(robot.home).kinematics()
    bodies, g = robot.bodies, robot.gravity
    mass, away, across, needed = (np.zeros(len(bodies)) for _ in range(4))  # moments: in any direction, across the axis
    for body in range(len(bodies) - 1, 0, -1):
        parent, first, count, own, centre, (position, rotation) = bodies[body]
        twists = robot.joint_twists[:, first : first + count]
        slides = [c for c in range(count) if not twists[3:, c].any()]
        lever = rotation @ np.array(centre)
        mass[body] += own
        away[body] += own * np.linalg.norm(lever)
        across[body] += own * _across(twists, lever)
        steepest = np.linalg.norm(np.cross(twists[3:, 0], g) if parent == 0 and count == 1 else g)  # a fixed axis
        needed[body] = np.linalg.norm(g) * mass[body] if slides else steepest * across[body]
        mass[parent] += mass[body]
        if parent and mass[body] > 0.0:
            _, start, axes, *_, (origin, _) = bodies[parent]
            arm, travel = position - origin, sum((robot.upper - robot.lower)[first : first + count][slides])
            away[parent] += away[body] + mass[body] * (np.linalg.norm(arm) + travel)
            turning = robot.joint_twists[:, start : start + axes]
            across[parent] += away[body] + mass[body] * (_across(turning, arm) + travel)
    return needed


def _across(twists: Mat, arm: Vec) -> float:
    """The length of an arm, across the axis where there is one."""
    return float(np.linalg.norm(np.cross(twists[3:, 0], arm) if twists.shape[1] == 1 else arm))


def _shared(held: Sequence[Element], robot: Robot) -> Mask:
    """Coordinates ``(nv,)`` on which a force of contacts, couplings or tendons acts, in some posture."""
    from hqp.tasks.holding_torque import pulled

    found = pulled(robot)
    if held:
        rows = Assembly(held, (), robot, 1.0, {e.name: P(0.0) for e in held})
        rng = np.random.default_rng(0)
        for step in (np.zeros(robot.nv), *rng.uniform(-0.3, 0.3, (2, robot.nv))):
            state = robot.state(robot.integrate(robot.home, step, 1.0))
            rows.fill(state, {e.name: e.hold(state) for e in held}, ())
            found |= np.any(np.abs(rows.J) > 1e-9, axis=0)
    return found
