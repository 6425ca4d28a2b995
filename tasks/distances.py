"""Distances between a capsule and other shapes, one pair at a time: the readable twin of cpp/rows/distance.hpp.

Each function but ``of_axes`` returns (distance [m], normal from the capsule to the other ``(3,)``, nearest point of
the capsule's axis ``(3,)``).  The distance is to the surfaces, negative inside.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from hqp.arrays import Mat, Vec, cross

PARALLEL = 1e-9
"""Squared sine below which two axes count as parallel: the middle of their common part is then nearest."""
TOUCHING = 1e-9
"""Distance of two axes below which they give no normal [m]."""

ALIGNED, ACROSS = 0.03, 0.12
"""Squared sines of the angle of two axes between which they come to count as side by side."""

Found = tuple[float, Vec, Vec]


def to_capsule(a: Vec, b: Vec, radius: float, c: Vec, d: Vec, other: float) -> Found:
    """Between the capsule of the axis a b and that of the axis c d; either may be a point."""
    s, t = nearest(a, b, c, d)
    p, q = a + s * (b - a), c + t * (d - c)
    w = q - p
    length = math.sqrt(w @ w)
    if length > TOUCHING:
        return length - radius - other, w / length, p
    return -radius - other, _across(b - a, d - c), p


def nearest(a: Vec, b: Vec, c: Vec, d: Vec) -> tuple[float, float]:
    """Shares s, t in [0, 1] of the nearest points a + s (b - a) and c + t (d - c) of two segments."""
    u, v, w = b - a, d - c, c - a
    A, B, C, D, E = float(u @ u), float(u @ v), float(v @ v), float(u @ w), float(v @ w)
    tiny = TOUCHING * TOUCHING
    if tiny >= A and tiny >= C:
        return 0.0, 0.0
    if tiny >= A:
        return 0.0, _share(-E / C)
    if tiny >= C:
        return _share(D / A), 0.0
    square = A * C - B * B
    if square > PARALLEL * A * C:
        s = _share((D * C - B * E) / square)
    else:  # the middle of the overlap of the two along u, between where the ends of the other project
        ends = sorted((_share(D / A), _share((D + B) / A)))
        s = 0.5 * (ends[0] + ends[1])
    t = (B * s - E) / C
    if t < 0.0:
        return _share(D / A), 0.0
    if t > 1.0:
        return _share((D + B) / A), 1.0
    return s, t


def aligned(u: Vec, v: Vec) -> float:
    """Return how far two axes lie side by side: 1 where they are parallel within 10 degrees, 0 beyond 20."""
    square = 1.0 - float(u @ v) ** 2 / float((u @ u) * (v @ v))
    return min(1.0, max(0.0, (ACROSS - square) / (ACROSS - ALIGNED)))


def to_half_space(a: Vec, b: Vec, radius: float, pose: Mat) -> Found:
    """Between a capsule and all that lies below the x y plane of a pose ``(4, 4)``."""
    normal = pose[:3, 2]
    heights = float(normal @ (a - pose[:3, 3])), float(normal @ (b - pose[:3, 3]))
    gap, size = heights[1] - heights[0], math.sqrt(float((b - a) @ (b - a)))
    s = 0.5 if abs(gap) <= PARALLEL * size else (1.0 if gap < 0.0 else 0.0)
    return min(heights) - radius, -normal, a + s * (b - a)


def to_box(a: Vec, b: Vec, radius: float, half: Vec, pose: Mat) -> Found:
    """Between a capsule and the box of half edges ``(3,)`` at a pose ``(4, 4)``."""
    R, centre = pose[:3, :3], pose[:3, 3]
    p, q = R.T @ (a - centre), R.T @ (b - centre)
    s = _outside(p, q - p, half)
    at = p + s * (q - p)
    off = at - np.clip(at, -half, half)
    length = math.sqrt(float(off @ off))
    if length > TOUCHING:
        return length - radius, R @ (-off / length), a + s * (b - a)
    depth, outward, s = _inside(p, q, half)
    return -depth - radius, R @ -outward, a + s * (b - a)


def _outside(p: Vec, u: Vec, half: Vec) -> float:
    """Share s where p + s u is nearest to the box: the zero of a slope that is piecewise linear and rises."""
    stops = [0.0, 1.0]
    for i in range(3):
        if abs(u[i]) > TOUCHING:
            stops += [_share((side * half[i] - p[i]) / u[i]) for side in (-1.0, 1.0)]
    stops.sort()

    def slope(s: float) -> float:
        at = p + s * u
        return float(u @ (at - np.clip(at, -half, half)))

    first = last = None
    for left, right in pairwise(stops):
        low, high = slope(left), slope(right)
        if low >= 0.0 and first is None:
            first = left
        if high <= 0.0:
            last = right
        elif low < 0.0 < high:
            return left - low * (right - left) / (high - low)
    if first is None:
        return 1.0
    return 0.5 * (first + max(first, last or 0.0))  # the middle where a whole piece is nearest


def _inside(p: Vec, q: Vec, half: Vec) -> tuple[float, Vec, float]:
    """The shortest way that takes the segment p q out of the box, its direction, and the share of the last point out.

    Directions across faces, and across an edge and the segment, are all that can be shortest.
    """
    best, outward, share, u = math.inf, np.zeros(3), 0.5, q - p
    for i in range(3):
        for sign in (-1.0, 1.0):
            depth = float(half[i] - sign * (q[i] if sign * u[i] < 0.0 else p[i]))
            if depth < best:
                best, outward = depth, sign * np.eye(3)[i]
                share = 0.5 if abs(u[i]) <= TOUCHING else (1.0 if sign * u[i] < 0.0 else 0.0)
    for i in range(3):
        across = cross(u, np.eye(3)[i])
        size = math.sqrt(float(across @ across))
        if size <= TOUCHING:
            continue
        for sign in (-1.0, 1.0):
            normal = sign / size * across
            depth = float(np.abs(normal) @ half - normal @ p)
            if depth < best:
                best, outward = depth, normal
                corner = np.copysign(half, normal)
                start, end = corner.copy(), corner.copy()
                start[i], end[i] = -half[i], half[i]
                share = nearest(p, q, start, end)[0]
    return best, np.asarray(outward, dtype=np.float64), share


def _across(u: Vec, v: Vec) -> Vec:
    """A unit vector across two axes, across one where they are parallel."""
    w = cross(u, v)
    if w @ w <= PARALLEL * (u @ u) * (v @ v):
        longer = u if u @ u >= v @ v else v
        w = cross(longer, np.eye(3)[int(np.argmin(np.abs(longer)))])
    size = math.sqrt(float(w @ w))
    return np.asarray(w / size, dtype=np.float64) if size > 0.0 else np.array([0.0, 0.0, 1.0])


def _share(x: float) -> float:
    return min(max(float(x), 0.0), 1.0)


def of_axes(a: Mat, b: Mat, c: Mat, d: Mat) -> Vec:
    """Distances between segments a b and c d, many at once: ends ``(n, 3)``, distances ``(n,)`` [m]."""
    u, v, w = b - a, d - c, c - a
    across = cross(u, v)
    square = np.einsum("ij,ij->i", across, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.einsum("ij,ij->i", cross(w, v), across) / square
        t = np.einsum("ij,ij->i", cross(w, u), across) / square
        crossing = np.abs(np.einsum("ij,ij->i", w, across)) / np.sqrt(square)
    inside = (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
    inside &= square > PARALLEL * np.einsum("ij,ij->i", u, u) * np.einsum("ij,ij->i", v, v)
    ends = np.minimum(
        np.minimum(_to_axis(a, c, v), _to_axis(b, c, v)), np.minimum(_to_axis(c, a, u), _to_axis(d, a, u))
    )
    return np.where(inside, np.minimum(crossing, ends), ends)


def _to_axis(p: Mat, a: Mat, u: Mat) -> Vec:
    """Distances of points p from the segments a to a + u."""
    off, square = p - a, np.einsum("ij,ij->i", u, u)
    share = np.clip(np.einsum("ij,ij->i", off, u) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return np.asarray(np.linalg.norm(off - share[:, None] * u, axis=1))
