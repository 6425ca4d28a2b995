"""The surface of a robot's shapes as triangles: the one place that reads scale, pose and kind of a geometry."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import ModelError

SIDES = 48
"""Corners of the polygon that stands for a circle."""


class Surface(NamedTuple):
    """Triangles ``(n, 3, 3)`` [m], each swept by a radius ``(n,)`` [m].

    A ball is a triangle whose corners coincide, a capsule one with two distinct corners: both are exact.
    """

    triangles: Mat
    radii: Vec

    def points(self) -> Mat:
        """Corners of the triangles without their radius ``(m, 3)`` [m]."""
        return np.unique(self.triangles.reshape(-1, 3), axis=0)

    def lowest(self) -> Mat:
        """Lowest point of each swept corner along z ``(m, 3)`` [m]."""
        below = self.triangles - self.radii[:, None, None] * np.array([0.0, 0.0, 1.0])
        return np.unique(below.reshape(-1, 3), axis=0)

    def placed(self, placement: Any) -> Surface:
        """The surface, placed by a pinocchio.SE3."""
        return Surface(self.triangles @ placement.rotation.T + placement.translation, self.radii)


def surface(item: Any, *, around: bool = False) -> Surface:
    """The surface of a pinocchio.GeometryObject in the axes of its joint.

    Boxes, balls, capsules and meshes are exact.  Polygons stand for the circles of cylinders, cones and ellipsoids:
    inside them, or around them if ``around``.  The vertices of a mesh have its scale already, which
    ``GeometryObject.meshScale`` repeats.  Raises ModelError for a geometry without an end, such as a half-space.
    """
    triangles, radius = _triangles(item.geometry, around)
    return Surface(triangles, np.full(len(triangles), radius)).placed(item.placement)


def _triangles(shape: Any, around: bool) -> tuple[Mat, float]:
    kind = type(shape).__name__
    grown = 1.0 / np.cos(np.pi / SIDES) if around else 1.0
    if kind == "Sphere":
        return np.zeros((1, 3, 3)), float(shape.radius)
    if kind == "Capsule":
        return np.array([[[0.0, 0.0, z * shape.halfLength] for z in (-1.0, 1.0, 1.0)]]), float(shape.radius)
    if kind == "Box":
        square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
        return _prism(square, square) * np.asarray(shape.halfSide), 0.0
    if kind in ("Cylinder", "Cone"):
        circle = grown * _circle()
        size = np.array([shape.radius, shape.radius, shape.halfLength])
        return _prism(circle, circle if kind == "Cylinder" else 0.0 * circle) * size, 0.0
    if kind == "Ellipsoid":
        ball, inside = _ball()
        return ball * np.asarray(shape.radii) / (inside if around else 1.0), 0.0
    if kind == "TriangleP":
        return np.array([[shape.a, shape.b, shape.c]], dtype=np.float64).reshape(1, 3, 3), 0.0
    found = vertices_and_faces(shape)
    if found is None:
        raise ModelError(f"the surface of a {kind} cannot be read; allowed: boxes, balls, capsules, cylinders, meshes")
    points, faces = found
    return points[faces], 0.0


def vertices_and_faces(shape: Any) -> tuple[Mat, Any] | None:
    """Vertices ``(k, 3)`` [m] and triangles ``(m, 3)`` of a mesh in memory; None for another geometry."""
    if hasattr(shape, "num_tris") and hasattr(shape, "vertices"):
        corners, faces = shape.vertices(), [shape.tri_indices(i) for i in range(shape.num_tris)]
    elif hasattr(shape, "polygons") and hasattr(shape, "points"):
        corners, faces = shape.points(), [shape.polygons(i) for i in range(shape.num_polygons)]
    else:
        return None
    triangles = [(face[0], face[1], face[2]) for face in faces]  # iterating over one raises
    return np.array(corners, dtype=np.float64).reshape(-1, 3), np.array(triangles, dtype=np.intp).reshape(-1, 3)


def _circle() -> Mat:
    turn = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    return np.column_stack((np.cos(turn), np.sin(turn)))


def _prism(lower: Mat, upper: Mat) -> Mat:
    """Triangles between a polygon ``(k, 2)`` at z = -1 and one at z = 1."""
    low, high = (np.column_stack((ring, np.full(len(ring), z))) for ring, z in ((lower, -1.0), (upper, 1.0)))
    low_next, high_next = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    sides = [np.stack((low, low_next, high_next), axis=1), np.stack((low, high_next, high), axis=1)]
    caps = [
        np.stack((np.broadcast_to(ring[0], ring.shape), ring, after), axis=1)
        for ring, after in ((low, low_next), (high, high_next))
    ]
    found: Mat = np.concatenate(sides + caps)
    return found


@cache
def _ball() -> tuple[Mat, float]:
    """Triangles of a polyhedron with corners on the unit sphere, and the radius of the ball inside it."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(sphere(400))
    return np.asarray(hull.points[hull.simplices]), float(-hull.equations[:, 3].max())


def sphere(count: int = 100) -> Mat:
    """Unit vectors ``(count, 3)`` spread over the sphere."""
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / count), np.pi * (1.0 + np.sqrt(5.0)) * k
    return np.column_stack((np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)))
