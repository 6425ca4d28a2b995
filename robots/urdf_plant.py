"""A URDF robot for the plant: MuJoCo's own URDF reader, with the collision shapes that Pinocchio reads."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pinocchio as pin

from hqp.arrays import Mat, right_vectors
from hqp.errors import ModelError, ModelWarning

from . import xml_lines
from .mujoco_extra import mujoco
from .physical import make_physical
from .soles import sole_points
from .surface import surface

_THIN = 1e-3  # [m]
_CORNER = 5e-3  # radius of a sole's corner [m]
_SOLID = ("Sphere", "Capsule", "Cylinder", "Box")
_SHOWN = (0.75, 0.76, 0.79, 1.0)


def read(robot: Any) -> Any:
    """A MjSpec of a robot from a URDF: bodies, joints, inertias by MuJoCo's reader; raises ModelError.

    Meshes are taken as their convex hulls.  If MuJoCo refuses inertias, those that no rigid body has are changed, see
    ``make_physical``; warns (ModelWarning) of the links.
    """
    root = xml_lines.read(robot.source)
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for shape in link.findall(kind):
                link.remove(shape)
    for old in root.findall("mujoco"):
        root.remove(old)
    compiler = ET.SubElement(ET.SubElement(root, "mujoco"), "compiler")
    compiler.attrib.update(fusestatic="false", inertiafromgeom="false", autolimits="true")
    try:
        return _spec(root, robot)
    except ModelError as error:
        changed = make_physical(root) if "inertia" in str(error) else []
        if not changed:
            raise
    some = ", ".join(changed[:4]) + (f" and {len(changed) - 4} more" if len(changed) > 4 else "")
    message = f"{robot.name}: the plant corrects inertias of the file that no rigid body has: {some}"
    warnings.warn(message, ModelWarning, stacklevel=4)
    return _spec(root, robot)


def _spec(root: ET.Element, robot: Any) -> Any:
    """MjSpec of a URDF without shapes; raises ModelError."""
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    except ValueError as error:
        raise ModelError(f"{robot.source}: MuJoCo cannot read it: {error}") from error
    if robot.floating and robot.model.names[1] not in [joint.name for joint in spec.joints]:
        if root.find("link[@name='world']") is not None:
            remedy = "remove it and the joint that fixes the robot to it"
            raise ModelError(f"{robot.source}: MuJoCo takes its link 'world' for the ground, not for a base; {remedy}")
        free = spec.worldbody.first_body().add_freejoint()
        free.name = robot.model.names[1]
    free_frames(spec, robot)
    _shapes(spec, robot)
    _sole_corners(spec, robot)
    try:
        spec.compile()
    except ValueError as error:
        raise ModelError(f"{robot.source}: MuJoCo cannot compile it: {error}") from error
    return spec


def free_frames(spec: Any, robot: Any) -> None:
    """Frames that only the robot has (soles of the catalogue, ``with_frame``) become sites."""
    bodies = {body.name for body in spec.bodies}
    known = bodies | {site.name for site in spec.sites}
    for frame in robot.model.frames:
        host = _host(robot, frame)
        own = known.isdisjoint((frame.name, frame.name.removesuffix("_site")))
        if frame.type == pin.FrameType.OP_FRAME and host in bodies and own:
            local = _placement_in(robot, host, frame.placement)
            wxyz = pin.Quaternion(local.rotation)
            spec.body(host).add_site(name=frame.name, pos=local.translation, quat=[wxyz.w, wxyz.x, wxyz.y, wxyz.z])


def _host(robot: Any, frame: Any) -> str:
    """The first body of the joint that carries a frame."""
    for other in robot.model.frames:
        if other.type == pin.FrameType.BODY and other.parentJoint == frame.parentJoint:
            return str(other.name)
    return ""


def _placement_in(robot: Any, body: str, placement: Any) -> Any:
    """A placement in a joint, seen from a body of that joint."""
    index = robot.model.getFrameId(body, pin.FrameType.BODY)
    return robot.model.frames[index].placement.inverse() * placement


def _shapes(spec: Any, robot: Any) -> None:
    bodies = {body.name: body for body in spec.bodies}
    for item in robot.geometry.geometryObjects:
        name = robot.model.frames[item.parentFrame].name
        body = bodies.get(name)
        if body is None:
            raise ModelError(f"{robot.name}: MuJoCo has no body {name!r} for the shape {item.name!r}")
        if _vanishes(item.geometry):
            continue
        local = _placement_in(robot, name, item.placement)
        wxyz = pin.Quaternion(local.rotation)
        geom = body.add_geom(name=item.name, pos=local.translation, rgba=_SHOWN, mass=0.0)
        geom.quat = [wxyz.w, wxyz.x, wxyz.y, wxyz.z]
        _fill(spec, geom, item)


def _sole_corners(spec: Any, robot: Any) -> None:
    """Small spheres in the corners of soles that are meshes, of which MuJoCo finds three points on a plane."""
    for frame in robot.landmarks.get("soles", ()):
        joint = robot.model.frames[robot.frame(frame)].parentJoint
        kinds = [type(g.geometry).__name__ for g in robot.geometry.geometryObjects if g.parentJoint == joint]
        if all(kind in _SOLID for kind in kinds):
            continue
        host = _host(robot, robot.model.frames[robot.frame(frame)])
        for k, (x, y, z) in enumerate(sole_points(robot, frame)):
            own = robot.model.frames[robot.frame(frame)].placement * pin.SE3(np.eye(3), np.array([x, y, z + _CORNER]))
            place = _placement_in(robot, host, own).translation
            ball = spec.body(host).add_geom(name=f"{frame}_{k}", pos=place, rgba=_SHOWN, mass=0.0)
            ball.type, ball.size = mujoco.mjtGeom.mjGEOM_SPHERE, [_CORNER, 0.0, 0.0]


def _vanishes(shape: Any) -> bool:
    """Return true if a shape has no size, which MuJoCo refuses."""
    if hasattr(shape, "radius"):
        return not shape.radius > 0.0
    return hasattr(shape, "halfSide") and not np.all(np.asarray(shape.halfSide) > 0.0)


def _fill(spec: Any, geom: Any, item: Any) -> None:
    shape, kinds = item.geometry, mujoco.mjtGeom
    kind = type(shape).__name__
    if kind == "Sphere":
        geom.type, geom.size = kinds.mjGEOM_SPHERE, [shape.radius, 0.0, 0.0]
    elif kind in ("Capsule", "Cylinder"):
        geom.type = kinds.mjGEOM_CAPSULE if kind == "Capsule" else kinds.mjGEOM_CYLINDER
        geom.size = [shape.radius, shape.halfLength, 0.0]
    elif kind == "Box":
        geom.type, geom.size = kinds.mjGEOM_BOX, list(shape.halfSide)
    else:
        vertices, faces = hull(surface(item).placed(item.placement.inverse()).points())
        spec.add_mesh(name=item.name, uservert=vertices.ravel().tolist(), userface=faces.ravel().tolist())
        geom.type, geom.meshname = kinds.mjGEOM_MESH, item.name


def hull(cloud: Mat) -> tuple[Mat, Any]:
    """Corners ``(n, 3)`` and triangles ``(m, 3)``, turned outwards, of the convex hull of points.

    Points in a plane or on a line are made _THIN thick.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(cloud)
    except QhullError:
        axes = right_vectors(cloud - cloud.mean(axis=0))[1] * _THIN
        thin = axes[np.ptp((cloud - cloud.mean(axis=0)) @ axes.T, axis=0) < 1e-2 * _THIN**2]
        for axis in thin if len(thin) else axes[2:]:
            cloud = np.vstack((cloud - 0.5 * axis, cloud + 0.5 * axis))
        found = ConvexHull(cloud)
    place = np.full(len(cloud), -1)
    place[found.vertices] = np.arange(len(found.vertices))
    corners, faces = cloud[found.vertices], place[found.simplices]
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return corners, faces
