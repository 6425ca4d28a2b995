"""Flights of a person: the report has their times, at any rate, heading and unit, and none of a walk."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hqp.motion import Motion
from hqp.motion.body import Body
from hqp.motion.dynamics import Dynamics
from hqp.motion.joints import parts_of
from hqp.motion.retargeting import ticked
from hqp.motion.schedule import Schedule, schedule_of
from hqp.motion.skeleton_map import find_map
from hqp.motion.targets import targets_of
from tests.scenes.clips import FPS, GRAVITY, NAMES, ease, hops

from .people import walk
from .robots import robot as catalogued


def _schedule(motion: Motion) -> Schedule:
    """The contacts that G1 has for a motion."""
    g1 = catalogued("g1")
    found = find_map(None, g1)
    body, clip = Body.of(g1, found), ticked(motion, motion.fps)
    return schedule_of(targets_of(clip, parts_of(clip.names, found.human), body), body)


def _drawn(motion: Motion, rng: Any) -> Motion:
    """The motion at a drawn rate, in a drawn heading and unit."""
    angle, unit = rng.uniform(0.0, 2.0 * np.pi), rng.choice([1.0, 100.0, 39.37])
    c, s = np.cos(angle), np.sin(angle)
    places = unit * motion.positions @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return Motion(motion.names, places, motion.fps, motion.parents).at_rate(float(rng.uniform(30.0, 240.0)))


@pytest.mark.parametrize("seed", range(8))
def test_a_jump_has_its_flight(seed: int) -> None:
    """A person jumps 0.1 to 0.4 m high and up to 0.5 m ahead at a drawn time."""
    rng = np.random.default_rng(seed)
    jump = hops(rng, 1, 2.0 * np.sqrt(2.0 * rng.uniform(0.1, 0.4) / GRAVITY))
    jump = jump.part(int(rng.integers(0, 30)), len(jump.positions))
    height = jump.positions[:, NAMES.index("LeftFoot"), 2]
    lift, land = np.flatnonzero(height > height[0] + 1e-6)[[0, -1]] / FPS
    ahead = rng.uniform(0.0, 0.5) * ease(np.arange(len(height)) / FPS, lift, land)
    places = jump.positions + ahead[:, None, None] * np.array([1.0, 0.0, 0.0])
    ((first, last),) = _schedule(_drawn(Motion(jump.names, places, FPS, jump.parents), rng)).flights
    assert abs(first - lift) < 0.06
    assert abs(last - land) < 0.06


@pytest.mark.parametrize("seed", range(4))
def test_a_walk_has_no_flight(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert not _schedule(_drawn(walk(2.0, speed=rng.uniform(0.3, 1.8), fps=120.0), rng)).flights


def test_the_report_has_the_times_of_flights() -> None:
    zero = np.zeros((3, 3))
    stands = np.ones((3, 2), dtype=bool)
    plan = Dynamics(stands, ~stands, zero, zero, zero, zero[:, :2], zero[:, 0], (0.0, 0.0), (0.0, 0.0), 0.0)
    assert not any("in the air" in line for line in plan.lines())
    flown = replace(plan, flights=((1.0, 1.25), (2.0, 2.5)))
    times = [line.split(":")[0] for line in flown.lines() if "in the air" in line]
    assert times == [f"both feet are in the air from {each} s" for each in ("1.00 to 1.25", "2.00 to 2.50")]
