"""Start configurations: configurations that meet the targets of a frame, searched from several headings and
postures."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from hqp.arrays import Vec
from hqp.goals import Reached, reach

from .tracker import LEAN, OFF, Tracker

HEADINGS = (0.0, 0.5 * math.pi, -0.5 * math.pi, math.pi)
"""First headings of a search, relative to the trunk's [rad]."""

SAME = 5e-3
"""Difference below which two residuals count as equal [m, rad]; the earlier start then wins."""

ABOVE = ("subject_to", "stance", "ground", "swing", "hands")
"""Levels that a start has to meet; if one does with an upright trunk and level soles, the search ends."""

TURNED = ("soles", "trunk")
"""Levels whose residual is at most ``LEAN`` in an acceptable start."""

UPRIGHT = 0.25
"""Share of ``LEAN`` up to which they turn in a start that ends the search: with the body aside another is better."""

TOLERANCE = 2e-3
"""Tolerance of ``reach`` [m, rad]."""


def start(tracker: Tracker, frame: int, *also: Vec) -> Vec:
    """The configuration that meets a frame's targets best, level by level.

    Searched from home at the targets' place in several headings, and from the configurations given.
    """
    stack, references = tracker.stacks.starting(tracker.standing(frame)), tracker.starting(frame)
    best: Reached | None = None
    for q0 in (*also, *_placed(tracker, frame)):
        found = reach(stack, tracker.robot, *references, q0=q0, restarts=0, tolerance=TOLERANCE, budget=math.inf)
        if best is None or _worse(best, found):
            best = found
        if _enough(best):
            break
    assert best is not None
    return tracker.settle(best.q, frame)


def _enough(found: Reached) -> bool:
    """Return true if feet and hands are at their targets and trunk and soles upright: the rest is posture."""
    met = all(found.residuals[level] < SAME for level in found.residuals if level in ABOVE)
    return met and all(found.residuals[level] < UPRIGHT * LEAN for level in found.residuals if level in TURNED)


def _excess(found: Reached) -> float:
    """Sum of the residuals beyond the limits of a shortfall, each relative to its limit."""
    limits = {**dict.fromkeys(ABOVE, OFF), **dict.fromkeys(TURNED, LEAN)}
    return sum(max(0.0, found.residuals[level] / limits[level] - 1.0) for level in found.residuals if level in limits)


def _worse(one: Reached, two: Reached) -> bool:
    """Return true if one has more shortfalls, or as many and is worse in the first level in which they differ."""
    if abs(_excess(one) - _excess(two)) > SAME:
        return _excess(one) > _excess(two)
    for level in one.residuals:
        if abs(one.residuals[level] - two.residuals[level]) > SAME:
            return one.residuals[level] > two.residuals[level]
    return False


def _placed(tracker: Tracker, frame: int) -> Iterator[Vec]:
    """Home with the hips where they are to be, and the trunk's heading, turned."""
    robot, targets, body = tracker.robot, tracker.targets, tracker.stacks.body
    axes = targets.axes["torso"][frame] @ body.axes["torso"].T
    hips, home = targets.places["pelvis"][frame], body.between("hip")
    for heading in HEADINGS:
        yaw = math.atan2(axes[1, 0], axes[0, 0]) + heading
        c, s = math.cos(yaw), math.sin(yaw)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        q = robot.home.copy()
        q[:3] = hips + R @ (q[:3] - home)
        q[3:7] = _product((0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)), q[3:7])
        yield q


def _product(one: tuple[float, ...], two: Vec) -> Vec:
    """Product of quaternions xyzw ``(4,)``."""
    from scipy.spatial.transform import Rotation

    return np.asarray((Rotation.from_quat(one) * Rotation.from_quat(two)).as_quat())
