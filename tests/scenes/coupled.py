"""Generated robots with followers for tests: chains of links with mimic joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import hqp
from hqp.arrays import Vec

LINK = (
    '<link name="l{0}"><inertial><origin xyz="0.02 0.01 0.05"/><mass value="0.3"/>'
    '<inertia ixx="2e-3" iyy="3e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="j{0}" type="{kind}"><parent link="l{parent}"/><child link="l{child}"/><origin xyz="0 0 0.1"/>'
    '<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" velocity="{speed}" effort="50"/>{mimic}</joint>'
)
RATIOS = (-3.0, -2.0, -1.7, -0.5, 0.1, 0.25, 0.75, 1.0, 1.5, 3.0)


@dataclass(frozen=True)
class Follower:
    """Joint ``joint`` = ratio * ``leader`` + offset."""

    joint: str
    leader: str
    ratio: float
    offset: float


@dataclass(frozen=True)
class Coupled:
    """A robot of joints j0, j1, ..., with leader j0, and the followers."""

    robot: hqp.robots.Robot
    followers: tuple[Follower, ...]

    def angles(self, leader: float) -> Vec:
        """Positions of all joints ``(nv,)``, turns included, with j0 at ``leader``."""
        at = {"j0": leader}
        for f in self.followers:
            at[f.joint] = f.ratio * at[f.leader] + f.offset
        return np.array([at[self.robot.joint_name(i)] for i in range(self.robot.nv)])

    def off(self, angles: Vec) -> float:
        """Largest coupling error of a follower [rad or m]."""
        at = {self.robot.joint_name(i): float(a) for i, a in enumerate(angles)}
        return max(abs(at[f.joint] - f.ratio * at[f.leader] - f.offset) for f in self.followers)


def draw(rng: np.random.Generator, folder: Path, kind: str = "continuous") -> Coupled:
    """A chain of a leader and one to three followers, each of the leader or of another follower."""
    count = int(rng.integers(1, 4))
    followers = []
    for i in range(1, count + 1):
        leader = f"j{int(rng.integers(0, i))}"
        followers.append(Follower(f"j{i}", leader, float(rng.choice(RATIOS)), round(float(rng.uniform(-1, 1)), 3)))
    path = folder / "chain.urdf"
    path.write_text(urdf(rng, followers, kind))
    return Coupled(hqp.robots.load(path), tuple(followers))


def urdf(
    rng: np.random.Generator,
    followers: Sequence[Follower],
    kind: str,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> str:
    """The file: links l0, l1, ..., each joint about or along a drawn axis, within [-60, 60] unless given."""
    parts = [LINK.format(i) for i in range(len(followers) + 2)]
    for i in range(len(followers) + 1):
        mimic = ""
        if i:
            f = followers[i - 1]
            mimic = f'<mimic joint="{f.leader}" multiplier="{f.ratio}" offset="{f.offset}"/>'
        axis = " ".join(f"{x:.3f}" for x in rng.normal(size=3))
        lower, upper = (limits or {}).get(f"j{i}", (-60, 60))
        values = {"kind": kind, "axis": axis, "mimic": mimic, "lower": lower, "upper": upper, "speed": 100}
        parts.append(JOINT.format(i, parent=i, child=i + 1, **values))
    return '<robot name="chain">' + "".join(parts) + "</robot>"
