"""Distances between a capsule and a mesh, by coal: convex hulls with penetration depth, or triangles."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec, cross
from hqp.collision_library import MESH_DISTANCES, Placement, coal, convex_hull, solid
from hqp.errors import DeclarationError
from hqp.shapes import Shape

from .distances import TOUCHING, Found

_REQUEST = coal.DistanceRequest()


@lru_cache(maxsize=64)
def _load(kind: str, file: str, scale: tuple[float, ...]) -> Any:
    mesh = coal.MeshLoader(coal.BV_OBBRSS).load(file, np.array(scale))
    if mesh.num_vertices < 4:
        raise ValueError("fewer than four vertices")
    if kind == "triangles":
        return mesh
    return solid(convex_hull(np.array(mesh.vertices(), dtype=np.float64).reshape(-1, 3)))


def read(shape: Shape) -> Any:
    """The geometry of a mesh, read once; raises DeclarationError for a file that cannot be read."""
    if not MESH_DISTANCES:
        raise DeclarationError(
            f"shape {shape.name!r}",
            "distances to meshes need coal, which comes with Pinocchio 3: pip install 'pin>=3.8'",
            value=shape.kind,
            allowed="a box, sphere, capsule or half-space beside Pinocchio 2",
        )
    try:
        return _load(shape.kind, shape.file, shape.size)
    except (ValueError, RuntimeError) as error:
        raise DeclarationError(
            f"shape {shape.name!r}", f"cannot be read ({error})", value=shape.file, allowed="an STL, OBJ or DAE"
        ) from error


def to_mesh(a: Vec, b: Vec, radius: float, geometry: Any, pose: Mat) -> Found:
    """Distance [m] from the capsule of the axis a b to a mesh at a pose ``(4, 4)``, normal, nearest axis point."""
    axis = b - a
    length = math.sqrt(float(axis @ axis))
    if length > TOUCHING:
        shape, turn = coal.Capsule(radius, length), _along(axis / length)
    else:
        shape, turn = coal.Sphere(radius), np.eye(3)
    result = coal.DistanceResult()
    here, there = Placement(turn, 0.5 * (a + b)), Placement(pose[:3, :3], pose[:3, 3])
    coal.distance(shape, here, geometry, there, _REQUEST, result)
    normal = np.array(result.normal).reshape(3)
    return float(result.min_distance), normal, np.array(result.getNearestPoint1()).reshape(3) - radius * normal


def _along(z: Vec) -> Mat:
    """A rotation ``(3, 3)`` whose z axis is a unit vector."""
    x = cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= math.sqrt(float(x @ x))
    return np.column_stack((x, cross(z, x), z))
