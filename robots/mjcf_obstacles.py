"""Moving bodies of an MJCF that are not the robot, as shapes of the world."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from hqp import shapes
from hqp.arrays import Mat
from hqp.shapes import Shape

from .mujoco_extra import mujoco
from .obstacles import Obstacles
from .touching import touching


def read(simulated: Any, names: tuple[str, ...], own: frozenset[int]) -> Obstacles:
    """The moving bodies of a MjModel that are not among ``own``, at its initial configuration."""
    data = mujoco.MjData(simulated)
    mujoco.mj_kinematics(simulated, data)
    found: list[Shape] = []
    bodies, places, about, touches = {}, {}, [], touching(simulated)
    for body in np.flatnonzero(simulated.body_treeid >= 0).tolist():
        if body in own:
            continue
        bodies[names[body]] = pose = _matrix(data.xpos[body], data.xmat[body].reshape(3, 3))
        first, count = int(simulated.body_geomadr[body]), int(simulated.body_geomnum[body])
        geoms = [g for g in range(first, first + count) if touches[g]]
        for k, g in enumerate(geoms):
            name = names[body] if len(geoms) == 1 else f"{names[body]}/{simulated.geom(g).name or k}"
            shape, local, exact = _shape(simulated, g, name)
            at = pose @ local
            rpy = tuple(pin.rpy.matrixToRpy(at[:3, :3]).tolist())
            found.append(shapes.checked((shape.kind, name, shape.size, tuple(at[:3, 3].tolist()), rpy)))
            places[name] = names[body], local
            about += [] if exact else [name]
    return Obstacles(tuple(found), bodies, tuple(about), places)


def _shape(simulated: Any, geom: int, name: str) -> tuple[Shape, Mat, bool]:
    """The shape of a geom, its placement in its body, and whether it is exact."""
    size, kind = np.array(simulated.geom_size[geom]), mujoco.mjtGeom(int(simulated.geom_type[geom]))
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, simulated.geom_quat[geom])
    place = _matrix(simulated.geom_pos[geom], turn.reshape(3, 3))
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return shapes.sphere(name, size[0]), place, True
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return shapes.capsule(name, size[0], 2.0 * size[1]), place, True
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return shapes.box(name, 2.0 * size), place, True
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        radius, half = float(size[0]), float(size[1])
        if np.pi * (2.0 * half + 4.0 / 3.0 * radius) < 8.0 * half:  # volumes over the squared radius
            return shapes.capsule(name, radius, 2.0 * half), place, False
        return shapes.box(name, (2.0 * radius, 2.0 * radius, 2.0 * half)), place, False
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return shapes.box(name, 2.0 * size), place, False
    centre, half = simulated.geom_aabb[geom].reshape(2, 3)
    return shapes.box(name, np.maximum(2.0 * half, 1e-6)), place @ _matrix(centre, np.eye(3)), False


def _matrix(position: Any, rotation: Any) -> Mat:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation, position
    return found
