"""Fingerprint of a robot, to detect a plan of another robot."""

from __future__ import annotations

import hashlib
import json

from hqp.declare.robot import Robot

DIGITS = 9
"""Digits of each number: sums of masses differ in their last digits between machines."""


def fingerprint(robot: Robot) -> str:
    """SHA-256 of joint names, limits of position, speed and effort, and masses of bodies, as 64 hexadecimal digits."""
    names = [robot.joint_name(column) for column in range(robot.nv)]
    limits = (robot.lower, robot.upper, robot.velocity_limit, robot.effort_limit)
    numbers = [[f"{x:.{DIGITS}g}" for x in limit.tolist()] for limit in limits]
    masses = [f"{mass:.{DIGITS}g}" for *_, mass in (body[:4] for body in robot.bodies)]
    text = json.dumps([names, robot.joint_names, numbers, masses], separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
