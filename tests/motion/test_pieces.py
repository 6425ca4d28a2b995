"""Parts of retargeting alone: ends of a tree, soles at rest, figures of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hqp
from hqp.arrays import Vec
from hqp.motion.body import Body
from hqp.motion.contacts import NAMES as LIMBS
from hqp.motion.contacts import _without_short
from hqp.motion.joints import parts_of
from hqp.motion.measures import _feet, _walk, measure
from hqp.motion.person import with_toes
from hqp.motion.shortfalls import GAP, LIMITS, shortfalls
from hqp.motion.skeleton_map import find_map
from hqp.motion.stacks import Stacks
from hqp.motion.suggestion import _Tree
from hqp.motion.targets import Targets, targets_of

from .people import stand
from .robots import robot as catalogued


class Bodies(_Tree):
    """Bodies at places, each with a parent; the frame of a body is its number."""

    def __init__(self, places: Sequence[Sequence[float]], parents: Sequence[int]) -> None:
        self._places, self._parents = [np.array(place) for place in places], list(parents)

    def frame(self, body: int) -> str:
        return str(body)


def test_hands_are_the_ends_furthest_to_the_sides() -> None:
    sides = [
        (0.0, 0.1, 0.0),
        (0.0, -0.1, 0.0),
        (-0.1, 0.5, 1.0),
        (-0.1, -0.5, 1.0),
        (0.3, 0.05, 1.4),
        (-0.3, -0.05, 1.4),
    ]
    tree = Bodies([(0.0, 0.0, 0.0), (0.0, 0.0, 0.8), *sides], [0, 0, *[1] * len(sides)])
    assert tree.hands() == ("4", "5")


@pytest.mark.parametrize(("hip", "expected"), [(0.0, 3), (0.07, 3), (0.09, 2)])
def test_the_hip_is_the_first_body_as_far_out_as_the_knee(hip: float, expected: int) -> None:
    tree = Bodies([(0.0, y, 0.0) for y in (0.0, 0.0, hip, 0.1, 0.1)], [0, 0, 1, 2, 3])
    assert tree.first_beside([2, 3], 4) == expected


@cache
def g1() -> tuple[hqp.robots.Robot, Body]:
    robot = catalogued("g1")
    return robot, Body.of(robot, find_map(None, robot))


def resting(yaw: Vec, tilt: Vec) -> Targets:
    """Targets of a person whose left foot turns by angles [rad] on the ankle while both feet rest."""
    motion = stand(1.0)
    places, ankle, toe = motion.positions.copy(), motion.names.index("LeftFoot"), motion.names.index("LeftToeBase")
    way = places[:, toe] - places[:, ankle]
    flat, down = np.linalg.norm(way[:, :2], axis=1), np.arctan2(-way[:, 2], np.linalg.norm(way[:, :2], axis=1)) + tilt
    length = np.hypot(flat, way[:, 2])
    ahead = np.column_stack((np.cos(down) * np.cos(yaw), np.cos(down) * np.sin(yaw), -np.sin(down)))
    places[:, toe] = places[:, ankle] + length[:, None] * ahead
    contacts = np.tile(["foot" in name for name in LIMBS], (len(motion), 1))
    return targets_of(type(motion)(motion.names, places, motion.fps), parts_of(motion.names), g1()[1], contacts)


def angles(found: Targets) -> tuple[Vec, Vec]:
    """Yaw and tilt of the left sole's x axis."""
    x = found.axes["left_sole"] @ g1()[1].axes["left_sole"].T @ np.array([1.0, 0.0, 0.0])
    return np.arctan2(x[:, 1], x[:, 0]), -np.arcsin(x[:, 2])


def test_a_sole_at_rest_keeps_the_median_yaw_of_its_foot() -> None:
    yaw = np.linspace(0.1, 0.3, 30)
    found, tilt = angles(resting(yaw, np.zeros(30)))
    np.testing.assert_allclose(found, 0.2, atol=1e-6)
    np.testing.assert_allclose(tilt, 0.0, atol=1e-6)


@pytest.mark.parametrize(("tilt", "edge"), [(0.1, 0), (0.3, 1), (-0.3, -1)])
def test_a_sole_that_tilts_far_rests_on_an_edge(tilt: float, edge: int) -> None:
    tilted = np.where(np.arange(30) < 18, 0.0, tilt)
    made = resting(np.zeros(30), tilted)
    assert set(made.edge["left"][20:].tolist()) == {edge}
    assert set(made.edge["left"][:16].tolist()) == {0}
    np.testing.assert_allclose(angles(made)[1][22:], edge * 0.15, atol=1e-6)


def test_figures_of_a_motion_of_constant_acceleration() -> None:
    """One joint at 2 rad/s^2 from rest: acceleration, jerk and share of the speed limit, by hand."""
    robot, body = g1()
    found = targets_of(stand(1.0), parts_of(stand(1.0).names), body)
    column, times, lasting = robot.joints("left_elbow_joint")[0], np.arange(len(found)) / found.fps, len(found)
    way = np.zeros((lasting, robot.nv))
    way[:, column] = 0.5 * 2.0 * times**2
    q = np.array([robot.integrate(robot.home, step, 1.0) for step in way])
    stacks = Stacks(robot, find_map(None, robot), body, 1.0 / found.fps, collision=False)
    figures = measure(robot, stacks, found, q)
    np.testing.assert_allclose(figures.acceleration, 2.0, atol=1e-6)
    np.testing.assert_allclose(figures.jerk, 0.0, atol=1e-4)
    fastest = 2.0 * (times[1:] - 0.5 / found.fps)
    np.testing.assert_allclose(figures.speed, fastest / robot.velocity_limit[column], atol=1e-9)


@pytest.mark.parametrize(("share", "rows"), [(0.5, [(20, 80)]), (1.5, [(20, 40), (60, 80)])])
def test_a_short_gap_does_not_split_a_shortfall(
    share: float, rows: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """20 frames within the limit between 40 frames beyond it; a gap counts from ``GAP`` seconds on."""
    monkeypatch.setattr("hqp.motion.shortfalls._reason", lambda *_: "a limit")
    errors = {part: np.zeros(100) for part in LIMITS}
    errors["left_hand"][20:40] = errors["left_hand"][60:80] = 2.0 * LIMITS["left_hand"]
    tracker: Any = SimpleNamespace(dt=share * GAP / 20.0)
    found = shortfalls(tracker, np.zeros((100, 1)), np.zeros((100, 1)), errors)
    assert [(each.first, each.last) for each in found] == rows
    assert {each.part for each in found} == {"left_hand"}


@pytest.mark.parametrize(("lasting", "kept"), [(3, False), (9, True)])
def test_short_rests_and_gaps_do_not_count(lasting: int, kept: bool) -> None:
    mask = np.zeros(100, dtype=bool)
    mask[40 : 40 + lasting] = True
    assert _without_short(mask, 100.0).any() == kept
    assert _without_short(~mask, 100.0).all() != kept


@pytest.mark.parametrize("heading", [0.0, 1.2, 2.8, -2.0])
def test_feet_without_toes_point_ahead_of_the_hips(heading: float) -> None:
    motion = stand(0.2, heading)
    joints = {part: motion.joint(name) for part, name in parts_of(motion.names).items() if "toe" not in part}
    found = with_toes(joints)
    for side in ("left", "right"):
        ahead = found[f"{side}_toe"] - found[f"{side}_ankle"]
        np.testing.assert_allclose(np.arctan2(ahead[:, 1], ahead[:, 0]), heading, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(ahead, axis=1), 0.17 * 0.84, rtol=1e-2)


def test_feet_that_are_lowered_are_below_the_floor_by_as_much() -> None:
    robot, body = g1()
    stacks = Stacks(robot, find_map(None, robot), body, 0.02, collision=False)
    q = np.tile(robot.home, (2, 1))
    q[1, 2] -= 0.02
    heights = _feet(robot, stacks, _walk(robot, stacks, q)[3])
    np.testing.assert_allclose(heights, [0.0, -0.02], atol=2e-3)
