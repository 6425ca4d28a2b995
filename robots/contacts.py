"""Contact of the collision shapes of two bodies of a robot, by coal."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.collision_library import Placement, coal, convex_hull, solid
from hqp.shapes import LinkHull

from .surface import sphere, surface

Pose = tuple[Vec, Mat]
"""Position ``(3,)`` [m] and rotation ``(3, 3)`` in the world."""

ROUNDED, CORNERS = 5e-4, 128
"""Distance from the corners of a hull to the shape within which it is not refined [m], and its most corners."""
BATCH = 16
"""Corners that a hull gets at once."""

_REQUEST = coal.CollisionRequest()


class Contacts:
    """The shapes of a pinocchio.GeometryModel by the body that carries them, without those without an end."""

    def __init__(self, shapes: Any) -> None:
        self._of: dict[int, list[tuple[Any, Any]]] = {}
        self._items: dict[int, list[Any]] = {}
        self._hulls: dict[tuple[int, str], tuple[LinkHull, ...]] = {}
        for item in shapes.geometryObjects:
            if type(item.geometry).__name__ not in ("Halfspace", "Plane"):
                place = Placement(item.placement.rotation, item.placement.translation)
                self._of.setdefault(int(item.parentJoint), []).append((item.geometry, place))
                self._items.setdefault(int(item.parentJoint), []).append(item)

    def digest(self) -> bytes:
        """Equal for equal shapes on equal bodies."""
        found = hashlib.sha256()
        for body, items in sorted(self._items.items()):
            for item in items:
                own = surface(item, around=True)
                found.update(f"\0{body} {type(item.geometry).__name__} {own.triangles.shape}".encode())
                found.update(own.triangles.tobytes() + own.radii.tobytes())
        return found.digest()

    def touch(self, one: int, two: int, first: Pose, second: Pose) -> bool:
        """Return true if shapes of two bodies overlap at these poses."""
        here, there = (Placement(rotation, position) for position, rotation in (first, second))
        result = coal.CollisionResult()
        for a, at in self._of.get(one, ()):
            for b, to in self._of.get(two, ()):
                result.clear()
                if coal.collide(a, here * at, b, there * to, _REQUEST, result):
                    return True
        return False

    def hulls(self, body: int, name: str) -> tuple[LinkHull, ...]:
        """Convex hulls of the shapes of a body, each within ``ROUNDED`` of its shape's if ``CORNERS`` suffice."""
        if (body, name) not in self._hulls:
            self._hulls[body, name] = tuple(_hull(item, body, name) for item in self._items.get(body, ()))
        return self._hulls[body, name]


def _hull(item: Any, body: int, name: str) -> LinkHull:
    """The hull of a few corners of a shape, rounded by the distance of the others: it contains the shape."""
    own = surface(item, around=True)
    points, swept = np.unique(own.triangles.reshape(-1, 3), axis=0), float(own.radii.max())
    whole = convex_hull(points)
    corners = whole.points[whole.vertices]
    chosen = np.unique(np.argmax(corners @ sphere(16).T, axis=0)).tolist()
    while True:
        found = convex_hull(corners[chosen])
        height = corners @ found.equations[:, :3].T + found.equations[:, 3]
        off, face = height.max(axis=1), height.argmax(axis=1)
        order = [int(k) for k in np.argsort(-off) if off[k] > ROUNDED]
        if not order or len(chosen) >= CORNERS:
            break
        first = np.unique(face[order], return_index=True)[1]  # the farthest beyond each face
        chosen += [order[k] for k in sorted(first)][: min(BATCH, CORNERS - len(chosen))]
    few, there, here = solid(found), Placement.Identity(), coal.Sphere(1e-9)
    rest = [
        coal.distance(here, Placement(np.eye(3), p), few, there, coal.DistanceRequest(), coal.DistanceResult())
        for p in corners[off > 0.0]
    ]
    place = {int(v): k for k, v in enumerate(found.vertices)}
    return LinkHull(
        name,
        body,
        tuple((x, y, z) for x, y, z in found.points[found.vertices].tolist()),
        tuple((place[i], place[j], place[k]) for i, j, k in found.simplices.tolist()),
        swept + max([0.0, *rest]) + 1e-9,
    )
