"""Read URDF files as Pinocchio models, with checks that the reader lacks: limits, inertias, axes, mimic joints."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError, ModelError

from . import urdf_shapes, urdf_structure, xml_lines
from .description import Description, require_room

_KINDS = ("revolute", "prismatic", "continuous", "fixed", "floating", "planar")
_COORDINATES = {"fixed": 0, "planar": 3, "floating": 6}  # joints without exactly one coordinate
MOST_LINKS = 5000
"""Pinocchio's reader goes down a chain of links by calls of itself; 20 000 end the process."""
_AXIAL = ("revolute", "prismatic", "continuous", "planar")
_UNUSED = {
    "continuous": "lower, upper of the file are ignored, they turn without end",
    "planar": "lower, upper of the file are ignored, they name no coordinate",
    "floating": "limits of the file are ignored, they name no coordinate",
}
"""Notes on limits of a kind of joint."""
_SLACK = 1e-6  # tolerance of the triangle inequality, relative to the largest moment: decimals in files


def read(path: Path, floating: bool | None) -> Description:
    """The file's model, couplings and notes; raises ModelError that names the link or joint.

    floating: true to free the root, None to follow the file: fixed but for a floating joint at the root. Raises
    DeclarationError where the file frees the root that floating=False would fix.

    Refused: numbers that are not finite, negative masses, inertias of links that make that of the joints negative, axes
    of no length, lower limits above upper ones, more links or coordinates than there is room for.  Warned of: other
    negative moments of inertia, those against the triangle inequality, joints that move no mass, limits that are zero
    or missing, equal lower and upper limits, mimic joints that follow an unknown one.
    """
    root = xml_lines.read(path)
    links = len(root.findall("link"))
    if links > MOST_LINKS:
        raise ModelError(f"{path}: {links} links, allowed {MOST_LINKS}: the reader is recursive")
    urdf_structure.refuse_macros(path, root)
    urdf_structure.refuse_spellings(path, root)
    freed = _free_root(root)
    if freed and floating is False:
        raise DeclarationError(
            "floating", f"joint {freed!r} of {path} already frees the root", value=False, allowed="None, True"
        )
    floating = floating is True and not freed
    warnings = [*urdf_structure.incomplete_inertias(path, root), *urdf_structure.repeated(path, root)]
    negative = [name for link in root.findall("link") if (name := _check_link(path, link, warnings))]
    _check_joints(path, root, warnings)
    require_room(path, sum(_COORDINATES.get(str(joint.get("type")), 1) for joint in root.findall("joint")))
    urdf_structure.check(path, root)
    warnings += urdf_shapes.check(path, root)
    try:
        model = pin.buildModelFromUrdf(str(path), *((pin.JointModelFreeFlyer(),) if floating else ()))
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{path} could not be read: {error}") from error
    if model.nv == (6 if floating else 0) and not floating:
        raise ModelError(f"{path}: no moving joint, needed at least one; floating=True frees its root")
    M = _inertia(model)
    if negative and _indefinite(M):
        raise ModelError(f"{path}: {negative[0]} makes the joint-space inertia negative")
    idle = [repr(name) for name, at in zip(model.names[1:], model.idx_vs[1:], strict=True) if not M[at, at] > 0.0]
    if idle:
        joints = ", ".join(idle[:3]) + (f" and {len(idle) - 3} more" if len(idle) > 3 else "")
        warnings.append(f"no mass moves with {joints}: torque level needs one")
    found = Description(model=model, source=path, warnings=warnings)
    _read_planes(path, root, found)
    _read_mimics(path, root, found)
    return found


def _free_root(root: ET.Element) -> str:
    """Name of the one joint of the root link where it is floating, empty otherwise."""
    joints = {str(j.get("name")): [_link(j, end) for end in ("parent", "child")] for j in root.findall("joint")}
    children = {child for _, child in joints.values()}
    first = [name for name, (parent, _) in joints.items() if parent not in children]
    kinds = [j.get("type") for j in root.findall("joint") if j.get("name") in first]
    return first[0] if kinds == ["floating"] else ""


def _link(joint: ET.Element, end: str) -> str:
    found = joint.find(end)
    return "" if found is None else str(found.get("link"))


def _inertia(model: Any) -> Mat:
    """The joint-space inertia where all joints are at zero, ``(nv, nv)``."""
    data = pin.Data(model)
    pin.crba(model, data, pin.neutral(model))
    return np.asarray(np.triu(data.M) + np.triu(data.M, 1).T)


def _indefinite(M: Mat) -> bool:
    moments = np.linalg.eigvalsh(M)
    return bool(moments[0] < -1e-9 * abs(moments[-1]))


def _check_link(path: Path, link: ET.Element, warnings: list[str]) -> str:
    """Return the fault if a principal moment is negative, else an empty text."""
    inertial, what = link.find("inertial"), f"link {link.get('name')!r}"
    if inertial is None:
        return ""
    xml_lines.numbers(path, what, inertial.find("origin"), "0 0 0", "xyz", "rpy")
    mass = xml_lines.numbers(path, what, inertial.find("mass"), "0", "value")[0]
    xx, yy, zz, xy, xz, yz = xml_lines.numbers(
        path, what, inertial.find("inertia"), "0", "ixx", "iyy", "izz", "ixy", "ixz", "iyz"
    )
    if mass < 0.0:
        raise ModelError(f"{xml_lines.place(path, link)}: {what} has a negative mass ({mass:g} kg)")
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    size = max(float(np.abs(moments).max()), 1e-9)
    if moments[0] < -_SLACK * size:
        warnings.append(f"{what} has a negative principal moment of inertia ({moments[0]:g} kg m^2)")
        return warnings[-1]
    if moments[2] > moments[0] + moments[1] + _SLACK * size:
        a, b, c = moments
        warnings.append(f"{what}: principal moments {a:.3g} + {b:.3g} < {c:.3g} kg m^2: no rigid body has this inertia")
    return ""


def _check_joints(path: Path, root: ET.Element, warnings: list[str]) -> None:
    silent: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        name, kind = str(joint.get("name")), joint.get("type")
        what, limit, at = f"joint {name!r}", joint.find("limit"), xml_lines.place(path, joint)
        if kind not in _KINDS:
            raise ModelError(f"{at}: {what} is of type {kind!r}; allowed: {', '.join(_KINDS)}")
        xml_lines.numbers(path, what, joint.find("origin"), "0 0 0", "xyz", "rpy")
        axis = xml_lines.numbers(path, what, joint.find("axis"), "1 0 0", "xyz")
        if kind in _AXIAL and (len(axis) != 3 or not any(axis)):
            raise ModelError(f"{at}: {what}: axis {axis} is a zero vector")
        lower, upper, speed, effort = xml_lines.numbers(
            path, what, limit, "0", "lower", "upper", "velocity", "effort", most=math.inf
        )
        xml_lines.numbers(path, what, joint.find("dynamics"), "0", "damping", "friction")
        xml_lines.numbers(path, what, joint.find("mimic"), "0", "multiplier", "offset")
        xml_lines.numbers(path, what, joint.find("calibration"), "0", "rising", "falling")
        bounds = ("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity")
        xml_lines.numbers(path, what, joint.find("safety_controller"), "0", *bounds)
        if speed < 0.0 or effort < 0.0:
            raise ModelError(
                f"{xml_lines.place(path, limit)}: {what} has a negative limit (velocity {speed:g}, effort {effort:g})"
            )
        if kind not in ("revolute", "prismatic", "continuous"):
            continue
        for word, value in (("velocity", speed), ("effort", effort)):
            if value == 0.0:
                silent.setdefault(word, []).append(name)
        if kind == "continuous":
            continue
        if lower > upper:
            raise ModelError(
                f"{xml_lines.place(path, limit)}: {what}: lower limit {lower:g} > upper limit {upper:g}: swapped?"
            )
        if lower == upper == 0.0:
            silent.setdefault("position", []).append(name)
        elif lower == upper:
            warnings.append(f"{what}: its lower and upper limits are both {lower:g}, so it cannot move")
    for word, joints in silent.items():
        warnings.append(f"{word} limit zero or missing, joint not limited: {', '.join(joints)}")


def _read_planes(path: Path, root: ET.Element, found: Description) -> None:
    """Normal and speed limit of planar joints, which Pinocchio's reader leaves out; notes on limits without a use."""
    model, unused = found.model, dict[str, list[str]]()
    for joint in root.findall("joint"):
        name, kind, limit = str(joint.get("name")), str(joint.get("type")), joint.find("limit")
        if kind not in _UNUSED or not model.existJointName(name):
            continue
        index, what = model.getJointId(name), f"joint {name!r}"
        bounds = xml_lines.numbers(path, what, limit, "0", "lower", "upper", most=math.inf)
        speed, effort = xml_lines.numbers(path, what, limit, "0", "velocity", "effort", most=math.inf)
        if kind == "planar":
            _turn(model, index, np.array(xml_lines.numbers(path, what, joint.find("axis"), "1 0 0", "xyz")))
            columns = slice(model.idx_vs[index], model.idx_vs[index] + model.nvs[index])
            for limits, value in ((model.velocityLimit, speed), (model.effortLimit, effort)):
                if value > 0.0:
                    limits[columns] = value
        if any(bounds) or (kind == "floating" and (speed or effort)):
            unused.setdefault(kind, []).append(name)
    for kind, names in unused.items():
        found.notes.append(f"{kind} joints: {_UNUSED[kind]}: {', '.join(names)}")


def _turn(model: Any, index: int, normal: Vec) -> None:
    """Move a planar joint across ``normal`` instead of z of its frame; all that it carries stays where it is at zero.

    Its x and y are those of the shortest turn from z to the normal, as in MuJoCo's reader.
    """
    turn = pin.SE3(pin.Quaternion.FromTwoVectors(np.array((0.0, 0.0, 1.0)), normal).matrix(), np.zeros(3))
    back = turn.inverse()
    model.jointPlacements[index] = model.jointPlacements[index] * turn
    model.inertias[index] = back.act(model.inertias[index])
    for child in range(index + 1, model.njoints):
        if model.parents[child] == index:
            model.jointPlacements[child] = back * model.jointPlacements[child]
    for frame in model.frames:
        if frame.parentJoint == index:
            frame.placement = back * frame.placement


def _read_mimics(path: Path, root: ET.Element, found: Description) -> None:
    followers, leaders = [], dict[str, str]()
    for joint in root.findall("joint"):
        mimic, name = joint.find("mimic"), str(joint.get("name"))
        if mimic is None or joint.get("type") == "fixed":
            continue
        leader, what = str(mimic.get("joint")), f"joint {name!r}, mimic"
        ends = [found.model.getJointId(end) if found.model.existJointName(end) else 0 for end in (name, leader)]
        if leader == name or any(found.model.nvs[end] != 1 for end in ends):
            found.warnings.append(
                f"joint {name!r} mimics {leader!r}, needed two joints of one axis that move: not coupled"
            )
            continue
        leaders[name] = leader
        factor = xml_lines.numbers(path, what, mimic, "1", "multiplier")[0]
        offset = xml_lines.numbers(path, what, mimic, "0", "offset")[0]
        found.couplings.append(({name: 1.0, **({leader: -factor} if factor else {})}, offset))
        followers.append(name)
    for name in followers:
        way = [name]
        while way[-1] in leaders:
            leader = leaders[way[-1]]
            if leader == name:
                joint = next(joint for title, joint in xml_lines.named(root, "joint") if title == name)
                at = xml_lines.place(path, joint.find("mimic"))
                raise ModelError(f"{at}: joint {name!r} mimics itself by {', '.join(way[1:])}; allowed: a leader")
            if leader in way:
                break
            way.append(leader)
    if followers:
        model = found.model
        single = [n for n, j in list(zip(model.names, model.joints, strict=True))[1:] if j.nv == 1]
        found.actuated = tuple(n for n in single if n not in followers)
