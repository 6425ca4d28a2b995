"""A motion with dynamics is as calm as without, stands on the soles of its plan, and does not hang on rounding."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import hqp
from hqp.arrays import Mat
from hqp.motion import Motion, Retargeted, retarget
from hqp.motion.body import Body
from hqp.motion.contacts import runs
from hqp.motion.joints import SIDES, parts_of
from hqp.motion.rates import velocities
from hqp.motion.schedule import grounded, schedule_of
from hqp.motion.skeleton_map import find_map
from hqp.motion.stacks import Stacks
from hqp.motion.targets import targets_of
from hqp.motion.tracker import Tracker
from hqp.robots.knees import knee
from hqp.tasks.support_polygon import hull
from hqp.walking.feet import Foot, feet_of
from tests.scenes.clips import KINDS

from .people import stand, walk
from .robots import robot as catalogued

ROUNDING = 1e-9
"""Noise of the person's places [m]: far below any marker's."""

HOPS = ("jumping jacks", "jump", "hop")
"""Kinds of clips with flights: a clip that ends in the air leaves the foot that lands to rounding."""

LEG = re.compile("hip|knee|ankle")

DRAWN = [("squat", 0, False), *(pytest.param(kind, 1, True, marks=pytest.mark.slow) for kind in KINDS)]


@pytest.fixture(scope="module")
def g1() -> hqp.robots.Robot:
    return catalogued("g1")


def _clip(kind: str, seed: int, turn: float = 0.0) -> Motion:
    """A drawn clip at 30 frames a second, the person turned by an angle [rad]; two seconds of it if a foot stands."""
    motion = KINDS[kind](np.random.default_rng(seed)).at_rate(30.0)
    c, s = np.cos(turn), np.sin(turn)
    places: Any = motion.positions @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    whole = Motion(motion.names, places, motion.fps, motion.parents)
    return whole if kind in HOPS else whole.part(0, 60)


def _acceleration(found: Retargeted) -> float:
    """99th percentile over the frames of the fastest joint's acceleration [rad/s^2]."""
    v = velocities(found.robot, found.q, found.fps)[:, 6:]
    return float(np.quantile(np.abs(np.diff(v, axis=0)).max(axis=1) * found.fps, 0.99))


@pytest.mark.long
@pytest.mark.parametrize(("kind", "seed", "rounded"), DRAWN)
def test_a_carried_motion(kind: str, seed: int, rounded: bool, g1: hqp.robots.Robot) -> None:
    """Joints accelerate at most four times as much as without dynamics, the plan's ZMP is inside the soles, the CoM
    is where the plan has it, and noise of 1e-9 m in the person's places moves no joint by more than 1e-3 rad.  The
    report names flights.
    """
    clip = _clip(kind, seed, turn=2.0 * seed)
    found = retarget(clip, g1, dynamics=True)
    assert _acceleration(found) < 4.0 * max(_acceleration(retarget(clip, g1)), 50.0)
    assert found.dynamics is not None
    assert kind in HOPS or found.dynamics.missed < 0.02
    assert ("in the air" in str(found)) == (kind in HOPS)
    zmp, stands = found.dynamics.zmp, found.dynamics.stands
    feet = feet_of(g1)
    inside = [_inside(_corners(found, feet, i, down), zmp[i]) for i, down in enumerate(stands) if down.any()]
    assert np.mean(inside) > 0.9
    if rounded:
        noise: Any = ROUNDING * np.random.default_rng(0).standard_normal(clip.positions.shape)
        other = retarget(replace(clip, positions=clip.positions + noise), g1, dynamics=True)
        assert np.abs(found.angles - other.angles).max() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_the_body_is_as_high_as_planned(seed: int, g1: hqp.robots.Robot) -> None:
    """Arms that swing up and across leave the CoM's height, and with it the ZMP, to the plan."""
    found = retarget(KINDS["dab"](np.random.default_rng(seed)), g1, dynamics=True).dynamics
    assert found is not None
    assert found.missed < 8e-3
    assert found.zmp_outside[1] < 0.01


def _corners(found: Retargeted, feet: tuple[Foot, Foot], i: int, down: Any) -> Mat:
    """Corners of the boxes around the standing soles from above ``(m, 2)`` [m], 10 mm wider than the shapes."""
    state, points = found.robot.state(found.q[i]), []
    for foot, on in zip(feet, down, strict=True):
        if on:
            x_min, x_max, y_min, y_max = np.add(foot.rectangle, [-0.01, 0.01, -0.01, 0.01])
            own = np.array([[x, y, 0.0] for x in (x_min, x_max) for y in (y_min, y_max)])
            points.append(state.position(foot.frame) + own @ state.rotation(foot.frame).T)
    return np.vstack(points)[:, :2]


def _inside(corners: Mat, p: Any) -> bool:
    around = corners[hull(corners)]
    along, off = np.roll(around, -1, axis=0) - around, p - around
    return bool((along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0] > 0.0).all())


@pytest.mark.parametrize("seed", range(6))
def test_a_foot_spun_in_the_air_leaves_the_hands_alone(seed: int, g1: hqp.robots.Robot) -> None:
    """Hands are within 1 mm of their targets beside a foot that is turned by up to 2.5 rad about a drawn axis."""
    rng, found, motion = np.random.default_rng(seed), find_map(None, g1), walk(2.0, speed=0.5, fps=120.0)
    body = Body.of(g1, found)
    targets = targets_of(motion, parts_of(motion.names, found.human), body)
    schedule = schedule_of(targets, body)
    targets = grounded(targets, body, schedule)
    first, last = runs(~schedule.stands[:, 0])[1]
    frame, axis = (first + last) // 2, rng.normal(size=3)
    turn = Rotation.from_rotvec(rng.uniform(1.0, 2.5) * axis / np.linalg.norm(axis)).as_matrix()
    spun = replace(targets, axes={**targets.axes, "left_sole": turn @ targets.axes["left_sole"]})
    tracker = Tracker(g1, Stacks(g1, found, body, 1.0 / targets.fps, flat=True), spun)
    q = g1.home.copy()
    q[:2] = targets.places["pelvis"][frame, :2]
    state = g1.state(tracker.settle(q, frame))
    for hand in (tracker.stacks.points[f"{side}_hand"] for side in SIDES):
        assert np.linalg.norm(hand.error(state, targets.places[hand.name][frame])) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4, 5, 7])
def test_no_knee_bends_beyond_a_straight_leg(seed: int, g1: hqp.robots.Robot) -> None:
    """A person whose hips rise on straight legs before a foot lifts; G1's knees bend 0.09 rad beyond theirs."""
    rng, motion = np.random.default_rng(seed), stand(2.4, fps=60.0)
    times, places = np.arange(len(motion)) / 60.0, motion.positions.copy()
    rise, up = rng.uniform(0.03, 0.1), rng.uniform(0.15, 0.35)
    way = np.array([rng.uniform(-0.2, 0.3), rng.uniform(-0.05, 0.15), up])
    feet = [i for i, name in enumerate(motion.names) if "Foot" in name or "Toe" in name]
    body = [i for i in range(len(motion.names)) if i not in feet]
    left = [i for i in feet if "Left" in motion.names[i]]
    places[:, body, 2] += rise * np.interp(times, [0.4, 0.9], [0.0, 1.0])[:, None]
    places[:, left] += (np.interp(times, [1.1, 1.1 + rng.uniform(0.15, 0.4)], [0.0, 1.0])[:, None] * way)[:, None]
    found = retarget(Motion(motion.names, places, motion.fps, motion.parents), g1, dynamics=True)
    for side in SIDES:
        leg = [name for name in g1.joint_names if name.startswith(side) and LEG.search(name)]
        assert min(knee(g1, leg, q)[1] for q in found.q[::4]) > -1e-3
