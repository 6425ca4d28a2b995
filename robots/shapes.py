"""What a robot looks like: the shapes of its description file as plain data, for whoever draws them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from hqp.arrays import Mat, Vec

from . import catalogue

Kind = Literal["mesh", "box", "sphere", "cylinder", "capsule"]


@dataclass(frozen=True)
class Shape:
    """A shape fixed in a body: its place there, and what it is.

    body: index into ``robot.bodies``.  position ``(3,)`` [m], rotation ``(3, 3)``: in the body's axes.
    size: scale of a mesh ``(3,)``; sides of a box ``(3,)``; radius of a sphere; radius and length of the others [m],
    along z.  path: of a mesh file.  color: red, green, blue, opacity, 0 to 1, None where the file names none.
    """

    body: int
    kind: Kind
    position: Vec
    rotation: Mat
    size: tuple[float, ...]
    path: str = ""
    color: tuple[float, float, float, float] | None = None


def shapes(robot: Any) -> tuple[Shape, ...]:
    """The visual shapes of a robot, none where its model came without a file or its meshes are missing."""
    geometry = getattr(robot, "visual", None)
    if geometry is None:
        geometry = _read(robot)
    if geometry is None:
        return ()
    found = (_shape(item) for item in geometry.geometryObjects)
    return tuple(shape for shape in found if shape is not None)


def _read(robot: Any) -> Any:
    path = _path(robot.name)
    if path is None or path.suffix != ".urdf":
        return None
    folders = [str(folder) for folder in path.parents[:5]]
    try:
        return pin.buildGeomFromUrdf(robot.model, str(path), pin.VISUAL, None, folders)
    except (ValueError, RuntimeError):
        return None


def _path(name: str) -> Path | None:
    own = Path(__file__).parent / name / f"{name}.urdf"
    if own.is_file():
        return own
    stem = catalogue._catalogue().get(name, {"stem": name})["stem"]
    return catalogue._stems().get(stem)


def _shape(item: Any) -> Shape | None:
    geometry, path = item.geometry, str(item.meshPath)
    kind, size = _primitive(geometry)
    if kind is None:
        if not Path(path).is_file():
            return None
        kind, size = "mesh", tuple(float(s) for s in item.meshScale)
    rgba = [float(c) for c in item.meshColor]
    plain = rgba[:3] == [rgba[0]] * 3 and 0.89 < rgba[0] < 0.91  # Pinocchio's grey where the file has no colour
    color = None if plain else (rgba[0], rgba[1], rgba[2], rgba[3])
    placement = item.placement
    return Shape(
        int(item.parentJoint),
        kind,
        np.array(placement.translation),
        np.array(placement.rotation),
        size,
        path if kind == "mesh" else "",
        color,
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
