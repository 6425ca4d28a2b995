"""The one place where coal is imported, or hpp-fcl 2, which Pinocchio 2.7 was built with, under coal's name."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    coal: Any = importlib.import_module("coal")
except ImportError:
    coal = importlib.import_module("hppfcl")

MESH_DISTANCES: bool = coal.__name__ == "coal"
"""False beside hpp-fcl 2.4, which returns 0.397 m for a sphere 0.35 m from a box of triangles, and wrong normals."""

Placement: Any = coal.Transform3s if MESH_DISTANCES else coal.Transform3f

THIN = 1e-5
"""Half the thickness that a flat hull gets [m]: coal needs a volume."""


def triangles(points: NDArray[np.float64], faces: Any) -> Any:
    """A mesh of points ``(n, 3)`` [m] and triangles ``(m, 3)``."""
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(faces), len(points))
    mesh.addVertices(np.asarray(points, dtype=np.float64))
    mesh.addTriangles(np.asarray(faces, dtype=np.int64))
    mesh.endModel()
    return mesh


def solid(hull: Any) -> Any:
    """The convex shape of a scipy.spatial.ConvexHull: distances are three times as fast as those of its triangles."""
    place = np.zeros(len(hull.points), dtype=np.int64)
    place[hull.vertices] = np.arange(len(hull.vertices))
    mesh = triangles(hull.points[hull.vertices], place[hull.simplices])
    try:
        mesh.buildConvexRepresentation(False)
    except RuntimeError:  # a corner with more than 255 neighbours, such as the middle of a fine disc
        return mesh
    return mesh.convex


def convex_hull(points: NDArray[np.float64]) -> Any:
    """The scipy.spatial.ConvexHull of points ``(n, 3)`` [m], thickened if they are flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points)
    except QhullError:
        return ConvexHull((points[:, None] + THIN * np.vstack((np.eye(3), -np.eye(3)))).reshape(-1, 3))


__all__ = ["MESH_DISTANCES", "Placement", "coal", "convex_hull", "solid", "triangles"]
