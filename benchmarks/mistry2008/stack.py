"""The paper's robot in double support: its frames by role, its gains, its stack."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp import Level, P, Stack
from hqp.arrays import Vec
from hqp.robot import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture

HZ = 500.0
"""Rate of the paper's position commands [Hz]."""

K_COG, K_HAND, K_BASE, K_POSTURE = 2.0, 5.0, 2.0, 1.0
"""Gains [1/s]; the paper gives none."""


@dataclass(frozen=True)
class Roles:
    """Frames of a humanoid by what the paper does with them; joints is the last level's posture."""

    left: str
    right: str
    hand: str
    base: str


def roles(robot: Robot) -> Roles:
    """The soles, the right palm and the base of a robot from its landmarks."""
    left, right = robot.landmarks["soles"]
    return Roles(left, right, robot.landmarks["palms"][1], robot.landmarks["base"][0])


def paper_stack(robot: Robot, *, limits: bool = False, posture: bool = True, hand_gain: float = K_HAND) -> Stack:
    """Eqs. (12) to (15): feet and CoG over the ground, then the hand, then base orientation and CoG height."""
    frames = roles(robot)
    levels = [
        Level(
            FixedContact(frame=frames.left, name="l_sole"),
            FixedContact(frame=frames.right, name="r_sole"),
            Com(axes="xy", law=P(K_COG), name="com_xy"),
            name="critical",
        ),
        Level(Position(frame=frames.hand, law=P(hand_gain), name="hand"), name="functional"),
        Level(
            Orientation(frame=frames.base, law=P(K_BASE), name="base"),
            Com(axes="z", law=P(K_BASE), name="com_z"),
            name="extraneous",
        ),
    ]
    if posture:
        levels.append(Level(Posture(law=P(K_POSTURE)), name="posture"))
    return Stack(*levels, subject_to=[JointLimits(acceleration=None, braking=None)] if limits else [])


def near_home(robot: Robot, rng: np.random.Generator, spread: float = 0.15) -> Vec:
    """Home with every joint moved by up to ``spread`` [rad] within its limits: standing, feet not side by side."""
    step = np.zeros(robot.nv)
    columns = robot.joints(None)
    step[columns] = rng.uniform(-spread, spread, columns.size)
    angles = robot.state(robot.home).angles
    step = np.clip(angles + step, robot.lower + 0.05, robot.upper - 0.05) - angles
    step[np.setdiff1d(np.arange(robot.nv), columns)] = 0.0
    return robot.integrate(robot.home, step, 1.0)
