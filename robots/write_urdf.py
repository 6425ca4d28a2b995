"""A robot's tables as URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

import numpy as np

from .tables import Array, Row, Tables, axis, document, shapes, text, vector


def urdf(tables: Tables) -> str:
    """The robot as URDF: every moving joint revolute (wheels within +-1e9 rad), points as massless links."""
    robot = ET.Element("robot", name=tables.description["name"])
    for link in tables.links:
        _link(robot, link, tables)
    for joint in tables.joints:
        _joint(robot, joint)
    for link in tables.links:
        for point in tables.frames(link["name"]):
            ET.SubElement(robot, "link", name=point["name"])
            fixed = ET.SubElement(robot, "joint", name=f"{point['name']}_fixed", type="fixed")
            _attach(fixed, link["name"], point["name"], point)
    return document(robot)


def _link(robot: ET.Element, link: Row, tables: Tables) -> None:
    element = ET.SubElement(robot, "link", name=link["name"])
    body = ET.SubElement(element, "inertial")
    ET.SubElement(body, "origin", xyz=text(vector(link, "cx", "cy", "cz")), rpy="0 0 0")
    ET.SubElement(body, "mass", value=text(float(link["mass"])))
    moments = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    ET.SubElement(body, "inertia", {name: text(float(link[name])) for name in moments})
    for tag in ("visual", "collision"):
        for kind, sizes in shapes(link):
            _shape(element, tag, link, tables, kind, sizes)


def _joint(robot: ET.Element, joint: Row) -> None:
    # a continuous joint has two numbers in Pinocchio's q; a revolute one with wide limits has one
    kind = "fixed" if joint["type"] == "fixed" else "revolute"
    element = ET.SubElement(robot, "joint", name=joint["name"], type=kind)
    _attach(element, joint["parent"], joint["child"], joint)
    if kind == "revolute":
        ET.SubElement(element, "axis", xyz=text(axis(joint)))
        limits = ("lower", "upper", "velocity", "effort")
        ET.SubElement(element, "limit", {name: text(float(joint[name])) for name in limits})
        ET.SubElement(element, "dynamics", damping=text(float(joint["damping"])), friction="0")


def _attach(element: ET.Element, parent: str, child: str, at: Row) -> None:
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    ET.SubElement(element, "origin", xyz=text(vector(at, "x", "y", "z")), rpy="0 0 0")


def _shape(element: ET.Element, tag: str, link: Row, tables: Tables, kind: str, s: Mapping[str, Array]) -> None:
    def add(name: str, origin: Array, along: Array, **size: str) -> None:
        place = ET.SubElement(element, tag)
        ET.SubElement(place, "origin", xyz=text(origin), rpy=text(_rpy(along)))
        ET.SubElement(ET.SubElement(place, "geometry"), name, size)

    up = np.array([0.0, 0.0, 1.0])
    if kind == "box":
        add("box", s["c"], up, size=text(2 * s["h"]))
    elif kind == "cyl":
        add("cylinder", s["c"], up, radius=text(s["r"]), length=text(2 * s["h"]))
    elif kind == "sphere":
        add("sphere", s["c"], up, radius=text(s["r"]))
    elif kind == "ellipsoid":  # URDF has none: the sphere of equal volume; the last digit is the machine's
        add("sphere", s["c"], up, radius=text(round(float(np.cbrt(np.prod(s["h"]))), 12)))
    elif kind == "capsule":  # URDF has none: a cylinder and two spheres
        along = s["to"] - s["from"]
        length = float(np.linalg.norm(along))
        add("cylinder", (s["from"] + s["to"]) / 2, along / length, radius=text(s["r"]), length=text(length))
        for end in (s["from"], s["to"]):
            add("sphere", end, up, radius=text(s["r"]))
    elif kind == "wheel":
        axle = axis(next(joint for joint in tables.joints if joint["child"] == link["name"]))
        add("cylinder", np.zeros(3), axle, radius=text(s["R"]), length=text(s["w"]))
    else:
        raise ValueError(f"link {link['name']!r}: unknown shape {kind!r}")


def _rpy(along: Array) -> Array:
    """Roll, pitch, yaw that turn z onto the unit vector ``along`` (URDF cylinders lie along z)."""
    return np.array([0.0, np.arctan2(np.hypot(along[0], along[1]), along[2]), np.arctan2(along[1], along[0])])
