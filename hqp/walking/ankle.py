"""The part of a sole on which its ankle bears the weight of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.robots.knees import knee
from hqp.tasks.polygons import nearest

RESERVE = 0.5
"""Share of the ankle's torque that the planned ZMP leaves to the balance."""

Corners = tuple[tuple[float, float], ...]


def strain(robot: Any, frame: str, leg: Sequence[str]) -> tuple[Mat, Vec]:
    """Torques of the ankle's motors as shares of their limits, A p + b, if all weight is at a point p of the sole.

        U' tau = g(q) - J' (f, p x f),    f = m g up

    with the actuation U at home, for the motors beyond the knee.  p ``(2,)``: in the axes of the frame, whose z is up
    [m].  A ``(n, 2)`` [1/m], b ``(n,)``.
    """
    state = robot.copy().state(robot.home)
    J, R = state.jacobian(frame), state.rotation(frame)
    force = -robot.mass * robot.gravity[2] * R[:, 2]
    x, y, _ = R.T
    wrench = np.array([[*force, 0.0, 0.0, 0.0], [0.0] * 3 + [*np.cross(x, force)], [0.0] * 3 + [*np.cross(y, force)]])
    needed = -J.T @ wrench.T
    needed[:, 0] += state.bias_force()
    tau = np.linalg.lstsq(robot.actuation.T, needed, rcond=None)[0] / robot.effort_limit[robot.actuated][:, None]
    name, _ = knee(robot, leg, robot.home)
    beyond = robot.joints(leg[leg.index(name) + 1 :])
    ankle = tau[np.isin(np.arange(robot.nv)[robot.actuated], beyond)]
    return ankle[:, 1:], ankle[:, 0]


def borne(corners: Corners, A: Mat, b: Vec, share: float) -> Corners:
    """Corners of the part of a convex polygon with |A p + b| <= share; none if it is empty."""
    for a, at in zip(A, b.tolist(), strict=True):
        corners = clipped(clipped(corners, a, share - at), -a, share + at)
    return corners


def clipped(corners: Corners, a: Vec, b: float) -> Corners:
    """Corners of the part of a convex polygon with a . p <= b."""
    off = [float(a @ np.array(p)) - b for p in corners]
    found: list[tuple[float, float]] = []
    for k, ((x, y), d) in enumerate(zip(corners, off, strict=True)):
        (u, v), before = corners[k - 1], off[k - 1]
        if (before > 0.0) != (d > 0.0):
            part = before / (before - d)
            found.append((u + part * (x - u), v + part * (y - v)))
        if d <= 0.0:
            found.append((x, y))
    return tuple(found)


def supporting(
    robot: Any, frame: str, leg: Sequence[str], corners: Corners, middle: tuple[float, float]
) -> tuple[Corners, tuple[float, float], str]:
    """The part of a sole in which the ankle holds the ZMP, the point in it that is best planned, and its reason.

    It is the point nearest to the middle at which RESERVE of each torque is left, or that the ankle bears at all.  The
    reason is "" for the middle itself.  Raises DeclarationError if the ankle bears the weight nowhere on the sole.
    """
    A, b = strain(robot, frame, leg)
    support = borne(corners, A, b, 1.0)
    if len(support) < 3:
        allowed = "torque limits of the ankle that bear the weight at a point of the sole"
        raise DeclarationError("walker", f"{robot.name} does not stand on one foot", value=frame, allowed=allowed)
    x, y = nearest(np.array(borne(support, A, b, 1.0 - RESERVE) or support), np.array(middle)).tolist()
    if (x, y) == middle:
        return support, middle, ""
    off, share = 1e3 * float(np.hypot(x - middle[0], y - middle[1])), 100.0 * float(np.max(np.abs(A @ middle + b)))
    to = f"which takes {share:.0f} % of the ankle's torque on one foot"
    return support, (x, y), f"{frame}: the ZMP is planned {off:.0f} mm beside the middle of the sole, {to}"
