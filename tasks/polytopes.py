"""Distance between a capsule and the convex hull of a link: the readable twin of cpp/rows/polytope.hpp."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from hqp.arrays import Index, Mask, Mat, Vec, cross
from hqp.shapes import LinkHull

from .distances import TOUCHING, Found, nearest, of_axes

_Nearest: TypeAlias = tuple[float, Vec, Vec, int]  # distance, normal, nearest point, feature


class Polytope(NamedTuple):
    """Corners ``(n, 3)``, triangles ``(m, 3)`` counter-clockwise from outside, their planes, edges between two of them.

    normals ``(m, 3)``, offsets ``(m,)``: normal . x <= offset inside.  edges ``(k, 4)``: two corners, two triangles.
    """

    corners: Mat
    triangles: Index
    normals: Mat
    offsets: Vec
    edges: Index
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
    found = np.array([(*edge, sides[0], sides[-1]) for edge, sides in edges.items()])
    offsets = np.einsum("ij,ij->i", normals, corners[triangles[:, 0]])
    return Polytope(corners, triangles, normals, offsets, found, hull.rounding)


def at_least(a: Mat, b: Mat, radius: float, hull: Polytope, position: Mat, rotation: Mat) -> Vec:
    """Lower bounds of the distance by the planes of the faces ``(...)`` [m], of ends and positions ``(..., 3)`` and
    rotations ``(..., 3, 3)``."""
    ends = (np.einsum("...ji,...j->...i", rotation, end - position) @ hull.normals.T for end in (a, b))
    lowest = np.minimum(*ends) - hull.offsets
    return np.asarray(lowest.max(axis=-1) - radius - hull.rounding)


def to_polytope(
    a: Vec, b: Vec, radius: float, hull: Polytope, position: Vec, rotation: Mat, *, feature: int = -1
) -> Found:
    """Between the capsule of the axis a b and a hull at a pose, as the functions of ``distances``.

    feature: see ``nearest_feature``; the nearest for -1.
    """
    p, q = rotation.T @ (a - position), rotation.T @ (b - position)
    value, normal, point, _ = _found(p, q, hull) if feature < 0 else _from(feature, p, q, hull)
    return value - radius - hull.rounding, rotation @ normal, position + rotation @ point


def nearest_feature(a: Vec, b: Vec, hull: Polytope, position: Vec, rotation: Mat) -> int:
    """The nearest feature of a hull: the number of an edge, or for E edges E + 2 k and E + 2 k + 1 for the face k below
    either end of the axis; -1 for an axis that crosses the hull."""
    return _found(rotation.T @ (a - position), rotation.T @ (b - position), hull)[3]


def _found(p: Vec, q: Vec, hull: Polytope) -> _Nearest:
    heights = np.stack((hull.normals @ p - hull.offsets, hull.normals @ q - hull.offsets))
    return (*_inside(p, q, hull), -1) if _crosses(heights) else _outside(p, q, heights, hull)


def _from(feature: int, p: Vec, q: Vec, hull: Polytope) -> _Nearest:
    if feature < len(hull.edges):
        return _to_edge(feature, p, q, hull)
    face, last = divmod(feature - len(hull.edges), 2)
    end, normal = q if last else p, hull.normals[face]
    return float(normal @ end) - float(hull.offsets[face]), -normal, end, feature


def _to_edge(edge: int, p: Vec, q: Vec, hull: Polytope) -> _Nearest:
    c, d = hull.corners[hull.edges[edge, :2]]
    s, t = nearest(p, q, c, d)
    at = p + s * (q - p)
    w = c + t * (d - c) - at
    length = math.sqrt(w @ w)
    return (length, w / length, at, edge) if length > TOUCHING else (math.inf, np.zeros(3), p, -1)


def _crosses(heights: Mat) -> bool:
    """Return true if a segment with these heights of its ends above the planes meets the polytope."""
    if ((heights > 0.0).all(axis=0)).any():
        return False
    first, last = 0.0, 1.0
    for a, b in heights[:, (heights > 0.0).any(axis=0)].T.tolist():
        if a > 0.0:
            first = max(first, a / (a - b))
        if b > 0.0:
            last = min(last, a / (a - b))
    return first <= last


def _outside(p: Vec, q: Vec, heights: Mat, hull: Polytope) -> _Nearest:
    best: _Nearest = (math.inf, np.zeros(3), p, -1)
    visible = heights.max(axis=0) > 0.0
    edges = np.flatnonzero(visible[hull.edges[:, 2]] | visible[hull.edges[:, 3]])
    ends, both = hull.corners[hull.edges[edges, :2]], (len(edges), 3)
    off = of_axes(np.broadcast_to(p, both), np.broadcast_to(q, both), ends[:, 0], ends[:, 1])
    for edge in edges[off <= off.min(initial=math.inf) + TOUCHING].tolist():
        best = min(best, _to_edge(edge, p, q, hull), key=lambda found: found[0])
    for i, (end, above) in enumerate(zip((p, q), heights, strict=True)):
        near = np.flatnonzero((above > 0.0) & (above < best[0]))
        for k in near[_over(near, end, hull)].tolist() if near.size else ():
            if above[k] < best[0]:
                best = _from(len(hull.edges) + 2 * k + i, p, q, hull)
    return best if best[0] < math.inf else (*_inside(p, q, hull), -1)


def _over(faces: Index, p: Vec, hull: Polytope) -> Mask:
    """Return true for each triangle whose prism has a point in it."""
    ring = hull.corners[hull.triangles[faces]]
    along, off = ring[:, [1, 2, 0]] - ring, p - ring
    sides = np.einsum("nkj,nj->nk", cross(along, off), hull.normals[faces])
    return np.asarray((sides >= 0.0).all(axis=1))


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
    for one, two, *_ in hull.edges.tolist():
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


__all__ = ["Polytope", "at_least", "nearest_feature", "polytope", "to_polytope"]
