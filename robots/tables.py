"""The tables of our own robots and the numbers read from them; shared by the model writers.

``joints.csv``, ``links.csv`` and ``points.csv`` of a robot's folder are the one source of numbers. ``robot.toml`` adds
data without a table: the posture, the joints without a motor, the plant's parameters.
"""

from __future__ import annotations

import csv
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Row = dict[str, str]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tables:
    """The tables of one robot, row by row as printed, and its ``robot.toml``."""

    joints: tuple[Row, ...]
    links: tuple[Row, ...]
    points: tuple[Row, ...]
    description: dict[str, Any]

    @classmethod
    def read(cls, folder: Path) -> Tables:
        """Read ``joints.csv``, ``links.csv``, ``points.csv`` and ``robot.toml`` of a robot's folder."""

        def rows(name: str) -> tuple[Row, ...]:
            with (folder / f"{name}.csv").open(newline="") as file:
                return tuple(csv.DictReader(file))

        description = tomllib.loads((folder / "robot.toml").read_text())
        return cls(rows("joints"), rows("links"), rows("points"), description)

    def link(self, name: str) -> Row:
        """The row of a link."""
        return next(row for row in self.links if row["name"] == name)

    def children(self, link: str) -> Iterator[Row]:
        """The joints that leave a link, in table order."""
        return (joint for joint in self.joints if joint["parent"] == link)

    def frames(self, link: str) -> Iterator[Row]:
        """Points of a link that become named frames: reference points, wheel contacts; no sole corners."""
        return (p for p in self.points if p["frame"] == link and p["set"] in ("frame", "contact"))

    def moving(self) -> Iterator[Row]:
        """The joints that move, in table order."""
        return (joint for joint in self.joints if joint["type"] != "fixed")

    def actuated(self) -> Iterator[Row]:
        """The joints with a motor, in table order."""
        return (joint for joint in self.moving() if joint["name"] not in self.description["unactuated"])

    def base_height(self) -> float:
        """Height of the root that puts the lowest ground point of the default posture at zero [m]."""
        posture = self.description["posture"]
        heights: list[float] = []

        def visit(link: str, turn: Array, origin: Array) -> None:
            ground = (p for p in self.points if p["frame"] == link and p["set"] in ("rect4", "contact"))
            heights.extend(float((origin + turn @ vector(p, "x", "y", "z"))[2]) for p in ground)
            for joint in self.children(link):
                at = origin + turn @ vector(joint, "x", "y", "z")
                visit(joint["child"], turn @ rotation(axis(joint), posture.get(joint["name"], 0.0)), at)

        visit(self.description["root"], np.eye(3), np.zeros(3))
        return -min(heights)


def vector(row: Row, *names: str) -> Array:
    """The named numbers of a row."""
    return np.array([float(row[name]) for name in names])


def axis(joint: Row) -> Array:
    """Unit axis of a joint: the tables round to six digits, and no two readers normalise alike."""
    a = vector(joint, "ax", "ay", "az")
    return a / float(np.linalg.norm(a)) + 0.0  # + 0.0 turns -0.0 into 0.0


def inertia(link: Row) -> Array:
    """Inertia about the centre of mass, link axes (3, 3) [kg m^2]."""
    xx, yy, zz, xy, xz, yz = vector(link, "ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def shapes(link: Row) -> list[tuple[str, dict[str, Array]]]:
    """The ``geom`` column: ``box c=0,0,0.1 h=...`` or ``capsule 0,0,0 0,0,1 r=...``, several with ``;`` between."""
    return [_shape(each) for each in link["geom"].split(";")]


def _shape(words_of_it: str) -> tuple[str, dict[str, Array]]:
    kind, *words = words_of_it.split()
    named = [word.partition("=") for word in words if "=" in word]
    values = {key: np.array([float(x) for x in value.split(",")]) for key, _, value in named}
    ends = [np.array([float(x) for x in word.split(",")]) for word in words if "=" not in word]
    return kind, values | dict(zip(("from", "to"), ends, strict=False))


def rotation(a: Array, angle: float) -> Array:
    """Rodrigues' formula: the turn by ``angle`` [rad] about the unit vector ``a`` (3, 3)."""
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def text(values: Iterable[float] | float) -> str:
    """Shortest decimals that read back as the same doubles."""
    numbers = [values] if isinstance(values, int | float) else list(values)
    return " ".join(repr(float(x)).removesuffix(".0") for x in numbers)


def document(root: ET.Element) -> str:
    """The file's text, indented, with a line on its origin."""
    ET.indent(root)
    header = "<!-- Written by robots/from_tables.py: do not edit. -->"
    return f"{header}\n{ET.tostring(root, encoding='unicode')}\n"
