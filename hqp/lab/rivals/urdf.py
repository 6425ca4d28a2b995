"""A robot as URDF text with no shapes, so that every library reads the same mechanism."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from hqp.arrays import Vec
from hqp.errors import ModelError


def urdf(robot: Any, frames: Iterable[str]) -> str:
    """The joints and inertias of a robot, and the frames named; the base of a floating robot is the root link.

    Raises ModelError for joints that URDF has not: joints with several axes, below the base.
    """
    model = robot.model
    root = ElementTree.Element("robot", name="robot")
    links = {j: f"link_{j}" for j in range(model.njoints)}
    first = 1 if robot.floating else 0
    for j in range(first, model.njoints):
        _link(root, links[j], model.inertias[j])
    for j in range(first + 1, model.njoints):
        _joint(root, robot, j, links)
    for name in dict.fromkeys(frames):
        frame = model.frames[model.getFrameId(name)]
        _link(root, name, None)
        fixed = ElementTree.SubElement(root, "joint", name=f"fix_{name}", type="fixed")
        _attach(fixed, links[frame.parentJoint], name, frame.placement)
    return ElementTree.tostring(root, encoding="unicode")


def _link(root: ElementTree.Element, name: str, inertia: Any) -> None:
    link = ElementTree.SubElement(root, "link", name=name)
    if inertia is None or inertia.mass <= 0.0:
        return
    body = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(body, "origin", xyz=_text(inertia.lever), rpy="0 0 0")
    ElementTree.SubElement(body, "mass", value=repr(float(inertia.mass)))
    moments = {a + b: repr(float(inertia.inertia["xyz".index(a[-1]), "xyz".index(b)]))
               for a, b in (("ix", "x"), ("ix", "y"), ("ix", "z"), ("iy", "y"), ("iy", "z"), ("iz", "z"))}  # fmt: skip
    ElementTree.SubElement(body, "inertia", moments)


def _joint(root: ElementTree.Element, robot: Any, j: int, links: dict[int, str]) -> None:
    model = robot.model
    joint, name = model.joints[j], model.names[j]
    if joint.nv != 1:
        raise ModelError(f"{robot.name}: joint {name!r} has {joint.nv} axes: rivals are given joints of one")
    column = joint.idx_v
    data = joint.createData()
    joint.calc(data, pin.neutral(model), np.ones(model.nv))
    motion = np.asarray(data.S).ravel()
    prismatic = not motion[3:].any()
    axis = motion[:3] if prismatic else motion[3:]
    lower, upper = float(robot.lower[column]), float(robot.upper[column])
    bounded = np.isfinite(lower) and np.isfinite(upper)
    kind = "prismatic" if prismatic else "revolute"
    element = ElementTree.SubElement(root, "joint", name=name, type=kind)
    _attach(element, links[model.parents[j]], links[j], model.jointPlacements[j])
    ElementTree.SubElement(element, "axis", xyz=_text(axis))
    speed = float(robot.velocity_limit[column])
    ElementTree.SubElement(
        element, "limit",
        lower=repr(lower if bounded else -1e3), upper=repr(upper if bounded else 1e3),
        velocity=repr(speed if np.isfinite(speed) else 1e3), effort="1e4",
    )  # fmt: skip


def _attach(element: ElementTree.Element, parent: str, child: str, placement: Any) -> None:
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    ElementTree.SubElement(element, "origin", xyz=_text(placement.translation), rpy=_text(rpy))
    ElementTree.SubElement(element, "parent", link=parent)
    ElementTree.SubElement(element, "child", link=child)


def _text(numbers: Vec) -> str:
    return " ".join(repr(float(x)) for x in numbers)
