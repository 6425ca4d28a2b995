"""Appearance of a robot: the shapes of its description file as plain data, for whoever draws them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import ModelError

from .surface import vertices_and_faces

Kind = Literal["mesh", "box", "sphere", "cylinder", "capsule"]


@dataclass(frozen=True)
class Shape:
    """A shape fixed in a body: its place there, and its kind.

    body: index into ``robot.bodies``.  position ``(3,)`` [m], rotation ``(3, 3)``: in the body's axes.  size: scale of
    a mesh ``(3,)``; sides of a box ``(3,)``; radius of a sphere; radius and length of the others [m], along z.  path:
    path of a mesh file; triangles: corners and triangles of a mesh without one.  color: red, green, blue, opacity, 0 to
    1, None where the file names none.
    """

    body: int
    kind: Kind
    position: Vec
    rotation: Mat
    size: tuple[float, ...]
    path: str = ""
    color: tuple[float, float, float, float] | None = None
    triangles: tuple[Mat, Mat] | None = None


def shapes(robot: Any) -> tuple[Shape, ...]:
    """The visual shapes of a robot, none where its model came without a file or a mesh is missing."""
    try:
        geometry = robot.visual
    except ModelError:
        return ()
    found = (_shape(item) for item in geometry.geometryObjects)
    return tuple(shape for shape in found if shape is not None)


def _shape(item: Any) -> Shape | None:
    geometry, path = item.geometry, str(item.meshPath)
    kind, size = _primitive(geometry)
    triangles = None
    if kind is None:
        if Path(path).is_file():
            size = tuple(float(s) for s in item.meshScale)
        else:
            triangles, size, path = vertices_and_faces(geometry), (1.0, 1.0, 1.0), ""
            if triangles is None:
                return None
        kind = "mesh"
    r, g, b, a = (float(c) for c in item.meshColor)
    plain = r == g == b and 0.89 < r < 0.91  # Pinocchio's grey where the file has no colour
    return Shape(
        int(item.parentJoint),
        kind,
        np.array(item.placement.translation),
        np.array(item.placement.rotation),
        size,
        path if kind == "mesh" else "",
        None if plain else (r, g, b, a),
        triangles,
    )


def _primitive(geometry: Any) -> tuple[Kind | None, tuple[float, ...]]:
    name = type(geometry).__name__
    if name == "Box":
        return "box", tuple(2.0 * float(h) for h in geometry.halfSide)
    if name == "Sphere":
        return "sphere", (float(geometry.radius),)
    if name in ("Cylinder", "Capsule"):
        return ("cylinder" if name == "Cylinder" else "capsule"), (
            float(geometry.radius),
            2.0 * float(geometry.halfLength),
        )
    return None, ()
