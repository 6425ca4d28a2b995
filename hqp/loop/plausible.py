"""A first state that is valid but cannot be meant: another order of the quaternion or of the joints, degrees."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hqp.arrays import Vec
from hqp.declare.robot import Robot

LYING = math.cos(math.radians(60.0))
"""Cosine of the tilt from home above which a robot that stands at home is taken to lie."""

FALLEN = math.cos(math.radians(150.0))
"""Cosine of the tilt from home above which a base is taken to be upside down."""

FAR = 1.0
"""A joint that is outside its limits by more cannot be a sensor's error [rad, m]."""


def doubts(robot: Robot, q: Any) -> tuple[str, ...]:
    """Return sentences on an implausible state ``(nq,)``, with the likely cause; none for a plausible one.

    A base is compared with the home configuration, so a robot whose home lies may lie.
    """
    given = np.asarray(q)
    if given.shape != (robot.nq,) or given.dtype.kind not in "fiu" or not np.isfinite(given).all():
        return ()  # the tick reports it
    return (*_base(robot, given), *_joints(robot, given))


def _base(robot: Robot, q: Vec) -> tuple[str, ...]:
    if not robot.floating:
        return ()
    home = _up(robot.home[3:7])
    tilt, swapped = float(_up(q[3:7]) @ home), float(_up(q[[4, 5, 6, 3]]) @ home)
    if tilt > LYING:
        return ()
    what = "upside down" if tilt < FALLEN else "lying"
    angle = math.degrees(math.acos(max(-1.0, tilt)))
    cause = ", but upright with the quaternion read as w x y z: hqp takes x y z w" if swapped > LYING else ""
    return (f"its base is {what}, {angle:.0f} degrees from home{cause}",)


def _up(xyzw: Vec) -> Vec:
    """The z axis ``(3,)`` of a rotation in its own terms of the world; zero for a quaternion of no length."""
    x, y, z, w = xyzw / max(float(np.linalg.norm(xyzw)), 1e-300)
    return np.array((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)))


def _joints(robot: Robot, q: Vec) -> tuple[str, ...]:
    columns = np.asarray(robot.actuated)
    places = robot.positions(columns)
    if places is None or not columns.size:
        return ()
    at, low, high = q[places], robot.lower[columns], robot.upper[columns]
    off = np.maximum(low - at, at - high)
    if not off.max(initial=0.0) > FAR:
        return ()
    k = int(off.argmax())
    turns = np.radians(at)
    cause = "its joints in another order, or not zero where the model's are"
    if np.abs(at).max() > 2.0 * math.pi and np.all((low - FAR <= turns) & (turns <= high + FAR)):
        cause = "degrees, which hqp takes as rad"
    name = robot.joint_name(int(columns[k]))
    return (f"joint {name!r} at {at[k]:.4g} is far outside its limits {low[k]:.4g} to {high[k]:.4g}: {cause}",)
