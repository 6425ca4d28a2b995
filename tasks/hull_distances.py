"""Distances of a capsule and a hull in many configurations, by coal."""

from __future__ import annotations

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.collision_library import Placement, coal, convex_hull, solid
from hqp.shapes import LinkCapsule, LinkHull

FAR = 0.1
"""Distances above this are lower bounds by balls [m]."""


def between(capsule: LinkCapsule, one: tuple[Mat, Mat], hull: LinkHull, two: tuple[Mat, Mat]) -> Vec:
    """Distances ``(n,)`` [m] at positions ``(n, 3)`` and rotations ``(n, 3, 3)`` of both bodies."""
    a, b = np.array(capsule.a), np.array(capsule.b)
    axis, length = b - a, float(np.linalg.norm(b - a))
    shape, own = coal.Capsule(capsule.radius, length), solid(convex_hull(np.array(hull.corners)))
    turn = _onto(axis / length) if length > 0.0 else np.eye(3)
    middle = 0.5 * (a + b)
    off = np.linalg.norm(one[0] + one[1] @ middle - two[0] - two[1] @ np.array(hull.a), axis=1)
    found = off - 0.5 * length - capsule.radius - hull.radius
    ask, result = coal.DistanceRequest(), coal.DistanceResult()
    for n in np.flatnonzero(found < FAR).tolist():
        here = Placement(one[1][n] @ turn, one[0][n] + one[1][n] @ middle)
        result.clear()
        found[n] = coal.distance(shape, here, own, Placement(two[1][n], two[0][n]), ask, result) - hull.rounding
    return np.asarray(found)


def _onto(u: Vec) -> Mat:
    """A rotation that takes z to a unit vector."""
    across = np.linalg.svd(u[None])[2][1:]
    R = np.column_stack((across[0], across[1], u))
    R[:, 0] *= np.sign(np.linalg.det(R))
    return R
