"""Robots of no catalogue, drawn from a seed: an arm, a gantry with an arm, and a biped with arms."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.random import Generator

import hqp.robots
from hqp.robots import Robot

DRAWN = ("drawn arm", "drawn gantry", "drawn biped")

_LINK = (
    '<link name="{name}"><inertial><origin xyz="0 0 {half}"/><mass value="{mass}"/><inertia ixx="{wide}" iyy="{wide}" '
    'izz="{thin}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
_JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
    '<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="{velocity}"/></joint>'
)
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


class _Tree:
    """Text of a URDF."""

    def __init__(self, name: str, draw: Generator) -> None:
        self.name, self.draw, self.parts = name, draw, list[str]()

    def link(self, name: str, mass: float, length: float) -> None:
        wide = mass * (length**2 + 0.05**2) / 12.0 + 1e-3
        self.parts.append(_LINK.format(name=name, mass=mass, half=0.5 * length, wide=wide, thin=0.5 * wide))

    def joint(self, parent: str, child: str, at: tuple[float, ...], axis: str, effort: float, kind: str = "") -> None:
        """A joint with a drawn range, by default a hinge; its child is named as the joint."""
        slides = kind == "prismatic"
        reach = self.draw.uniform(0.4, 0.8) if slides else self.draw.uniform(1.6, 2.9)
        self.parts.append(
            _JOINT.format(
                name=child,
                kind=kind or "revolute",
                parent=parent,
                child=f"{child}_link",
                xyz=" ".join(f"{x:.4f}" for x in at),
                axis=_AXES[axis],
                lower=-reach,
                upper=reach,
                effort=effort,
                velocity=self.draw.uniform(0.5, 1.0) if slides else self.draw.uniform(2.0, 8.0),
            )
        )

    def chain(self, parent: str, name: str, axes: str, at: tuple[float, ...], effort: float, mass: float) -> str:
        """Hinges in series from a place on ``parent``; returns the last link.  p before an axis: a slide."""
        slide = False
        k = 0
        for axis in axes:
            if axis == "p":
                slide = True
                continue
            child, length = f"{name}_{k}", float(self.draw.uniform(0.12, 0.3))
            self.joint(parent, child, at, axis, 10.0 * effort if slide else effort, "prismatic" if slide else "")
            self.link(f"{child}_link", mass * float(self.draw.uniform(0.5, 1.5)), length)
            parent, at, slide, k = f"{child}_link", (0.0, 0.0, length), False, k + 1
        return parent

    def load(self, *, floating: bool) -> Robot:
        text = f'<robot name="{self.name}">{"".join(self.parts)}</robot>'
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "drawn.urdf"
            path.write_text(text, encoding="utf-8")
            robot = hqp.robots.load(path, floating=floating)
        robot.name = self.name
        return robot


def drawn(name: str, seed: int = 0) -> Robot:
    """A robot of ``DRAWN``, with palms, and soles and a base if it is a biped."""
    draw = np.random.default_rng([seed, DRAWN.index(name)])
    tree = _Tree(name, draw)
    if name == "drawn biped":
        return _biped(tree)
    tree.link("base", 10.0, 0.2)
    axes = "pxpypz" + "zyy" if name == "drawn gantry" else "zyyzyzx"
    palm = tree.chain("base", "arm", axes, (0.0, 0.0, 0.2), 150.0, 2.0)
    robot = tree.load(floating=False)
    robot.landmarks = {"palms": (palm, palm), "soles": (), "base": ("base",)}
    robot.set_home(robot.configuration(draw.uniform(-0.3, 0.3, robot.nv) + 0.4))
    return robot


def _biped(tree: _Tree) -> Robot:
    tree.link("trunk", 15.0, 0.4)
    thigh, shank = (float(tree.draw.uniform(0.3, 0.4)) for _ in range(2))
    for side, y in (("left", 0.1), ("right", -0.1)):
        parent, at = "trunk", (0.0, y, 0.0)
        places = [at, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -thigh), (0.0, 0.0, -shank), (0.0, 0.0, 0.0)]
        for k, (axis, place) in enumerate(zip("zxyyyx", places, strict=True)):
            child = f"{side}_leg_{k}"
            tree.joint(parent, child, place, axis, 200.0)
            tree.link(f"{child}_link", 2.0, -0.2)
            parent = f"{child}_link"
        tree.chain("trunk", f"{side}_arm", "yxyy", (0.0, 2.0 * y, 0.35), 60.0, 1.0)
    robot = tree.load(floating=True)
    robot.landmarks = {
        "palms": ("left_arm_3_link", "right_arm_3_link"), "soles": ("left_leg_5_link", "right_leg_5_link"),
        "base": ("trunk",),
    }  # fmt: skip
    angles = np.zeros(robot.nv)
    for side in ("left", "right"):
        angles[robot.joints([f"{side}_leg_{k}" for k in (2, 3, 4)])] = -0.4, 0.8, -0.4
        angles[robot.joints([f"{side}_arm_{k}" for k in (0, 2)])] = 1.2, 0.8
    robot.set_home(robot.configuration(angles))
    return robot
