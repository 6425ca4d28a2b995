"""Generated mechanisms with closed loops as MJCF, each closed in its zero configuration."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hqp.arrays import Vec

HEAD = (
    '<mujoco model="{name}"><compiler angle="radian" autolimits="true"/><option timestep="0.0005"/>'
    '<default><geom contype="0" conaffinity="0" density="800"/><joint armature="0.01"/>'
    '<equality solref="0.004 1" solimp="0.9999 0.9999 0.01"/></default>'
)
KINDS = ("four-bar", "leg", "delta")
LEADS = {"four-bar": ("crank",), "leg": ("hip", "knee"), "delta": ("arm0", "arm1", "arm2")}


def draw(rng: np.random.Generator, kind: str) -> str:
    """The file of a mechanism; its motors are ``LEADS[kind]``."""
    body, closures = {"four-bar": _four_bar, "leg": _leg, "delta": _delta}[kind](rng)
    motors = "".join(f'<motor joint="{name}" ctrlrange="-2000 2000"/>' for name in LEADS[kind])
    return (
        f"{HEAD.format(name=kind)}<worldbody>{body}</worldbody><equality>{closures}</equality>"
        f"<actuator>{motors}</actuator></mujoco>"
    )


def _numbers(x: Sequence[float] | Vec) -> str:
    return " ".join(f"{float(v):.9f}" for v in x)


def _link(name: str, start: Vec, end: Vec, parent: Vec, joints: Sequence[tuple[str, Vec]], inside: str = "") -> str:
    """A rod from ``start`` to ``end`` in the world, attached at ``start`` to a body with origin ``parent``."""
    hinges = "".join(f'<joint name="{j}" axis="{_numbers(axis)}"/>' for j, axis in joints)
    rod = f'<geom type="capsule" size="0.02" fromto="0 0 0 {_numbers(end - start)}"/>'
    return f'<body name="{name}" pos="{_numbers(start - parent)}">{hinges}{rod}{inside}</body>'


def _connect(name: str, one: str, start: Vec, other: str, point: Vec) -> str:
    """Both bodies share a point of the world; the first one's origin is ``start``."""
    return f'<connect name="{name}" body1="{one}" body2="{other}" anchor="{_numbers(point - start)}"/>'


def _across(rod: Vec) -> list[Vec]:
    """Two axes of a universal joint, across a rod."""
    first = np.cross(rod, (0.3, 0.5, 0.8))
    first /= np.linalg.norm(first)
    other = np.cross(rod, first)
    return [first, other / np.linalg.norm(other)]


def _four_bar(rng: np.random.Generator) -> tuple[str, str]:
    y, p0 = np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0))

    def near(x: float, z: float) -> Vec:
        return p0 + (x + rng.uniform(-0.04, 0.04), 0.0, z + rng.uniform(-0.04, 0.04))

    p1, p2, p3 = near(0.05, -0.2), near(0.4, -0.25), near(0.35, 0.0)
    rod = _link("rod", p1, p2, p0, [("rod", y)])
    crank, rocker = (
        _link("crank", p0, p1, np.zeros(3), [("crank", y)], rod),
        _link("rocker", p3, p2, np.zeros(3), [("rocker", y)]),
    )
    return crank + rocker, _connect("loop", "rod", p1, "rocker", p2)


def _leg(rng: np.random.Generator) -> tuple[str, str]:
    """Hip and knee with motors; a rod from the thigh bends the tarsus, as Cassie's Achilles rod."""
    hip = np.array((0.0, 0.0, 1.0))

    def near(*at: float) -> Vec:
        return hip + at + rng.uniform(-0.03, 0.03, 3)

    def axis() -> Vec:
        return np.array((0.0, 1.0, 0.0)) + rng.uniform(-0.1, 0.1, 3)

    knee, ankle, toe, heel, top = (
        near(0.1, 0, -0.4),
        near(-0.1, 0, -0.75),
        near(0.1, 0, -0.85),
        near(-0.35, 0, -0.7),
        near(-0.15, 0.05, -0.1),
    )
    tarsus = _link("tarsus", ankle, toe, knee, [("ankle", axis())])
    shin = _link("shin", knee, ankle, hip, [("knee", axis())], tarsus)
    one, two = _across(heel - top)
    rod = _link("rod", top, heel, hip, [("rod1", one), ("rod2", two)])
    thigh = _link("thigh", hip, knee, np.zeros(3), [("hip", axis())], shin + rod)
    return thigh, _connect("achilles", "rod", top, "tarsus", heel)


def _delta(rng: np.random.Generator) -> tuple[str, str]:
    """Three arms, two rods on each, and a platform that is a free body."""
    base, below = np.array((0.0, 0.0, 1.0)), 0.45 + rng.uniform(-0.05, 0.05)
    reach, centre = 0.25 + rng.uniform(-0.03, 0.03), base - (0.0, 0.0, below)
    plate = '<freejoint name="platform"/><geom type="cylinder" size="0.06 0.01"/>'
    parts = f'<body name="platform" pos="{_numbers(centre)}">{plate}</body>'
    closures = ""
    for k in range(3):
        angle = 2.0 * math.pi * k / 3.0
        out, side = (
            np.array((math.cos(angle), math.sin(angle), 0.0)),
            np.array((-math.sin(angle), math.cos(angle), 0.0)),
        )
        shoulder, elbow, tip = base + 0.1 * out, base + (0.1 + reach) * out - (0, 0, 0.05), centre + 0.06 * out
        rods = ""
        for n, shift in enumerate((-0.04, 0.04)):
            start, end = elbow + shift * side, tip + shift * side
            one, two = _across(end - start)
            rods += _link(f"rod{k}{n}", start, end, shoulder, [(f"u{k}{n}", one), (f"w{k}{n}", two)])
            closures += _connect(f"tip{k}{n}", f"rod{k}{n}", start, "platform", end)
        parts += _link(f"arm{k}", shoulder, elbow, np.zeros(3), [(f"arm{k}", side)], rods)
    return parts, closures
