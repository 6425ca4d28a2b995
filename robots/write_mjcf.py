"""A robot's tables as MJCF: the twin of the URDF, and plants whose omnidirectional wheels really roll.

No armature is written: the models hold the tables' numbers alone, a simulated plant adds its own.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Literal

import numpy as np

from . import rollers
from .tables import Array, Row, Tables, axis, document, inertia, shapes, text, vector

Wheels = Literal["hinge", "ball", "rollers"]

BALL_DAMPING_RATIO = 0.5  # a ball turns about two axes at once: the hinge's damping would act twice
JOINT_COLOUR = "0.42 0.45 0.5 1"
FOOT_SPHERE = 0.005  # radius of the contact spheres at a sole's corners [m]


def mjcf(tables: Tables, wheels: Wheels = "hinge") -> str:
    """The robot as MJCF with a torque motor per actuated joint, in table order.

    ``hinge`` equals the URDF degree of freedom by degree of freedom. A wheel on a hinge alone cannot roll
    sideways: with ``ball`` a sphere turns freely and a motor drives it about the axle, with ``rollers`` the
    hub carries passive rollers.
    """
    name = tables.description["name"]
    model = ET.Element("mujoco", model=name)
    ET.SubElement(model, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    solver = {"timestep": "0.001", "integrator": "implicitfast", "cone": "elliptic", "impratio": "10"}
    ET.SubElement(model, "option", solver)
    _defaults(model)
    _body(ET.SubElement(model, "worldbody"), tables.description["root"], None, tables, wheels)
    _couplings(model, tables)
    _motors(model, tables, wheels)
    keys = ET.SubElement(model, "keyframe")
    ET.SubElement(keys, "key", name="default", qpos=text(_qpos(tables, wheels)))
    return document(model)


def _defaults(model: ET.Element) -> None:
    defaults = ET.SubElement(model, "default")
    drawn = ET.SubElement(defaults, "default", {"class": "shape"})
    ET.SubElement(drawn, "geom", contype="0", conaffinity="0", group="1", rgba="0.75 0.77 0.8 1")
    touching = ET.SubElement(defaults, "default", {"class": "contact"})
    # conaffinity without contype: it meets the ground (contype 1), never the robot itself
    law = {"contype": "0", "conaffinity": "1", "condim": "3", "friction": "0.8", "solref": "0.006 1"}
    ET.SubElement(touching, "geom", law, group="3", rgba="0.25 0.27 0.3 1")


def _body(parent: ET.Element, name: str, joint: Row | None, tables: Tables, wheels: Wheels) -> None:
    link = tables.link(name)
    body = ET.SubElement(parent, "body", name=name)
    inertial = ET.SubElement(body, "inertial", pos=text(vector(link, "cx", "cy", "cz")))
    mass, tensor = float(link["mass"]), inertia(link)
    if joint is None:
        ET.SubElement(body, "freejoint", name="root_joint")
    else:
        body.set("pos", text(vector(joint, "x", "y", "z")))
        if is_wheel(joint):
            _wheel_joint(parent, body, joint, wheels)
            if wheels == "rollers":  # the table's wheel contains them
                rollers.add_rollers(body, name, axis(joint))
                mass -= rollers.NUMBER * rollers.MASS
                tensor = tensor - rollers.inertia_about_hub(axis(joint))
        elif joint["type"] != "fixed":
            limits = text(vector(joint, "lower", "upper"))
            hinge = ET.SubElement(body, "joint", name=joint["name"], axis=text(axis(joint)), range=limits)
            hinge.set("damping", text(float(joint["damping"])))
    inertial.set("mass", text(mass))
    six = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    inertial.set("fullinertia", text(tensor[index] for index in six))
    for kind, sizes in shapes(link):
        _shape(body, link, joint, wheels, kind, sizes)
    for point in tables.frames(name):
        ET.SubElement(body, "site", name=point["name"], pos=text(vector(point, "x", "y", "z")), group="4")
    for corner in (p for p in tables.points if p["frame"] == name and p["set"] == "rect4"):
        centre = vector(corner, "x", "y", "z") + np.array([0.0, 0.0, FOOT_SPHERE])
        ball = {"class": "contact", "name": corner["name"], "type": "sphere", "pos": text(centre)}
        ET.SubElement(body, "geom", ball, size=text(FOOT_SPHERE))
    for child in tables.children(name):
        _body(body, child["child"], child, tables, wheels)


def is_wheel(joint: Row) -> bool:
    """Return true for a continuous joint."""
    return joint["type"] == "continuous"


def _wheel_joint(base: ET.Element, wheel: ET.Element, joint: Row, wheels: Wheels) -> None:
    name, damping = joint["name"], float(joint["damping"])
    if wheels == "ball":
        ET.SubElement(wheel, "joint", name=name, type="ball", damping=text(BALL_DAMPING_RATIO * damping))
        ET.SubElement(wheel, "site", name=f"{name}_hub", group="4")
        ET.SubElement(base, "site", name=f"{name}_axle", pos=wheel.attrib["pos"], group="4")
    else:
        ET.SubElement(wheel, "joint", name=name, axis=text(axis(joint)), damping=text(damping))


def _shape(body: ET.Element, link: Row, joint: Row | None, wheels: Wheels, kind: str, s: Mapping[str, Array]) -> None:
    geom = ET.SubElement(body, "geom", {"class": "shape", "type": {"cyl": "cylinder"}.get(kind, kind)})
    if kind == "sphere":
        geom.set("rgba", JOINT_COLOUR)
    if kind == "capsule":
        geom.attrib |= {"fromto": text([*s["from"], *s["to"]]), "size": text(s["r"])}
    elif kind == "wheel" and joint is not None:
        radius = rollers.CENTRE if wheels == "rollers" else float(s["R"][0])
        size = text([radius, float(s["w"][0]) / 2])
        geom.attrib |= {"type": "cylinder", "zaxis": text(axis(joint)), "size": size}
        if wheels != "rollers":
            tread = {"class": "contact", "name": f"{link['name']}_tread", "type": "sphere"}
            ET.SubElement(body, "geom", tread, size=text(s["R"]))
    else:
        size = text(np.concatenate([s[key] for key in ("r", "h") if key in s]))
        geom.attrib |= {"pos": text(s["c"]), "size": size}


def _couplings(model: ET.Element, tables: Tables) -> None:
    equality = ET.SubElement(model, "equality")
    for follower, leader in tables.description["couplings"].items():
        law = {"joint1": follower, "joint2": leader, "polycoef": "0 1 0 0 0"}
        # stiff: with MuJoCo's default impedance the leaning torso would open the coupling by 0.04 degrees
        ET.SubElement(equality, "joint", law, solref="0.004 1", solimp="0.99 0.99 0.001")


def _motors(model: ET.Element, tables: Tables, wheels: Wheels) -> None:
    actuator = ET.SubElement(model, "actuator")
    for joint in tables.actuated():
        name, effort = joint["name"], float(joint["effort"])
        motor = ET.SubElement(actuator, "motor", name=name, ctrlrange=text([-effort, effort]))
        if is_wheel(joint) and wheels == "ball":  # a torque about the axle, which the base carries
            motor.attrib |= {"site": f"{name}_hub", "refsite": f"{name}_axle"}
            motor.set("gear", text([0.0, 0.0, 0.0, *axis(joint)]))
        else:
            motor.set("joint", name)


def _qpos(tables: Tables, wheels: Wheels) -> list[float]:
    """The default posture in MuJoCo's order, standing on the plane z = 0."""
    posture = tables.description["posture"]
    qpos = [0.0, 0.0, tables.base_height(), 1.0, 0.0, 0.0, 0.0]

    def visit(link: str) -> None:
        for joint in tables.children(link):
            if is_wheel(joint) and wheels == "ball":
                qpos.extend((1.0, 0.0, 0.0, 0.0))
            elif joint["type"] != "fixed":
                qpos.append(posture.get(joint["name"], 0.0))
            if is_wheel(joint) and wheels == "rollers":
                qpos.extend([0.0] * rollers.NUMBER)
            visit(joint["child"])

    visit(tables.description["root"])
    return qpos
