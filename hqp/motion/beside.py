"""Legs side by side: outlines of soles and shanks from above that do not overlap."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hqp.arrays import Mat, Vec

ROUNDS = 8
"""Largest number of rounds in which places of feet, or a path, are moved apart."""

NEAR = 1e-4
"""Overlap that is left [m]."""


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

    Both counter-clockwise.  0 if no shift along the way parts them.
    """
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


def seen(outline: Mat, place: Vec, R: Mat) -> Mat:
    """An outline ``(m, 2)`` of a sole at a place, with axes R ``(3, 3)``, from above ``(m, 2)`` [m]."""
    return np.asarray(place[:2] + outline @ R[:2, :2].T)


def aside(place: Mat, R: Mat, outline: Mat, others: list[Mat], ways: Mat) -> Mat:
    """A path between two stances ``(n, 3)``, moved aside so that its outline passes by those of the other leg.

    R ``(n, 3, 3)``: its axes, x ahead, z up.  others: outlines of the other leg, frame by frame.  ways ``(n, 2)``: away
    from it.  The shift is 0 and at rest at both ends, and largest half way.
    """
    s = (np.arange(len(place)) + 1.0) / (len(place) + 1.0)
    share, path = 16.0 * (s * (1.0 - s)) ** 2, place.copy()
    for _ in range(ROUNDS):
        each = zip(path, R, others, ways, strict=True)
        lacks = np.array([overlap(seen(outline, p, axes), other, way) for p, axes, other, way in each])
        k = int((lacks * share).argmax())
        if lacks[k] * share[k] < NEAR:
            break
        path[:, :2] += np.outer(share, lacks[k] / share[k] * ways[k])
    return path
