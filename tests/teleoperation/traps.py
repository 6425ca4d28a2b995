"""Traps of strict levels on G1: whole-body targets of two frames of motion capture, and the robot's configuration then.

Numbers from the climbs 0 (first frame) and 4 (frame 2000, on hands and knees) of holosoma-retargeting 0.1.0 (Amazon
FAR, Apache-2.0), scaled to G1.  Feet: position, quaternion xyzw; torso: quaternion; all others positions [m].
"""

from __future__ import annotations

from typing import Any

import numpy as np

import hqp
from hqp import Level, P, Stack
from hqp.arrays import Vec
from hqp.declare.reference import Reference
from hqp.tasks import JointLimits, Orientation, Pose, Position, Posture

TURNED: dict[str, tuple[float, ...]] = {
    "left_foot": (-0.9419, 0.1847, 0.0461, 0.0000, 0.0000, 0.0870, 0.9962),
    "left_hand": (-0.8914, 0.5000, 0.7469),
    "left_elbow": (-0.9080, 0.3874, 0.9012),
    "left_knee": (-0.8838, 0.1919, 0.4027),
    "right_foot": (-0.9335, 0.0517, 0.0408, 0.0000, 0.0000, -0.0630, 0.9980),
    "right_hand": (-0.8550, -0.2414, 0.7433),
    "right_elbow": (-0.8799, -0.1346, 0.9006),
    "right_knee": (-0.8480, 0.0499, 0.4061),
    "pelvis": (-0.8908, 0.1203, 0.6838),
    "torso": (-0.0039, 0.0021, 0.0169, 0.9998),
}
CRAWL: dict[str, tuple[float, ...]] = {
    "left_foot": (-0.1598, 0.8377, 0.4469, 0.0000, 0.0000, 0.8438, 0.5367),
    "left_hand": (-0.4329, 1.1765, 0.8433),
    "left_elbow": (-0.3487, 1.1047, 1.0035),
    "left_knee": (-0.2060, 0.9098, 0.8147),
    "right_foot": (0.0373, 0.7937, 0.4582, 0.0000, 0.0000, 0.5199, 0.8542),
    "right_hand": (0.1483, 1.2761, 0.8298),
    "right_elbow": (0.1010, 1.1764, 0.9901),
    "right_knee": (0.0165, 0.9204, 0.8001),
    "pelvis": (-0.0805, 0.6910, 0.9873),
    "torso": (-0.3449, 0.3462, 0.6504, 0.5815),
}
CRAWLED = (
    -0.0479,
    0.7005,
    1.1091,
    -0.3547,
    0.2522,
    -0.6817,
    -0.5881,
    2.8798,
    2.9671,
    -2.7576,
    1.5932,
    -0.4234,
    0.2618,
    -2.5307,
    -2.9671,
    2.4959,
    0.3450,
    -0.0934,
    -0.2031,
    -0.2291,
    -0.5200,
    -0.5200,
    -2.9143,
    2.2515,
    1.5720,
    0.4073,
    -0.1167,
    0.1009,
    -0.0513,
    -2.9636,
    1.5882,
    1.5307,
    0.5418,
    0.1007,
    0.0488,
    0.1122,
)


def whole_body(gain: float = 60.0) -> tuple[Any, Stack]:
    """G1, and feet > hands > trunk > limbs > posture."""
    sides = ("left", "right")
    feet = [Pose(frame=f"{s}_ankle_roll_link", law=P(gain), name=f"{s}_foot") for s in sides]
    hands = [Position(frame=f"{s}_rubber_hand", law=P(gain), name=f"{s}_hand") for s in sides]
    limbs = [
        Position(frame=f"{s}_{part}_link", law=P(0.5 * gain), name=f"{s}_{part}")
        for s in sides
        for part in ("elbow", "knee")
    ]
    trunk = [
        Position(frame="pelvis", law=P(0.5 * gain), name="pelvis"),
        Orientation(frame="torso_link", law=P(0.5 * gain), name="torso"),
    ]
    levels = [
        Level(*feet, name="feet"), Level(*hands, name="hands"), Level(*trunk, name="trunk"),
        Level(*limbs, name="limbs"), Level(Posture(law=P(1.0)), name="posture"),
    ]  # fmt: skip
    return hqp.robots.load("g1"), Stack(*levels, subject_to=[JointLimits(braking=None, acceleration=None)])


def references(stack: Stack, targets: dict[str, tuple[float, ...]]) -> list[Reference]:
    """References of all targets."""
    found = []
    for name, value in targets.items():
        task: Any = stack.find(name)
        found.append(task.at((value[:3], value[3:]) if len(value) == 7 else value))
    return found


def turned_start(robot: Any) -> Vec:
    """Home with the base at its target position, but facing backwards."""
    q: Vec = robot.home.copy()
    q[:3], q[3:7] = TURNED["pelvis"], (0.0, 0.0, 1.0, 0.0)
    return q


def crawled_start() -> Vec:
    """Configuration on hands and knees."""
    q = np.array(CRAWLED)
    q[3:7] /= np.linalg.norm(q[3:7])
    return q


ELBOW = (-0.46865, -0.64019, -1.57046, -2.18133, 1.68068, 1.43628, 2.06479, 0.001, 0.001)
"""Joints of a Panda whose elbow must fold the other way to bring its hand to ``HAND`` [rad, m]."""

HAND = (-0.540170, -0.393944, 0.586351), (0.734399, -0.651876, 0.008452, 0.188795)
"""Position and quaternion xyzw."""


def elbow() -> tuple[Any, Any, Any, Vec]:
    """Panda, its hand, the hand's target, and the start."""
    robot = hqp.robots.load("panda")
    hand = Pose(frame="panda_hand_tcp", law=P(5.0), name="hand")
    return robot, hand, hand.at(HAND), np.array(ELBOW)
