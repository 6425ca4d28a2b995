"""Robots outside the catalogue: arms and bipeds with drawn lengths, masses, axes and limits, as URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.random import Generator

from hqp.arrays import Vec
from tests.invariance import urdf

if TYPE_CHECKING:
    from tests.invariance.described import Described


class Writer:
    """Writer of links and joints to a file, in order."""

    def __init__(self, rng: Generator, name: str) -> None:
        self.rng, self.root = rng, ET.Element("robot", name=name)
        self.posture: dict[str, float] = {}

    def link(self, name: str, mass: float, length: float) -> None:
        """A body about a rod of that length along -z or +z, a little off its axis."""
        link = ET.SubElement(self.root, "link", name=name)
        if mass == 0.0:
            return
        inertial = ET.SubElement(link, "inertial")
        urdf.place(inertial, pin.SE3(np.eye(3), np.array([*self.rng.uniform(-0.02, 0.02, 2), 0.5 * length])))
        ET.SubElement(inertial, "mass", value=repr(mass))
        about = mass * (length * length / 12.0 + 0.0016)
        ET.SubElement(
            inertial,
            "inertia",
            ixx=repr(about),
            iyy=repr(1.1 * about),
            izz=repr(0.002 * mass + 0.3 * about),
            ixy="0",
            ixz="0",
            iyz="0",
        )

    def joint(
        self, name: str, parent: str, child: str, at: Vec, axis: Vec, start: float = 0.0, effort: float = 150.0
    ) -> None:
        joint = ET.SubElement(self.root, "joint", name=name, type="revolute")
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        urdf.place(joint, pin.SE3(np.eye(3), np.asarray(at, dtype=float)))
        ET.SubElement(joint, "axis", xyz=" ".join(repr(float(x)) for x in axis))
        low, high = start - self.rng.uniform(0.6, 2.0), start + self.rng.uniform(0.6, 2.0)
        limits = {
            "lower": low,
            "upper": high,
            "velocity": self.rng.uniform(2.0, 6.0),
            "effort": effort * self.rng.uniform(0.8, 1.5),
        }
        ET.SubElement(joint, "limit", {key: repr(float(value)) for key, value in limits.items()})
        self.posture[name] = start

    def fixed(self, name: str, parent: str, at: Vec) -> None:
        self.link(name, 0.0, 0.0)
        joint = ET.SubElement(self.root, "joint", name=f"{name}_fixed", type="fixed")
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=name)
        urdf.place(joint, pin.SE3(np.eye(3), np.asarray(at, dtype=float)))

    def chain(
        self, prefix: str, parent: str, at: Vec, axes: str, lengths: Vec, masses: Vec, starts: Vec, effort: float
    ) -> str:
        """A limb along z: one joint per axis letter, link lengths from ``lengths`` (negative: down)."""
        place = np.asarray(at, dtype=float)
        for i, (letter, length, mass, start) in enumerate(zip(axes, lengths, masses, starts, strict=True)):
            name = f"{prefix}_{i}"
            self.link(name, float(mass), float(length))
            self.joint(f"{name}_joint", parent, name, place, np.eye(3)["xyz".index(letter)], float(start), effort)
            parent, place = name, np.array([0.0, 0.0, length])
        return parent


def arm(rng: Generator) -> Described:
    """An arm of six or seven joints on a fixed base."""
    from tests.invariance.described import Described

    axes = "zyzyzyz"[: int(rng.integers(6, 8))]
    made = Writer(rng, "arm")
    made.link("base", 5.0, 0.1)
    lengths = rng.uniform(0.1, 0.3, len(axes))
    starts = np.where([a == "y" for a in axes], rng.uniform(0.3, 0.8, len(axes)), rng.uniform(-0.3, 0.3, len(axes)))
    last = made.chain(
        "arm", "base", np.array([0.0, 0.0, 0.1]), axes, lengths, rng.uniform(0.5, 4.0, len(axes)), starts, 150.0
    )
    made.fixed("tool", last, np.array([0.0, 0.0, 0.1]))
    return Described("generated arm", made.root, False, "tool", (), made.posture)


def biped(rng: Generator) -> Described:
    """A free trunk on two legs of six joints, with one arm of five."""
    from tests.invariance.described import Described

    made = Writer(rng, "biped")
    made.link("trunk", float(rng.uniform(10.0, 30.0)), float(rng.uniform(0.3, 0.5)))
    thigh, shin, width, bend = *rng.uniform(0.25, 0.45, 2), float(rng.uniform(0.08, 0.12)), float(rng.uniform(0.3, 0.6))
    hip = np.arcsin(
        np.clip(shin * np.sin(bend) / np.hypot(thigh + shin * np.cos(bend), shin * np.sin(bend)), -1.0, 1.0)
    )
    masses = rng.uniform(0.5, 4.0, 6)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        starts = np.array([0.0, 0.0, -hip, bend, hip - bend, 0.0])
        lengths = np.array([0.0, 0.0, -thigh, -shin, 0.0, -0.06])
        last = made.chain(side, "trunk", np.array([0.0, sign * width, 0.0]), "zxyyyx", lengths, masses, starts, 250.0)
        made.fixed(f"{side}_sole", last, np.array([0.03, 0.0, -0.06]))
    starts = np.array([0.2, 0.1, 0.1, -0.8, 0.1])
    last = made.chain(
        "arm",
        "trunk",
        np.array([0.0, 0.2, 0.35]),
        "yxzyz",
        np.array([0.0, 0.0, -0.28, 0.0, -0.25]),
        rng.uniform(0.4, 2.0, 5),
        starts,
        60.0,
    )
    made.fixed("hand", last, np.array([0.0, 0.0, -0.08]))
    height = thigh * np.cos(hip) + shin * np.cos(bend - hip) + 0.06
    return Described(
        "generated biped", made.root, True, "hand", ("left_sole", "right_sole"), made.posture, float(height)
    )
