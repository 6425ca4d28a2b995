"""The start pose of a biped: legs alone lower it, each knee to its own side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hqp.robots
from hqp.robots.knees import knee
from hqp.robots.soles import feet
from hqp.walking.feet import feet_of, upper
from hqp.walking.knees import BEND
from hqp.walking.stance import standing
from tests.scenes.bipeds import biped

ANGLE = 1e-3
"""Largest turn of a joint above the legs from home [rad]."""


def judged(robot: Any, soles: tuple[str, str] | None, lower: float) -> None:
    both = feet_of(robot, soles)
    q = standing(robot, both, lower)
    columns = robot.joints(upper(robot, both))
    angles, home = (robot.copy().state(at).angles for at in (q, robot.home))
    assert np.abs(angles - home)[columns].max(initial=0.0) < ANGLE
    for foot in both:
        name, bend = knee(robot, foot.leg, q)
        column = int(robot.joints([name])[0])
        straight = angles[column] - bend
        assert abs(bend) > BEND
        assert robot.lower[column] < straight + np.sign(bend) * np.pi / 2 < robot.upper[column]


@pytest.mark.parametrize("seed", range(12))
def test_legs_alone_lower_a_drawn_biped(seed: int, tmp_path: Path) -> None:
    """From knees bent to either side, on level or tilted soles, under any waist."""
    rng = np.random.default_rng(seed)
    bend, heel, ahead, lower = rng.uniform([-0.3, -0.3, 0.0, 0.03], [0.6, 0.3, 0.06, 0.12]).tolist()
    waist = tuple(axis for axis in ("yaw", "roll", "pitch") if rng.integers(2))
    path = biped(tmp_path, bend=bend, back=0.4, heel=heel, ahead=ahead, waist=waist)
    robot, soles = feet(hqp.robots.load(path, floating=True, rotors=True))
    judged(robot, soles, lower)


@pytest.mark.parametrize("name", ["talos", "g1", "cbi", "icub", "romeo"])
def test_legs_alone_lower_a_biped_of_the_catalogue(name: str) -> None:
    """Waist and arms stay at home: bent to a limit in the start pose they have no way to balance."""
    judged(hqp.robots.load(name), None, 0.06)


@pytest.mark.long
def test_strong_legs_are_lowered_as_far_as_asked() -> None:
    """G1's knees bear their load at 0.94 of the height at home."""
    robot = hqp.robots.load("g1")
    both = feet_of(robot)
    home, low = (robot.copy().state(q) for q in (robot.home, standing(robot, both, 0.06)))
    heights = [
        float(state.com()[2]) - np.mean([foot.placed(state).z + foot.depth for foot in both]) for state in (home, low)
    ]
    assert heights[1] / heights[0] == pytest.approx(0.94, abs=1e-3)
