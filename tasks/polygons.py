"""Polygons on the ground: smaller ones, nearest points, planes through their corners."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hqp.arrays import Mat, Vec

_LINE = 1e-9  # feet in a line from above have no slope across it


def shrunk(corners: Sequence[tuple[float, float]], margin: float) -> tuple[tuple[float, float], ...]:
    """The corners drawn to the middle of their box, whose half sides become shorter by a margin [m], at least zero."""
    points = np.array(corners, dtype=np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    half, middle = 0.5 * (high - low), 0.5 * (low + high)
    share = np.divide(np.maximum(half - margin, 0.0), half, out=np.zeros(2), where=half > 0.0)
    return tuple((float(x), float(y)) for x, y in middle + (points - middle) * share)


def rectangle_in(corners: Sequence[tuple[float, float]], middle: Vec) -> tuple[float, float, float, float]:
    """Largest rectangle like the box of a convex polygon, counter-clockwise, about a point ``(2,)`` inside it:
    (x_min, x_max, y_min, y_max) [m].
    """
    a = np.array(corners) - middle
    half = 0.5 * np.ptp(a, axis=0)
    side = np.roll(a, -1, axis=0) - a
    normal = np.column_stack((side[:, 1], -side[:, 0]))
    share = float(np.min(np.sum(normal * a, axis=1) / (np.abs(normal) @ half)))
    (x, y), (X, Y) = middle.tolist(), (share * half).tolist()
    return x - X, x + X, y - Y, y + Y


def nearest(corners: Mat, point: Vec) -> Vec:
    """The point of a convex polygon that is nearest to another one ``(2,)``; corners ``(m, 2)`` counter-clockwise."""
    points: list[list[float]] = corners.tolist()
    (x, y), inside, least, found = point.tolist(), len(points) > 2, math.inf, points[0]
    for (a, b), (c, d) in zip(points, points[1:] + points[:1], strict=True):
        u, v, s, t = c - a, d - b, x - a, y - b  # along the edge, and on the way to the point
        length = u * u + v * v
        inside = inside and u * t - v * s >= 0.0
        share = min(max((u * s + v * t) / length, 0.0), 1.0) if length > 0.0 else 0.0
        off = math.hypot(s - share * u, t - share * v)
        if off < least:
            least, found = off, [a + share * u, b + share * v]
    return np.array(point if inside else found, dtype=np.float64)


def slope(corners: Mat) -> Vec:
    """(dz/dx, dz/dy) of the plane through points ``(m, 3)``, least squares; none for points in a line from above."""
    (x, y, z) = (corners - corners.mean(axis=0)).T
    xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
    size = xx * yy - xy * xy
    if not size > _LINE * (xx + yy) ** 2:
        return np.zeros(2)
    return np.array([yy * (x @ z) - xy * (y @ z), xx * (y @ z) - xy * (x @ z)]) / size
