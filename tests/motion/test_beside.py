"""Legs of a planned motion pass by each other: sections at one height do not overlap, judged by linear programs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import hqp
from hqp.arrays import Mat, Vec
from hqp.motion import Motion
from hqp.motion.beside import SOON, Leg, Pair, aside, overlap, part
from hqp.motion.body import Body
from hqp.motion.contacts import Contacts, runs
from hqp.motion.joints import SIDES, parts_of
from hqp.motion.schedule import CLEAR, grounded, schedule_of
from hqp.motion.skeleton_map import find_map
from hqp.motion.targets import Targets, targets_of
from hqp.tasks.support_polygon import hull

from .people import walk


def _outline(rng: np.random.Generator) -> Mat:
    points = rng.normal(size=(int(rng.integers(3, 9)), 2)) * [0.1, 0.05]
    return np.asarray(points[hull(points)])


def _meet(one: Mat, other: Mat) -> bool:
    """True if a point lies in both hulls: shares of the corners of each, by a linear program."""
    n, m = len(one), len(other)
    if not n or not m:
        return False
    sums: Any = np.vstack((np.hstack((one.T, -other.T)), np.repeat([[1.0, 0.0], [0.0, 1.0]], [n, m], axis=1)))
    return bool(linprog(np.zeros(n + m), A_eq=sums, b_eq=[0.0, 0.0, 1.0, 1.0]).status == 0)


def _way(rng: np.random.Generator) -> Vec:
    angle = rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("seed", range(20))
def test_the_least_shift_parts_two_outlines(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other, way = _outline(rng), _outline(rng) + rng.normal(size=2) * 0.1, _way(rng)
    shift = overlap(one, other, way)
    assert (shift > 0.0) == _meet(one, other)
    assert not _meet(one + (shift + 1e-6) * way, other)
    assert shift == 0.0 or _meet(one + (shift - 1e-6) * way, other)


@pytest.mark.parametrize("seed", range(10))
def test_stances_are_moved_apart(seed: int) -> None:
    """A row of drawn stances, each beside the one before: overlapping stances move, others stay."""
    rng, n = np.random.default_rng(seed), 6
    sides = (rng.uniform(0.0, 0.1, n), -rng.uniform(0.0, 0.1, n))
    left, right = (np.array([[0.15 * i, y, 0.0] for i, y in enumerate(side)]) for side in sides)
    way = np.array([0.0, 1.0])
    pairs = [Pair(i, j, _outline(rng), _outline(rng), way) for i in range(n) for j in (i - 1, i) if j >= 0]
    before = left.copy(), right.copy()
    part((left, right), pairs)
    assert max(overlap(left[p.left, :2] + p.one, right[p.right, :2] + p.other, way) for p in pairs) < 1e-3
    met = {p.left for p in pairs if _meet(before[0][p.left, :2] + p.one, before[1][p.right, :2] + p.other)}
    others = {p.left for p in pairs if p.right in {q.right for q in pairs if q.left in met}}
    free = [i for i in range(n) if i not in met | others]
    np.testing.assert_array_equal(left[free], before[0][free])


@pytest.mark.parametrize("seed", range(10))
def test_a_swing_passes_by_the_other_leg(seed: int) -> None:
    """Drawn paths past and across a standing leg; ends stay, and the shift begins and ends at rest."""
    rng, n = np.random.default_rng(seed), int(np.random.default_rng(seed).integers(20, 60))
    angle, turn = rng.uniform(-np.pi, np.pi), rng.uniform(-0.5, 0.5)
    R = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    outline = np.array([[-0.1, -0.04], [0.1, -0.04], [0.1, 0.04], [-0.1, 0.04]])
    path = np.column_stack((np.linspace(-0.5, 0.5, n), rng.uniform(-0.05, 0.05) + np.zeros(n), np.zeros(n))) @ R.T
    ways = np.repeat([R[:2, 1]], n, axis=0)
    c, s = np.cos(turn), np.sin(turn)
    other = outline @ np.array([[c, s], [-s, c]]) @ R[:2, :2].T
    found = aside(path, [outline @ R[:2, :2].T] * n, [other] * n, ways)
    assert any(_meet(p[:2] + outline @ R[:2, :2].T, other) for p in path)
    assert not any(_meet(p[:2] + (outline * 0.99) @ R[:2, :2].T, other) for p in found)
    moved = np.linalg.norm(found - path, axis=1)
    assert moved[[0, -1]].max() < 3.0 / (SOON * n) ** 2 * moved.max()
    assert moved.max() < 1.05 * max(overlap(p[:2] + outline @ R[:2, :2].T, other, R[:2, 1]) for p in path)


@pytest.mark.parametrize("seed", range(6))
def test_legs_that_touch_as_a_foot_lifts_move_no_swing(seed: int) -> None:
    """A stance overlaps the other leg by less than a millimetre, and its swing leads away from there, or to it."""
    rng = np.random.default_rng(seed)
    n, deep = int(rng.integers(60, 120)), rng.uniform(1e-4, 5e-4)
    outline = np.array([[-0.1, -0.04], [0.1, -0.04], [0.1, 0.04], [-0.1, 0.04]])
    aside_of = 0.08 - deep + 0.2 * np.linspace(0.0, 1.0, n)
    path = np.column_stack((np.linspace(0.0, 0.05, n), aside_of, np.zeros(n)))[:: [1, -1][seed % 2]]
    found = aside(path, [outline] * n, [outline] * n, np.repeat([[0.0, 1.0]], n, axis=0))
    assert np.abs(found - path).max() < 2e-3


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_legs_keep_apart_at_the_height_of_the_higher_foot(seed: int) -> None:
    """A person whose feet tread on one line, or across it, in any direction; the left ones on ground as high as drawn:
    level, above the other foot, or above the other knee.
    """
    rng, robot = np.random.default_rng(seed), hqp.robots.load("g1")
    found, motion = find_map(None, robot), walk(2.5, rng.uniform(0.4, 0.9), fps=120.0)
    angle, narrow = rng.uniform(-np.pi, np.pi), rng.uniform(-0.1, 0.4)
    places = motion.positions.copy()
    feet = [i for i, name in enumerate(motion.names) if "Foot" in name or "Toe" in name]
    places[:, feet, 1] *= narrow
    turn = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    body = Body.of(robot, found)
    motion = Motion(motion.names, places @ turn, motion.fps, motion.parents)
    knee = body.length("knee", "ankle") + body.legs["left"].ankle[2]
    rise = (0.0, rng.uniform(0.3, 0.7) * knee, rng.uniform(1.2, 1.6) * knee)[seed % 3]
    targets = _raised(targets_of(motion, parts_of(motion.names, found.human), body), rise)
    schedule = schedule_of(targets, body)
    stances = [runs(stands) for stands in schedule.stands.T]
    whole = range(max(each[0][0] for each in stances), min(each[-1][1] for each in stances), 4)
    after = grounded(targets, body, schedule)
    met = [sum(_meet(*_legs(each, targets, body, i)) for i in whole) for each in (targets, after)]
    assert (met[0] > 10) == (rise < knee)
    assert met[1] == 0
    thin = {side: Leg(*(np.zeros_like(x) for x in leg[:3]), 0.0) for side, leg in body.legs.items()}
    apart = grounded(targets, replace(body, legs=thin), schedule).places
    moved = max(float(np.abs(after.places[f"{side}_sole"] - apart[f"{side}_sole"]).max()) for side in SIDES)
    assert (moved > 0.01) == (rise < knee)


def _raised(targets: Targets, rise: float) -> Targets:
    """Targets whose left foot is so much higher [m]."""
    places, ground = dict(targets.places), dict(targets.contacts.ground)
    for name in ("left_sole", "left_knee"):
        places[name] = places[name] + [0.0, 0.0, rise]
    ground["left_foot"] = np.full(len(targets), rise)
    return replace(targets, places=places, contacts=Contacts(targets.contacts.resting, ground))


def _legs(targets: Targets, person: Targets, body: Body, i: int) -> list[Mat]:
    """Outlines of both legs from above in a frame, a little smaller, where the higher foot begins; soles are
    ``CLEAR`` higher, shanks point to the person's knees.
    """
    found, level = [], max(float(targets.places[f"{side}_sole"][i, 2]) for side in SIDES)
    for side in SIDES:
        name, leg, other = f"{side}_sole", body.legs[side], np.zeros((0, 2))
        R, own = (each.axes[name][i] @ body.axes[name].T for each in (targets, person))
        ankle = targets.places[name][i] + R @ leg.ankle
        shin = person.places[f"{side}_knee"][i] - person.places[name][i] - own @ leg.ankle
        up = level - CLEAR - ankle[2]
        if level - CLEAR - targets.places[name][i, 2] < leg.top:
            other = targets.places[name][i, :2] + leg.sole @ R[:2, :2].T
        if up < shin[2]:
            other = np.vstack((other, leg.shank + (ankle + max(0.0, up / shin[2]) * shin)[:2]))
        middle = other.mean(axis=0) if len(other) else np.zeros(2)
        found.append(middle + 0.98 * (other - middle))
    return found
