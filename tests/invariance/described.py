"""One robot from a rewritten file, and its scenes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.random import Generator

import hqp
from hqp.arrays import Mat
from hqp.robots import Robot
from tests.invariance import generated, urdf
from tests.invariance.scenes import ARMS, BIPEDS, KINDS, REACHES, Scene, load


@dataclass(frozen=True, eq=False)
class Described:
    """A file without shapes, and the roles of its links.  posture: joint positions of the start by joint name."""

    name: str
    root: ET.Element
    floating: bool
    tool: str
    flat: tuple[str, ...] = ()
    posture: Mapping[str, float] | None = None
    height: float = 0.0

    def robot(
        self, folder: Path, root: ET.Element | None = None, names: Mapping[str, str] | None = None, length: float = 1.0
    ) -> Robot:
        """Robot of another version of the file; names: new names of joints by old ones."""
        return self.standing(
            hqp.robots.load(urdf.written(self.root if root is None else root, folder, "model"), floating=self.floating),
            names,
            length,
        )

    def standing(self, robot: Robot, names: Mapping[str, str] | None = None, length: float = 1.0) -> Robot:
        q = robot.home.copy()
        for joint, angle in (self.posture or {}).items():
            model = robot.model
            q[model.joints[model.getJointId((names or {}).get(joint, joint))].idx_q] = angle
        if self.floating:
            q[:7] = 0.0, 0.0, length * self.height, 0.0, 0.0, 0.0, 1.0
        robot.set_home(q)
        robot.model.gravity.linear = np.array([0.0, 0.0, -9.81 * length])
        return robot

    def scene(self, robot: Robot, kind: str, rng: Generator, names: Mapping[str, str] | None = None) -> Scene:
        new = names or {}
        return Scene(
            robot=robot, tool=new.get(self.tool, self.tool), kind=kind, flat=tuple(new.get(f, f) for f in self.flat),
            reach=float(rng.choice(list(REACHES.values()))), price=[None, 0][int(rng.integers(2))],
        )  # fmt: skip


@cache
def of_catalogue(name: str) -> Described:
    robot = load(name)
    assert robot.source is not None
    root = urdf.plain(robot.source)
    tool = ARMS.get(name) or robot.landmarks["palms"][0]
    model = robot.model
    single = [(n, j) for n, j in zip(model.names, model.joints, strict=True) if j.nq == 1]
    posture = {n: float(robot.home[j.idx_q]) for n, j in single}
    height = float(robot.home[2]) if robot.floating else 0.0
    return Described(name, root, robot.floating, tool, tuple(robot.landmarks.get("soles", ())), posture, height)


FILES = tuple(name for name in (*BIPEDS, *ARMS) if name not in ("cbi", "g1"))
"""Robots of the catalogue with soles that are links of their URDF."""


def drawn(rng: Generator) -> Described:
    """A robot of the catalogue, or a generated one."""
    if rng.random() < 0.5:
        return of_catalogue(str(rng.choice(FILES)))
    return generated.arm(rng) if rng.random() < 0.4 else generated.biped(rng)


def draw(kind: str, seed: int) -> tuple[Described, Generator]:
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    return drawn(rng), rng


def rotation(rng: Generator) -> Mat:
    """A uniformly random rotation."""
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0.0 else Q[:, [1, 0, 2]]
