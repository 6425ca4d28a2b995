"""Knees that stay bent, on bipeds of drawn sizes: a straight leg has no direction to bend in."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp.declare.reference import Reference
from hqp.robots.soles import feet
from hqp.walking import Gait, Walker
from hqp.walking.knees import BEND
from tests.scenes.bipeds import biped

KNEES = "u_k", "w_k"


def drawn(seed: int, folder: Path) -> Walker:
    """A walker of a drawn biped, whose knees are straight at an angle of 0 in each pose of its file."""
    rng = np.random.default_rng(seed)
    size, bend, tilt, lower = rng.uniform([0.5, 0.0, -0.3, 0.01], [1.3, 1.0, 0.3, 0.1]).tolist()
    path = biped(folder, size=size, bend=bend, tilt=tilt, right_first=bool(rng.integers(2)))
    robot, soles = feet(hqp.robots.load(path, floating=True, rotors=True))
    return Walker(robot, Gait(lower=lower), soles=soles, dt=0.005, deadline=math.inf)


@pytest.mark.parametrize("seed", range(6))
def test_knees_are_found_with_their_angle_of_a_straight_leg(seed: int, tmp_path: Path) -> None:
    walker = drawn(seed, tmp_path)
    knees, start = walker.stacks.knees, walker.robot.state(walker.start)
    assert set(knees.joints or ()) == set(KNEES)
    bends = start.angles[walker.robot.joints(knees.joints)]
    np.testing.assert_allclose(knees.low, np.minimum(BEND, 0.5 * bends), atol=1e-6)
    assert knees.high == (math.inf, math.inf)


@pytest.mark.parametrize("seed", range(4))
def test_a_height_out_of_reach_leaves_the_knees_bent(seed: int, tmp_path: Path) -> None:
    """The CoM is to rise by a third: legs without such limits get straight, and bend to the other side."""
    walker = drawn(seed, tmp_path)
    robot, height = walker.robot, walker.stacks.height.name
    q, v = walker.start, np.zeros(robot.nv)
    knees = walker.stacks.knees
    columns, least = robot.joints(knees.joints), math.inf
    for _ in range(300):
        state = robot.state(q, v)
        walker._native.step(q, v, None)
        high = Reference(height, np.array([4.0 / 3.0 * walker.height]))
        references = [high if one.name == height else one for one in walker._references()]
        tick = walker.session.step(state, *references, phase=walker.support)
        q, v = tick.advance()
        least = min(least, float(np.min(state.angles[columns] - knees.low)))
    assert -0.02 < least < 0.1
