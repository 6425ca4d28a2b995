"""Mistry, Nakanishi, Cheng, Schaal 2008: a robot in double support, frames by role, gains, the stack."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp import Level, P, Stack
from hqp.arrays import Vec
from hqp.declare.robot import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Orientation, Position, Posture

HZ = 500.0
"""Rate of the paper's position commands [Hz]."""


@dataclass(frozen=True)
class Roles:
    """Frames of a humanoid by their role in the paper."""

    left: str
    right: str
    hand: str
    base: str


def roles(robot: Robot) -> Roles:
    """The soles, the right palm and the base of a robot from its landmarks."""
    left, right = robot.landmarks["soles"]
    return Roles(left, right, robot.landmarks["palms"][1], robot.landmarks["base"][0])


CBI = Roles(left="l_sole", right="r_sole", hand="r_palm", base="pelvis")


@dataclass(frozen=True, kw_only=True)
class Gains:
    """Feedback gains [1/s], not given in the paper.  foot: None for the formulation's contact law."""

    cog: float = 2.0
    foot: float | None = None
    hand: float = 5.0
    extraneous: float = 2.0
    posture: float = 1.0


GAINS = Gains()


def paper_stack(
    frames: Roles, gains: Gains = GAINS, *, hand: bool = True, posture: bool = True, limits: bool = False
) -> Stack:
    """Eqs. (12) to (15): feet and CoG over the ground, then the hand, then base orientation and CoG height."""
    foot = None if gains.foot is None else P(gains.foot)
    levels = [
        Level(
            FixedContact(frame=frames.left, name="l_sole", law=foot),
            FixedContact(frame=frames.right, name="r_sole", law=foot),
            Com(axes="xy", law=P(gains.cog), name="com_xy"),
            name="critical",
        ),
        Level(
            Orientation(frame=frames.base, law=P(gains.extraneous), name="base"),
            Com(axes="z", law=P(gains.extraneous), name="com_z"),
            name="extraneous",
        ),
    ]
    if hand:
        levels.insert(1, Level(Position(frame=frames.hand, law=P(gains.hand), name="hand"), name="functional"))
    if posture:
        levels.append(Level(Posture(law=P(gains.posture)), name="posture"))
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
