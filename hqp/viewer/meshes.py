"""Shapes of a robot as triangles for the page; links between joints where a robot has none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec

GREY = (0.72, 0.75, 0.79)


def load(shape: Any) -> Any:
    """A trimesh.Trimesh of a shape in its body's axes; None where the file cannot be read."""
    import trimesh  # pyright: ignore[reportMissingImports]

    if shape.triangles is not None:
        mesh: Any = trimesh.Trimesh(vertices=shape.triangles[0], faces=shape.triangles[1], process=False)
    elif shape.kind == "mesh":
        try:
            mesh = trimesh.load(Path(shape.path), force="mesh", process=False)
        except (ValueError, ImportError, OSError, NotImplementedError):
            return None
        if not len(getattr(mesh, "faces", ())):
            return None
        mesh.vertices = np.asarray(mesh.vertices) * np.asarray(shape.size)
    elif shape.kind == "box":
        mesh = trimesh.creation.box(extents=shape.size)
    elif shape.kind == "sphere":
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=shape.size[0])
    elif shape.kind == "cylinder":
        mesh = trimesh.creation.cylinder(radius=shape.size[0], height=shape.size[1], sections=32)
    else:
        mesh = trimesh.creation.capsule(radius=shape.size[0], height=shape.size[1], count=[24, 12])
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = shape.rotation, shape.position
    mesh.apply_transform(place)
    return mesh


def color_of(shape: Any, mesh: Any) -> tuple[int, int, int] | None:
    """Red, green, blue of a shape, 0 to 255; None where the mesh brings colours of its own."""
    if shape.color is not None:
        rgb = shape.color[:3]
    elif getattr(mesh.visual, "defined", False):
        return None
    else:
        rgb = GREY
    r, g, b = (round(255 * min(max(c, 0.0), 1.0)) for c in rgb)
    return r, g, b


def links(robot: Any) -> list[tuple[int, Any]]:
    """Bodies and meshes of a robot without shapes: a rod from each joint to the next, a ball at each joint."""
    import trimesh  # pyright: ignore[reportMissingImports]

    places = [(np.array(p), np.array(R)) for *_, (p, R) in robot.bodies]
    size = max((float(np.linalg.norm(p - q)) for p, _ in places for q, _ in places), default=1.0)
    radius = max(0.012 * size, 0.004)
    found = []
    for child, (parent, *_rest) in enumerate(robot.bodies):
        if child == 0:
            continue
        found.append((child, trimesh.creation.icosphere(subdivisions=2, radius=1.4 * radius)))
        origin, R = places[parent]
        end = R.T @ (places[child][0] - origin)
        if parent > 0 and np.linalg.norm(end) > 1e-6:
            found.append((parent, trimesh.creation.cylinder(radius=radius, segment=[np.zeros(3), end], sections=16)))
    return found


def footprint(vertices: Mat, depth: float = 0.012) -> Mat:
    """Hull ``(k, 2)`` on the ground of the lowest of some points ``(m, 3)``."""
    low = vertices[vertices[:, 2] < vertices[:, 2].min() + depth]
    return hull(low[:, :2])


def hull(points: Mat) -> Mat:
    """Convex hull of points ``(m, 2)`` in the plane, counter-clockwise; the points themselves if it has no area."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return points


def quaternion(R: Mat) -> Vec:
    """wxyz of a rotation ``(3, 3)``."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(R).as_quat()
    return np.array([w, x, y, z])


def thinned(cloud: Mat, most: int = 600) -> Mat:
    """At most so many of the points ``(n, 3)``, in even steps of their order."""
    return cloud[:: -(-len(cloud) // most)]


def nearest(one: Mat, two: Mat) -> Mat:
    """The points of two clouds that are nearest to each other ``(2, 3)``."""
    squares = np.sum(one * one, axis=1)[:, None] + np.sum(two * two, axis=1) - 2.0 * one @ two.T
    i, j = np.unravel_index(int(np.argmin(squares)), squares.shape)
    return np.stack((one[i], two[j]))


def rotation(wxyz: Any) -> Mat:
    """Rotation ``(3, 3)`` of a quaternion wxyz."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = wxyz
    return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix())
