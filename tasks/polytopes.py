"""Distance between a capsule and the convex hull of a link: the readable twin of cpp/rows/polytope.hpp."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hqp.arrays import Index, Mat, Vec, cross
from hqp.shapes import LinkHull

from .distances import TOUCHING, Found, nearest


class Polytope(NamedTuple):
    """Corners ``(n, 3)``, triangles ``(m, 3)`` counter-clockwise from outside, their planes, edges between two of them.

    normals ``(m, 3)``, offsets ``(m,)``: normal . x <= offset inside.  edges ``(k, 4)``: two corners, two triangles.
    """

    corners: Mat
    triangles: Index
    normals: Mat
    offsets: Vec
    edges: list[tuple[int, int, int, int]]
    rounding: float


def polytope(hull: LinkHull) -> Polytope:
    """The polytope of a hull."""
    corners, triangles = np.array(hull.corners), np.array(hull.triangles)
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    turned = np.einsum("ij,ij->i", normals, corners.mean(axis=0) - a) > 0.0
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    normals[turned] *= -1.0
    edges: dict[tuple[int, int], list[int]] = {}
    for k, ring in enumerate(triangles.tolist()):
        for one, two in zip(ring, ring[1:] + ring[:1], strict=True):
            edges.setdefault((two, one) if (two, one) in edges else (one, two), []).append(k)
    found = [(*edge, sides[0], sides[-1]) for edge, sides in edges.items()]
    return Polytope(corners, triangles, normals, np.einsum("ij,ij->i", normals, a), found, hull.rounding)


def to_polytope(a: Vec, b: Vec, radius: float, hull: Polytope, position: Vec, rotation: Mat) -> Found:
    """Between the capsule of the axis a b and a hull at a pose, as the functions of ``distances``."""
    p, q = rotation.T @ (a - position), rotation.T @ (b - position)
    heights = np.stack((hull.normals @ p - hull.offsets, hull.normals @ q - hull.offsets))
    value, normal, point = _inside(p, q, hull) if _crosses(heights) else _outside(p, q, heights, hull)
    return value - radius - hull.rounding, rotation @ normal, position + rotation @ point


def _crosses(heights: Mat) -> bool:
    """Return true if a segment with these heights of its ends above the planes meets the polytope."""
    if ((heights > 0.0).all(axis=0)).any():
        return False
    first, last = 0.0, 1.0
    for a, b in heights.T.tolist():
        if a > 0.0:
            first = max(first, a / (a - b))
        if b > 0.0:
            last = min(last, a / (a - b))
    return first <= last


def _outside(p: Vec, q: Vec, heights: Mat, hull: Polytope) -> Found:
    best, normal, point = math.inf, np.zeros(3), p
    for end, above in ((p, heights[0]), (q, heights[1])):
        for k in np.flatnonzero(above > 0.0).tolist():
            if above[k] < best and _over(k, end, hull):
                best, normal, point = float(above[k]), -hull.normals[k], end
    visible = heights.max(axis=0) > 0.0
    for one, two, left, right in hull.edges:
        if not (visible[left] or visible[right]):
            continue
        c, d = hull.corners[one], hull.corners[two]
        s, t = nearest(p, q, c, d)
        at = p + s * (q - p)
        w = c + t * (d - c) - at
        length = math.sqrt(w @ w)
        if TOUCHING < length < best:
            best, normal, point = length, w / length, at
    return (best, normal, point) if best < math.inf else _inside(p, q, hull)


def _over(face: int, p: Vec, hull: Polytope) -> bool:
    """Return true if a point is in the prism above a triangle."""
    ring = hull.corners[hull.triangles[face]]
    return all(
        float(cross(b - a, p - a) @ hull.normals[face]) >= 0.0 for a, b in zip(ring, np.roll(ring, -1, 0), strict=True)
    )


def _inside(p: Vec, q: Vec, hull: Polytope) -> Found:
    """The shortest way that takes the segment p q out, across a face or across an edge and the segment."""
    u = q - p
    size = math.sqrt(float(u @ u))
    ends = np.stack((hull.normals @ p, hull.normals @ q))
    depths = hull.offsets - ends.min(axis=0)
    k = int(np.argmin(depths))
    a, b = ends[:, k].tolist()
    best, outward = float(depths[k]), hull.normals[k]
    share = 0.5 if abs(b - a) <= TOUCHING * size else (1.0 if b < a else 0.0)
    for one, two, *_ in hull.edges:
        c, d = hull.corners[one], hull.corners[two]
        w = cross(u, d - c)
        length = math.sqrt(float(w @ w))
        if not length > TOUCHING * size:
            continue
        for sign in (-1.0, 1.0):
            normal = sign / length * w
            reach = float(normal @ c)
            depth = reach - float(normal @ p)
            if depth < best and float((hull.corners @ normal).max()) <= reach + TOUCHING:
                best, outward, share = depth, normal, nearest(p, q, c, d)[0]
    return -best, -outward, p + share * u


__all__ = ["Polytope", "polytope", "to_polytope"]
