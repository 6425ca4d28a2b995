"""URDF files rewritten: joints renamed and reordered, mirrored, in other units, with frames turned.

Every function takes and returns the root element of a file without shapes.  Mechanics determine the new numbers, so
that the robot moves as before.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.random import Generator

from hqp.arrays import Mat, Vec

_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
MIRROR = np.diag([1.0, -1.0, 1.0])
"""Reflection in the plane y = 0."""


def plain(path: Path) -> ET.Element:
    """The file's root, without shapes, materials, transmissions and tags of simulators."""
    root = ET.parse(path).getroot()
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
    for link in root.findall("link"):
        for element in list(link):
            if element.tag != "inertial":
                link.remove(element)
    return root


def written(root: ET.Element, folder: Path, name: str) -> Path:
    path = folder / f"{name}.urdf"
    path.write_text(ET.tostring(root, encoding="unicode"))
    return path


def _text(values: object) -> str:
    return " ".join(repr(float(x)) for x in np.ravel(np.asarray(values)))


def _vector(element: ET.Element | None, name: str, default: str) -> Vec:
    return np.array((default if element is None else element.get(name, default)).split(), dtype=float)


def origin(element: ET.Element) -> pin.SE3:
    """Placement of a joint or an inertial in its parent."""
    at = element.find("origin")
    return pin.SE3(pin.rpy.rpyToMatrix(_vector(at, "rpy", "0 0 0")), _vector(at, "xyz", "0 0 0"))


def place(element: ET.Element, placement: pin.SE3) -> None:
    at = element.find("origin")
    at = ET.SubElement(element, "origin") if at is None else at
    at.set("xyz", _text(placement.translation))
    at.set("rpy", _text(pin.rpy.matrixToRpy(placement.rotation)))


def _inertia(inertial: ET.Element) -> Mat:
    xx, xy, xz, yy, yz, zz = (float(inertial.find("inertia").get(name, "0")) for name in _MOMENTS)  # type: ignore[union-attr]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _set_inertia(inertial: ET.Element, tensor: Mat) -> None:
    values = tensor[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    for name, value in zip(_MOMENTS, values, strict=True):
        inertial.find("inertia").set(name, repr(float(value)))  # type: ignore[union-attr]


def mirrored(root: ET.Element) -> ET.Element:
    """Everything reflected in y = 0; angles keep their signs, since axes turn as pseudo-vectors."""
    root = copy.deepcopy(root)

    def reflected(at: pin.SE3) -> pin.SE3:
        return pin.SE3(MIRROR @ at.rotation @ MIRROR, MIRROR @ at.translation)

    for inertial in root.findall("link/inertial"):
        turned = reflected(origin(inertial))
        _set_inertia(inertial, MIRROR @ _inertia(inertial) @ MIRROR)
        place(inertial, turned)
    for joint in root.findall("joint"):
        place(joint, reflected(origin(joint)))
        axis = joint.find("axis")
        sign = 1.0 if joint.get("type") == "prismatic" else -1.0
        value = sign * MIRROR @ _vector(axis, "xyz", "1 0 0")
        (ET.SubElement(joint, "axis") if axis is None else axis).set("xyz", _text(value))
    return root


def in_units(root: ET.Element, length: float, mass: float) -> ET.Element:
    """Lengths times ``length``, masses times ``mass``: torques and forces follow."""
    root = copy.deepcopy(root)
    for inertial in root.findall("link/inertial"):
        at = origin(inertial)
        place(inertial, pin.SE3(at.rotation, length * at.translation))
        inertial.find("mass").set("value", repr(mass * float(inertial.find("mass").get("value"))))  # type: ignore[union-attr, arg-type]
        _set_inertia(inertial, mass * length**2 * _inertia(inertial))
    for joint in root.findall("joint"):
        at = origin(joint)
        place(joint, pin.SE3(at.rotation, length * at.translation))
        limit, slides = joint.find("limit"), joint.get("type") == "prismatic"
        if limit is None:
            continue
        effort = mass * length * (1.0 if slides else length)
        for name, factor in (("effort", effort), *((n, length) for n in ("lower", "upper", "velocity") if slides)):
            if limit.get(name) is not None:
                limit.set(name, repr(factor * float(limit.get(name))))  # type: ignore[arg-type]
    return root


def renamed(root: ET.Element, rng: Generator) -> tuple[ET.Element, dict[str, str]]:
    """Joints and links under drawn names, in a drawn order in the file; the new names by the old ones."""
    root = copy.deepcopy(root)
    names = sorted({str(e.get("name")) for e in root})
    drawn = rng.permutation(len(names))
    new = {name: f"n{drawn[i]:04d}" for i, name in enumerate(names)}
    for element in root:
        element.set("name", new[str(element.get("name"))])
        for end in element.findall("parent") + element.findall("child"):
            end.set("link", new[str(end.get("link"))])
        for mimic in element.findall("mimic"):
            mimic.set("joint", new[str(mimic.get("joint"))])
    members = list(root)
    for element in members:
        root.remove(element)
    for i in rng.permutation(len(members)):
        root.append(members[i])
    return root, new


def with_link_turned(root: ET.Element, link: str, R: Mat) -> ET.Element:
    """The frame of a link without children turned by R in itself; its mass stays where it is."""
    root = copy.deepcopy(root)
    turn = pin.SE3(R, np.zeros(3))
    for joint in root.findall("joint"):
        if joint.find("child").get("link") == link:  # type: ignore[union-attr]
            place(joint, origin(joint) * turn)
            axis = joint.find("axis")
            if axis is not None:
                axis.set("xyz", _text(R.T @ _vector(axis, "xyz", "1 0 0")))
        elif joint.find("parent").get("link") == link:  # type: ignore[union-attr]
            place(joint, turn.inverse() * origin(joint))
    for element in root.findall("link"):
        if element.get("name") == link:
            for inertial in element.findall("inertial"):
                place(inertial, turn.inverse() * origin(inertial))
    return root


def without(root: ET.Element, limit: str) -> ET.Element:
    """No limits of that name, ``velocity`` for one: a zero counts as none."""
    root = copy.deepcopy(root)
    for found in root.findall("joint/limit"):
        found.set(limit, "0")
    return root


def as_mjcf(root: ET.Element, folder: Path, floating: bool) -> Path:
    """The MJCF that MuJoCo writes of the file, its root on a free joint if it floats."""
    mujoco = pytest.importorskip("mujoco")
    root = copy.deepcopy(root)
    wrapped = ET.SubElement(root, "mujoco")
    ET.SubElement(
        wrapped,
        "compiler",
        fusestatic="false",
        strippath="false",
        balanceinertia="false",
        boundmass="0",
        boundinertia="0",
    )
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    if floating:
        spec.worldbody.first_body().add_freejoint()
    spec.compile()
    path = folder / "model.xml"
    path.write_text(spec.to_xml())
    return path


def noisy(root: ET.Element, size: float, rng: Generator) -> ET.Element:
    """Every number of lengths, masses and inertias times (1 + size N(0, 1)); limits and axes as they are."""
    root = copy.deepcopy(root)
    for element in (*root.findall("link/inertial/*"), *root.findall("joint/origin")):
        for name, text in element.attrib.items():
            values = np.array(text.split(), dtype=float)
            element.set(name, _text(values * (1.0 + size * rng.normal(size=values.size))))
    return root
