"""Shapes that collide: capsules of a robot's links, and shapes of the world around it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hqp.arrays import Mat
from hqp.errors import DeclarationError

KINDS = {"sphere": 1, "capsule": 2, "box": 3, "half_space": 0, "mesh": 3, "triangles": 3}
"""Kinds of shapes of the world, and how many numbers their size has."""


class LinkCapsule(NamedTuple):
    """A capsule fixed to a body of a robot: ends a, b of its axis in the body's axes [m], radius [m].

    fitted: true if it is fitted to the shapes of the robot's file, which then decide what can touch.
    """

    name: str
    body: int
    a: tuple[float, float, float]
    b: tuple[float, float, float]
    radius: float
    fitted: bool = False

    @property
    def link(self) -> str:
        """The link: several capsules of one are numbered after a slash."""
        link, _, number = self.name.rpartition("/")
        return link if link and number.isdigit() else self.name


class LinkHull(NamedTuple):
    """The convex hull of a shape of a link: corners in the axes of its body [m], triangles, radius that rounds it [m].

    It stands in for the capsules of the link in a pair that these cannot keep apart.
    """

    name: str
    body: int
    corners: tuple[tuple[float, float, float], ...]
    triangles: tuple[tuple[int, int, int], ...]
    rounding: float

    @property
    def a(self) -> tuple[float, float, float]:
        """Centre of a ball around it, as one end of a capsule without length [m]."""
        x, y, z = (0.5 * (min(own) + max(own)) for own in zip(*self.corners, strict=True))
        return x, y, z

    @property
    def b(self) -> tuple[float, float, float]:
        """The other end."""
        return self.a

    @property
    def radius(self) -> float:
        """Radius of the ball around it [m]."""
        middle = self.a
        return max(math.dist(middle, corner) for corner in self.corners) + self.rounding

    @property
    def edges(self) -> list[LinkCapsule]:
        """Its edges, as thick as it is rounded: together they are as far from another convex shape, but for a corner of
        that above the middle of a triangle."""
        sides = {(min(k), max(k)) for a, b, c in self.triangles for k in ((a, b), (b, c), (c, a))}
        ends = ((self.corners[a], self.corners[b]) for a, b in sorted(sides))
        return [LinkCapsule(self.name, self.body, a, b, self.rounding, True) for a, b in ends]


class Shape(NamedTuple):
    """A shape of the world, plain data: kind, name, size [m], and its pose: position [m], roll, pitch, yaw [rad].

    file: path of a mesh, whose size is the scale along x, y, z.
    """

    kind: str
    name: str
    size: tuple[float, ...]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    file: str = ""

    @property
    def is_mesh(self) -> bool:
        """True if it comes from a file."""
        return self.kind in ("mesh", "triangles")

    @property
    def pose(self) -> Mat:
        """Matrix ``(4, 4)`` of the pose."""
        (r, p, y), T = self.rpy, np.eye(4)
        cr, sr, cp, sp, cy, sy = math.cos(r), math.sin(r), math.cos(p), math.sin(p), math.cos(y), math.sin(y)
        T[:3, :3] = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
        T[:3, 3] = self.position
        return T


def sphere(name: str, radius: float, position: Any = (0.0, 0.0, 0.0)) -> Shape:
    """A sphere of a radius [m]."""
    return checked(("sphere", name, (radius,), position))


def capsule(name: str, radius: float, length: float, position: Any = (0.0, 0.0, 0.0), rpy: Any = (0.0,) * 3) -> Shape:
    """A capsule around a piece of its z axis of a length [m], centred."""
    return checked(("capsule", name, (radius, length), position, rpy))


def box(name: str, size: Any, position: Any = (0.0, 0.0, 0.0), rpy: Any = (0.0,) * 3) -> Shape:
    """A box of whole edge lengths ``(3,)`` [m], centred."""
    return checked(("box", name, size, position, rpy))


def half_space(name: str, position: Any = (0.0, 0.0, 0.0), rpy: Any = (0.0,) * 3) -> Shape:
    """All that lies below the plane through a position, whose outward normal is the pose's z axis: floor, wall."""
    return checked(("half_space", name, (), position, rpy))


def mesh(
    name: str,
    file: str | Path,
    position: Any = (0.0, 0.0, 0.0),
    rpy: Any = (0.0,) * 3,
    *,
    scale: Any = 1.0,
    convex: bool = True,
) -> Shape:
    """A mesh (STL, OBJ, DAE): its convex hull, or its triangles, whose inside counts as free; through coal.

    scale: scale from its numbers to metres, one or ``(3,)``.  A stack with meshes takes the readable path, slower than
    native shapes.  Raises DeclarationError for a file that is missing.
    """
    scales = (scale,) * 3 if np.ndim(scale) == 0 else scale
    return checked(("mesh" if convex else "triangles", name, scales, position, rpy, str(file)))


def checked(given: Any) -> Shape:
    """A Shape of plain data; raises DeclarationError for invalid data."""
    try:
        kind, name, size, *rest = given
        pose, file = rest[:2], rest[2] if len(rest) == 3 else ""
        sizes = tuple(float(x) for x in size)
        vectors = [tuple(float(x) for x in v) for v in pose]
    except (TypeError, ValueError):
        raise DeclarationError("shape", "no shape", value=given, allowed=_ALLOWED) from None
    fits = kind in KINDS and len(sizes) == KINDS.get(kind) and isinstance(name, str) and bool(name)
    fits &= all(0.0 < x < math.inf for x in sizes) and len(rest) <= 3 and isinstance(file, str)
    if not fits or any(len(v) != 3 or not all(map(math.isfinite, v)) for v in vectors):
        raise DeclarationError(f"shape {name!r}", "no shape", value=given, allowed=_ALLOWED)
    shape = Shape(kind, name, sizes, *vectors)._replace(file=file)  # type: ignore[arg-type]
    if shape.is_mesh and not Path(file).is_file():
        raise DeclarationError(f"shape {name!r}", "no such file", value=file, allowed="the path of an STL, OBJ or DAE")
    return shape


_ALLOWED = "sphere, capsule, box, half_space or mesh of hqp.shapes, with sizes above 0 and finite positions and angles"
