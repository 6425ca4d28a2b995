"""Inertias that a body can have, for a plant: MuJoCo refuses any other."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from hqp.arrays import Mat, Vec

LIGHT = 1e-4
"""Mass that a link without one is given where it moves [kg]."""
SMALL = 1e-7
"""Least principal moment of such a link [kg m^2]; for other links a share of their largest one."""
SHARE = 1e-4
"""Least principal moment of a link, as a share of its largest one."""
_KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def make_physical(root: ET.Element) -> list[str]:
    """Change the inertias of a URDF's links that no body has, by as little as makes them possible; names of the links.

    Principal moments A <= B <= C become positive, and where A + B < C the rest is shared out among the three.
    A link without mass that a joint moves is given 0.1 g.
    """
    joints = [joint for joint in root.findall("joint") if joint.get("type") != "fixed"]
    moved = {str(child.get("link")) for joint in joints for child in joint.findall("child")}
    changed = []
    for link in root.findall("link"):
        if _mend(link, str(link.get("name")) in moved):
            changed.append(str(link.get("name")))
    return changed


def _mend(link: ET.Element, moves: bool) -> bool:
    inertial = link.find("inertial")
    mass = 0.0 if inertial is None else float(_part(inertial, "mass").get("value", 0.0))
    if inertial is None and not moves:
        return False
    inertial = ET.SubElement(link, "inertial") if inertial is None else inertial
    tensor = _part(inertial, "inertia")
    xx, xy, xz, yy, yz, zz = (float(tensor.get(key, 0.0)) for key in _KEYS)
    if mass <= 0.0 and not moves and not any((xx, xy, xz, yy, yz, zz)):
        link.remove(inertial)
        return False
    given: Mat = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments, axes = np.linalg.eigh(given)
    wanted = _possible(moments)
    if mass > 0.0 and np.array_equal(wanted, moments):
        return False
    if mass <= 0.0:
        _part(inertial, "mass").set("value", repr(LIGHT))
    found = axes * wanted @ axes.T
    for key, value in zip(_KEYS, found[np.triu_indices(3)].tolist(), strict=True):
        tensor.set(key, repr(value))
    return True


def _possible(moments: Vec) -> Vec:
    """The nearest principal moments, ascending as they are given, that a body may have."""
    least = max(SMALL, SHARE * float(moments[2])) if moments[0] <= 1e-14 else float(moments[0])
    found = np.maximum(moments, least)
    missing = float(found[2] - found[0] - found[1])
    if missing > 0.0:
        found = found + missing * (1.0 + 1e-9) * np.array([1.0, 1.0, -1.0]) / 3.0
    return found


def _part(parent: ET.Element, tag: str) -> ET.Element:
    found = parent.find(tag)
    return ET.SubElement(parent, tag) if found is None else found
