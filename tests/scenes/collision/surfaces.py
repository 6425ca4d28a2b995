"""Robots of one shape each, points on the surface of shapes, and how capsules lie around them, judged by coal."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import hqp
from hqp.collision_library import Placement, coal

MASS = '<inertial><mass value="1"/><inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial>'
BOX = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4)]
    + [(1, 5, 7), (1, 7, 3)]
)
SHAPES = {
    "rod": '<box size=".3 .08 .04"/>',
    "cube": '<box size=".1 .1 .1"/>',
    "plate": '<box size=".4 .3 .004"/>',
    "small plate": '<box size=".05 .03 .002"/>',
    "drum": '<cylinder radius=".15" length=".1"/>',
    "pole": '<cylinder radius=".03" length=".5"/>',
    "ball": '<sphere radius=".07"/>',
    "box in mm": '<mesh filename="box.stl" scale=".001 .001 .001"/>',
    "mirrored": '<mesh filename="box.stl" scale=".001 -.001 .001"/>',
    "in inches": '<mesh filename="box.stl" scale=".0254 .0127 .00635"/>',
    "in m": '<mesh filename="metres.stl"/>',
}


def write_stl(path: Path, corners: Any) -> None:
    with path.open("wb") as stl:
        stl.write(bytes(80) + struct.pack("<I", len(FACES)))
        for face in FACES:
            stl.write(bytes(12) + b"".join(struct.pack("<3f", *corners[i]) for i in face) + bytes(2))


def arm(folder: Path, *geometries: str, place: str = "0.1 0.02 -0.03", rpy: str = "0.3 -0.2 0.5") -> Any:
    write_stl(folder / "box.stl", BOX * (20.0, 6.0, 5.0) if ".0254" in "".join(geometries) else BOX * (200, 60, 50))
    write_stl(folder / "metres.stl", BOX * (0.2, 0.06, 0.05))
    collisions = "".join(
        f'<collision><origin xyz="{place}" rpy="{rpy}"/><geometry>{g}</geometry></collision>' for g in geometries
    )
    path = folder / "generated_arm.urdf"
    path.write_text(
        f'<robot name="generated_arm"><link name="base">{MASS}</link><link name="arm">{MASS}{collisions}</link>'
        '<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
        '<limit lower="-2" upper="2" velocity="1" effort="9"/></joint></robot>'
    )
    return hqp.robots.load(path)


def drawn(item: Any, count: int, rng: Any) -> Any:
    """Points on the surface of a collision object by the definition of its kind ``(count, 3)``, in the joint's axes."""
    shape, kind = item.geometry, type(item.geometry).__name__
    ball = rng.normal(size=(count, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    if kind == "Sphere":
        at = shape.radius * ball
    elif kind == "Capsule":
        at = shape.radius * ball
        at[:, 2] += np.where(rng.random(count) < 0.5, np.sign(at[:, 2]), rng.uniform(-1, 1, count)) * shape.halfLength
        at[:, 2] = np.clip(at[:, 2], -shape.halfLength - shape.radius, shape.halfLength + shape.radius)
        core = np.clip(at[:, 2], -shape.halfLength, shape.halfLength)
        off = at - np.column_stack((0.0 * core, 0.0 * core, core))
        at = at - off + shape.radius * off / np.linalg.norm(off, axis=1)[:, None]
    elif kind == "Box":
        at = rng.uniform(-1.0, 1.0, (count, 3))
        at[np.arange(count), rng.integers(3, size=count)] = rng.choice([-1.0, 1.0], count)
        at *= np.asarray(shape.halfSide)
    elif kind == "Cylinder":
        turn, share = rng.uniform(0, 2 * np.pi, count), np.where(rng.random(count) < 0.5, 1.0, rng.random(count) ** 0.5)
        z = np.where(share == 1.0, rng.uniform(-1, 1, count), rng.choice([-1.0, 1.0], count)) * shape.halfLength
        at = np.column_stack((shape.radius * share * np.cos(turn), shape.radius * share * np.sin(turn), z))
    elif kind == "Ellipsoid":
        at = ball * np.asarray(shape.radii)
    else:
        if kind == "Convex":
            corners, faces = np.array(shape.points()), [shape.polygons(i) for i in range(shape.num_polygons)]
        else:
            corners, faces = np.array(shape.vertices()), [shape.tri_indices(i) for i in range(shape.num_tris)]
        triangles = corners[np.array([(f[0], f[1], f[2]) for f in faces])]
        area = np.linalg.norm(np.cross(*(triangles[:, k] - triangles[:, 0] for k in (1, 2))), axis=1)
        chosen = triangles[rng.choice(len(area), count, p=area / area.sum())]
        at = np.einsum("nk,nkd->nd", rng.dirichlet((1.0, 1.0, 1.0), count), chosen)
    return at @ item.placement.rotation.T + item.placement.translation


def outside(points: Any, links: Any) -> float:
    """Largest distance of points from the union of capsules [m]."""
    least = np.full(len(points), np.inf)
    for c in links:
        a, axis = np.array(c.a), np.array(c.b) - np.array(c.a)
        s = np.clip((points - a) @ axis / max(float(axis @ axis), 1e-18), 0.0, 1.0)
        least = np.minimum(least, np.linalg.norm(points - a - s[:, None] * axis, axis=1) - c.radius)
    return float(least.max())


@dataclass(frozen=True)
class Around:
    """Capsules of a link.

    capsules: their number.  outside: largest distance of its surface from them [m].  away: their mean distance from its
    hull [m], at most ``allowed``.  size: its largest side [m].
    """

    link: str
    capsules: int
    outside: float
    away: float
    size: float

    @property
    def allowed(self) -> float:
        """max(10 mm, 10 % of the link's size) [m]."""
        return max(0.01, 0.1 * self.size)


def around(robot: Any, found: Any, count: int = 10_000) -> list[Around]:
    """Measure the capsules of each link that moves, by ``count`` points on each of its shapes."""
    rng = np.random.default_rng(1)
    items = [i for i in robot.geometry.geometryObjects if type(i.geometry).__name__ not in ("Halfspace", "Plane")]
    links = []
    for joint in sorted({int(i.parentJoint) for i in items} - {0}):
        own = [c for c in found if c.body == joint]
        cloud = np.concatenate([drawn(i, count, rng) for i in items if i.parentJoint == joint])
        hull = coal.ConvexBase.convexHull(vectors(cloud), False, "Qt")
        away, areas = [], []
        for c in own:
            a, axis = np.array(c.a), np.array(c.b) - np.array(c.a)
            length = float(np.linalg.norm(axis))
            at = rng.normal(size=(150, 3))
            at *= c.radius / np.linalg.norm(at, axis=1)[:, None]
            along = at @ axis / max(length, 1e-12)
            side = rng.random(150) < length / (length + 2 * c.radius)
            flat = at - np.outer(along, axis / max(length, 1e-12))
            flat *= c.radius / np.maximum(np.linalg.norm(flat, axis=1), 1e-12)[:, None]
            at = np.where(side[:, None], a + rng.random((150, 1)) * axis + flat, a + at + (along > 0.0)[:, None] * axis)
            away.append(np.mean([max(distance(p, hull), 0.0) for p in at]))
            areas.append(2 * np.pi * c.radius * (length + 2 * c.radius))
        mean = float(np.average(away, weights=areas)) if own else np.inf
        size = float(np.ptp(cloud, axis=0).max())
        links.append(Around(str(robot.model.names[joint]), len(own), outside(cloud, own), mean, size))
    return links


def vectors(points: Any) -> Any:
    found = (coal.StdVec_Vec3s if hasattr(coal, "StdVec_Vec3s") else coal.StdVec_Vec3f)()
    found.extend(list(points))
    return found


def distance(point: Any, hull: Any) -> float:
    result, here = coal.DistanceResult(), Placement(np.eye(3), point)
    coal.distance(coal.Sphere(1e-9), here, hull, Placement.Identity(), coal.DistanceRequest(), result)
    return float(result.min_distance)
