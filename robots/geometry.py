"""The shapes of a robot: collision and visual geometry of its file, as pinocchio.GeometryModel."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal
from weakref import WeakValueDictionary

import numpy as np
import pinocchio as pin

from hqp.errors import ModelError

from .description import Description
from .surface import surface
from .touching import touching

Kind = Literal["collision", "visual"]

_LOADERS: WeakValueDictionary[Path, Any] = WeakValueDictionary()
"""Meshes by the robot's file, as long as somebody has shapes of it: robots of one file share them."""


def read(found: Description, model: Any, kind: Kind) -> Any:
    """The shapes of a file, placed in the joints of ``model``; raises ModelError where a mesh is missing."""
    if found.simulated is not None:
        return _from_mujoco(found, kind)
    what = pin.GeometryType.COLLISION if kind == "collision" else pin.GeometryType.VISUAL
    path = found.source
    assert path is not None  # a URDF has one
    loader = _loader(path)
    try:
        shapes = pin.buildGeomFromUrdf(model, str(path), what, None, folders(path), loader)
        shapes.loader = loader
        return shapes
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).rpartition("message:")[2].split())  # after the source file of coal
        raise ModelError(f"{path}: a {kind} shape could not be read: {reason}") from error


def _loader(path: Path) -> Any:
    found = _LOADERS.get(path)
    if found is None:
        from hqp.collision_library import coal

        found = _LOADERS[path] = coal.CachedMeshLoader()
    return found


def folders(path: Path) -> list[str]:
    """Search path of ``package://``: the folders above the file, then the paths of ROS."""
    above = [str(parent) for parent in path.resolve().parents if parent != parent.parent]
    ros = os.environ.get("ROS_PACKAGE_PATH", "").split(":")
    ament = [f"{prefix}/share" for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if prefix]
    return [*above, *filter(None, ros), *ament]


def _from_mujoco(found: Description, kind: Kind) -> Any:
    """Geoms that can touch others for collision, those of the groups shown by default for visual."""
    simulated, model = found.simulated, pin.GeometryModel()
    shown = np.asarray(simulated.geom_group) <= 2
    for g in np.flatnonzero(touching(simulated) if kind == "collision" else shown):
        body = int(simulated.geom_bodyid[g])
        shape = _shape(simulated, int(g)) if body not in found.scene else None
        if shape is None:
            continue
        joint, placement = found.carriers[body]
        local = pin.SE3(pin.Quaternion(*np.array(simulated.geom_quat[g])).matrix(), np.array(simulated.geom_pos[g]))
        name = simulated.geom(g).name or f"{simulated.body(body).name or body}_{g - simulated.body_geomadr[body]}"
        while model.existGeometryName(name):
            name += "_"
        item = pin.GeometryObject(name=name, parent_joint=joint, placement=placement * local, collision_geometry=shape)
        item.meshColor = np.array(simulated.geom_rgba[g], dtype=np.float64)
        model.addGeometryObject(item)
    return model


def _shape(simulated: Any, geom: int) -> Any:
    """The coal shape of a geom; None for height fields and signed distance functions."""
    from hqp.collision_library import coal, triangles

    from .mujoco_extra import mujoco

    size = np.array(simulated.geom_size[geom])
    kind = mujoco.mjtGeom(int(simulated.geom_type[geom])).name.removeprefix("mjGEOM_")
    if kind == "SPHERE":
        return coal.Sphere(size[0])
    if kind == "CAPSULE":
        return coal.Capsule(size[0], 2.0 * size[1])
    if kind == "CYLINDER":
        return coal.Cylinder(size[0], 2.0 * size[1])
    if kind == "ELLIPSOID":
        return coal.Ellipsoid(*size)
    if kind == "BOX":
        return coal.Box(*(2.0 * size))
    if kind == "PLANE":
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    if kind == "MESH":
        mesh = int(simulated.geom_dataid[geom])
        first, count = int(simulated.mesh_vertadr[mesh]), int(simulated.mesh_vertnum[mesh])
        start, faces = int(simulated.mesh_faceadr[mesh]), int(simulated.mesh_facenum[mesh])
        return triangles(simulated.mesh_vert[first : first + count], simulated.mesh_face[start : start + faces])
    return None


def lowest(model: Any, data: Any, geometry: Any, joint: int) -> float:
    """Height of the lowest point of a joint's own shapes [m], inf without shapes."""
    height = np.inf
    for item in geometry.geometryObjects:
        if item.parentJoint == joint:
            height = min(height, float(surface(item).placed(data.oMi[joint]).lowest()[:, 2].min()))
    return height
