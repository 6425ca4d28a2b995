"""Legs side by side: sections of soles and shanks at one height that do not overlap from above."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.tasks.support_polygon import hull

ROUNDS = 8
"""Largest number of rounds in which places of feet, or a path, are moved apart."""

SOON = 0.2
"""Share of a swing in which a foot is moved aside at the earliest: half way, 9 mm at lift-off would be 82 there."""

NEAR = 1e-4
"""Overlap that is left [m]."""


class Leg(NamedTuple):
    """Outline of a sole ``(m, 2)``, from there to the ankle ``(3,)``, outline of the shank ``(k, 2)``, in axes x ahead,
    z up at the sole's point, and height below which the foot is beside another [m].
    """

    sole: Mat
    ankle: Vec
    shank: Mat
    top: float

    def section(self, R: Mat, shin: Vec, height: float) -> Mat:
        """Outline about its place of a leg at a height above it, from above ``(m, 2)``: none above the knee.

        R ``(3, 3)``: axes of the sole.  shin ``(3,)``: from the ankle to the knee.
        """
        ankle = R @ self.ankle
        up = max(height - ankle[2], 0.0)
        points = [self.sole @ R[:2, :2].T] if height < self.top else []
        if up <= max(shin[2], 0.0):
            points.append(self.shank + (ankle + up / max(shin[2], 1e-9) * shin)[:2])
        around = np.vstack([np.zeros((0, 2)), *points])
        return around[hull(around)] if points else around


class Pair(NamedTuple):
    """Two stances that share time: numbers, outlines about their places ``(m, 2)`` [m], way to the left ``(2,)``."""

    left: int
    right: int
    one: Mat
    other: Mat
    way: Vec


def part(places: tuple[Mat, Mat], pairs: list[Pair]) -> None:
    """Move places of left and right feet ``(n, 3)`` [m] apart, each by half, until no pair of outlines overlaps."""
    one, other = places
    for _ in range(ROUNDS):
        lacks = [overlap(one[p.left, :2] + p.one, other[p.right, :2] + p.other, p.way) for p in pairs]
        if max(lacks, default=0.0) < NEAR:
            break
        for p, lack in zip(pairs, lacks, strict=True):
            one[p.left, :2] += 0.5 * lack * p.way
            other[p.right, :2] -= 0.5 * lack * p.way


def overlap(one: Mat, other: Mat, way: Vec) -> float:
    """Least shift of a convex outline ``(m, 2)`` along a way ``(2,)`` after which it does not overlap another [m].

    Both counter-clockwise.  0 if no shift along the way parts them, or without corners.
    """
    if not len(one) or not len(other):
        return 0.0
    gaps, slopes = [], []
    for fixed, moved, sign in ((other, one, 1.0), (one, other, -1.0)):
        along = np.roll(fixed, -1, axis=0) - fixed
        normals = np.column_stack((along[:, 1], -along[:, 0]))
        gaps.append((normals @ moved.T).min(axis=1) - np.sum(normals * fixed, axis=1))
        slopes.append(sign * normals @ way)
    gap, slope = np.concatenate(gaps), np.concatenate(slopes)
    if gap.max() >= 0.0:
        return 0.0
    apart = slope > 1e-9
    return float((-gap[apart] / slope[apart]).min()) if apart.any() else 0.0


def aside(path: Mat, outlines: list[Mat], others: list[Mat], ways: Mat) -> Mat:
    """A path between two stances ``(n, 3)``, moved aside so that its outlines pass by those of the other leg.

    outlines: the leg about its place in each frame.  others: the other leg.  ways ``(n, 2)``: away from it.
    Each shift is 0 and at rest at both ends, and as large as it has to be from the first to the last overlap, which
    count as ``SOON`` from the ends at least.
    """
    s, path = (np.arange(len(path)) + 1.0) / (len(path) + 1.0), path.copy()
    for _ in range(ROUNDS):
        each = zip(path, outlines, others, ways, strict=True)
        lacks = np.array([overlap(p[:2] + one, other, way) for p, one, other, way in each])
        near = s[lacks > NEAR]
        if not near.size:
            break
        first, last = (min(max(edge, SOON), 1.0 - SOON) for edge in (near[0], near[-1]))
        x = np.clip(np.minimum(s / first, (1.0 - s) / (1.0 - last)), 0.0, 1.0)
        share = x * x * (3.0 - 2.0 * x)
        k = int((lacks * share).argmax())
        if lacks[k] * share[k] < NEAR:
            break  # the places of its stances part the legs as a foot lifts and lands
        path[:, :2] += np.outer(share, lacks[k] / share[k] * ways[k])
    return path
