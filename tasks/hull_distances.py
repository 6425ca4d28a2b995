"""Distances of a capsule or a hull and a hull in many configurations, by coal."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.collision_library import Placement, coal, convex_hull, solid
from hqp.shapes import LinkCapsule, LinkHull

FAR = 0.1
"""Distances above this are lower bounds by balls, unless the caller has another use for them [m]."""


def between(
    own: LinkCapsule | LinkHull, one: tuple[Mat, Mat], hull: LinkHull, two: tuple[Mat, Mat], far: float = FAR
) -> Vec:
    """Distances ``(n,)`` [m] at positions ``(n, 3)`` and rotations ``(n, 3, 3)`` of both bodies.

    far [m]: those above it may be lower bounds by balls, which are above it, too.
    """
    (shape, turn, middle), (other, *_) = _solid(own), _solid(hull)
    back = two[1].transpose(0, 2, 1)
    places, turns = one[0] + one[1] @ middle - two[0], back @ one[1] @ turn
    off = np.linalg.norm(places - two[1] @ np.array(hull.a), axis=1)
    found = off - 0.5 * math.dist(own.a, own.b) - own.radius - hull.radius
    rounding = hull.rounding + (own.rounding if isinstance(own, LinkHull) else 0.0)
    measure, still = coal.ComputeDistance(shape, other), Placement.Identity()
    ask, result = coal.DistanceRequest(), coal.DistanceResult()
    near = np.flatnonzero(found <= far)
    relative = (back[near] @ places[near, :, None])[..., 0]
    for n, place, rotation in zip(near.tolist(), relative, turns[near], strict=True):
        result.clear()
        found[n] = measure(Placement(rotation, place), still, ask, result) - rounding
    return np.asarray(found)


def witnesses(one: LinkHull, first: tuple[Mat, Mat], two: LinkHull, second: tuple[Mat, Mat]) -> tuple[Mat, Mat]:
    """Nearest points of two hulls, each in the axes of its body ``(n, 3)`` [m], at poses of these as in ``between``."""
    (own, *_), (other, *_) = _solid(one), _solid(two)
    found = np.empty((2, len(first[0]), 3))
    ask, result = coal.DistanceRequest(True), coal.DistanceResult()
    for n in range(len(first[0])):
        places = Placement(first[1][n], first[0][n]), Placement(second[1][n], second[0][n])
        result.clear()
        coal.distance(own, places[0], other, places[1], ask, result)
        for k, (position, rotation) in enumerate((first, second)):
            found[k, n] = rotation[n].T @ (result.getNearestPoint1() if k == 0 else result.getNearestPoint2())
            found[k, n] -= rotation[n].T @ position[n]
    return found[0], found[1]


@lru_cache(maxsize=64)
def _solid(own: LinkCapsule | LinkHull) -> tuple[Any, Mat, Vec]:
    """A shape of coal, and its rotation and place in the axes of its body."""
    if isinstance(own, LinkHull):
        return solid(convex_hull(np.array(own.corners))), np.eye(3), np.zeros(3)
    axis, length = np.subtract(own.b, own.a), math.dist(own.a, own.b)
    return coal.Capsule(own.radius, length), _onto(axis / length) if length > 0.0 else np.eye(3), _middle(own)


def _middle(own: LinkCapsule | LinkHull) -> Vec:
    return np.asarray(0.5 * np.add(own.a, own.b))


def _onto(u: Vec) -> Mat:
    """A rotation that takes z to a unit vector."""
    across = np.linalg.svd(u[None])[2][1:]
    R = np.column_stack((across[0], across[1], u))
    R[:, 0] *= np.sign(np.linalg.det(R))
    return R
