"""Default limits of a filter: decelerations that the motors can provide."""

from __future__ import annotations

import math

import numpy as np

from hqp.declare.robot import Robot
from hqp.tasks import JointLimits
from hqp.tasks.limits import home_inertia

BRAKING = 200.0
"""Largest deceleration of the default limits [rad/s^2, m/s^2]."""

SHARE, FIXED = 0.1, 0.05
"""Share of a motor's torque for its deceleration, on a base that gives way and on another one: it also bears gravity
and the deceleration of other joints.  With 0.1 hostile arms take G1's waist out of its range on a stand; with 0.05 a
waist that walks is limited in 2 of 1000 ticks."""

APPROACH = 150.0
"""Rate at which ranges and clearances are approached [1/s]: at 60 a walking waist, 1.3 rad/s, accelerates less."""

WITHIN, MARGIN = 0.95, 3e-3
"""Share of the speed limits and way to the ranges [rad, m] that dynamics keep, which change within a tick."""


def default_limits(robot: Robot, dynamics: bool = False, fixed: bool = False) -> tuple[JointLimits, ...]:
    """Limits of all joints, grouped by b = 200 / 2^k at most 0.1 tau_max / I, the inertia I at home, and by speed.

    dynamics: within ``WITHIN`` of the speed limits, and ``MARGIN`` inside the ranges.  fixed: the base does not move
    under torques, which takes 0.05 for 0.1.
    """
    own = robot.actuated
    with np.errstate(divide="ignore"):
        most = (
            (FIXED if fixed else SHARE)
            * np.where(robot.effort_limit[own] > 0.0, robot.effort_limit[own], math.inf)
            / home_inertia(robot)[own]
        )
    halvings = np.ceil(np.log2(np.maximum(BRAKING / most, 1.0))).astype(int)
    names = [robot.joint_name(int(c)) for c in own]
    top = robot.velocity_limit[own]
    speeds = np.where(dynamics & np.isfinite(top), WITHIN * top, 0.0)  # 0 for that of the robot
    groups = list(zip(halvings.tolist(), speeds.tolist(), strict=True))
    return tuple(
        JointLimits(
            joints=[name for name, group in zip(names, groups, strict=True) if group == (k, speed)],
            acceleration=None, braking=BRAKING / 2.0**k, approach=APPROACH, speed=speed, margin=MARGIN * dynamics,
            name=f"limits {BRAKING / 2.0**k:g}" + (f" {speed:g}" if speed else ""),
        )
        for k, speed in sorted(set(groups))
    )  # fmt: skip
