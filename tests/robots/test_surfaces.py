"""Capsules contain each link's surface and stay close to its convex hull, for all shapes, scales and units."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp
from hqp import Level, P, Stack, shapes
from hqp.collision_library import coal
from hqp.robots import capsule_files, capsules, geometry
from hqp.robots.surface import Surface
from hqp.shapes import LinkCapsule
from hqp.tasks import CollisionAvoidance, JointLimits, Posture
from tests.scenes.collision.surfaces import SHAPES, arm, around, distance, drawn, outside, vectors


def judge(robot: Any, found: Any, count: int = 10_000) -> None:
    """Check containment of drawn points to 1e-6 m, and the mean distance of the capsules to the hull by coal."""
    for link in around(robot, found, count):
        assert link.outside < 1e-6, link
        assert link.away <= link.allowed, link


@pytest.mark.parametrize("kind", SHAPES)
def test_capsules_contain_the_surface_and_are_tight(kind: str, tmp_path: Path) -> None:
    robot = arm(tmp_path, SHAPES[kind])
    judge(robot, capsules.fitted(robot))


@pytest.mark.long
@pytest.mark.parametrize("sides", [300, pytest.param(1000, marks=pytest.mark.slow)])
def test_a_fine_disc_has_capsules(sides: int, tmp_path: Path) -> None:
    """A corner of its hull may have more neighbours than coal's convex shapes take."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    low = np.column_stack((0.2 * np.cos(turn), 0.2 * np.sin(turn), 0.0 * turn))
    high, up = low + (0.0, 0.0, 0.05), np.array([0.0, 0.0, 0.05])
    rings = [(0.0 * low, low, np.roll(low, -1, axis=0)), (0.0 * high + up, high, np.roll(high, -1, axis=0))]
    rings += [(low, high, np.roll(low, -1, axis=0)), (np.roll(low, -1, axis=0), high, np.roll(high, -1, axis=0))]
    part = Surface(np.concatenate([np.stack(ring, axis=1) for ring in rings]), np.zeros(4 * sides))
    links = [LinkCapsule("disc", 1, tuple(a), tuple(b), r) for a, b, r in capsules.fit(part)]
    assert outside(part.triangles.mean(axis=1), links) < 1e-6
    assert outside(part.points(), links) < 1e-6


def test_capsules_of_several_shapes_on_a_link(tmp_path: Path) -> None:
    robot = arm(tmp_path, SHAPES["ball"], SHAPES["rod"], SHAPES["mirrored"])
    judge(robot, capsules.fitted(robot))


def test_shipped_capsules_contain_the_surface() -> None:
    panda = hqp.robots.load("panda")
    judge(panda, panda.capsules, 1000)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", sorted(p.stem for p in capsule_files.FOLDER.glob("*.toml") if "bimanual" not in p.stem)
)
def test_shipped_capsules_of_every_robot(name: str) -> None:
    robot = hqp.robots.load(name)
    judge(robot, robot.capsules)


@pytest.mark.parametrize("kind", ["rod", "mirrored", "plate"])
def test_a_turning_link_stops_short_of_a_ball(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a closed loop coal's distance of the file's own geometry keeps the clearance."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    robot = arm(tmp_path, SHAPES[kind], place="0.15 0 0", rpy="0 0 0")
    (item,) = robot.geometry.geometryObjects
    points = drawn(item, 2000, np.random.default_rng(0))
    hull = coal.ConvexBase.convexHull(vectors(points), False, "Qt")
    at = np.array([0.2 * math.cos(1.2), 0.2 * math.sin(1.2), 0.0])
    avoid = CollisionAvoidance(world=(shapes.sphere("ball", 0.02, tuple(at)),), clearance=0.01)
    turn = Posture(law=P(2.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        session = hqp.Controller(Stack(Level(turn), subject_to=[JointLimits(), avoid])).session(robot, dt=0.01)
    q, v, least = robot.home, np.zeros(1), math.inf
    for _ in range(300):
        q, v = session.step(robot.state(q, v), turn.at([1.5])).advance()
        c, s = math.cos(q[0]), math.sin(q[0])
        least = min(least, distance(np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ at, hull) - 0.02)
    assert 0.01 - 1e-3 < least < 0.1


def test_a_session_reads_shapes_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Capsules and pairs come from one reading of the shapes, which nothing keeps afterwards."""
    readings = []
    monkeypatch.setattr(geometry, "read", lambda *of, read=geometry.read: readings.append(of[-1]) or read(*of))
    stack = Stack(Level(Posture()), subject_to=[CollisionAvoidance(clearance=0.0137)])  # no pairs known by now
    robot = hqp.robots.load("panda")
    hqp.Controller(stack, hqp.Velocity()).session(robot, 0.002)
    assert readings == ["collision"]
    robot.contacts()
    assert readings == ["collision"] * 2


def test_shapes_are_kept_until_the_outermost_context_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    readings = []
    monkeypatch.setattr(geometry, "read", lambda *of, read=geometry.read: readings.append(of[-1]) or read(*of))
    stack = Stack(Level(Posture()), subject_to=[CollisionAvoidance(clearance=0.0138)])
    robot = hqp.robots.load("panda")
    with robot.keep_shapes():
        robot.contacts()
        hqp.Controller(stack, hqp.Velocity()).session(robot, 0.002)
        robot.contacts()
    assert readings == ["collision"]
    robot.contacts()
    assert readings == ["collision"] * 2
