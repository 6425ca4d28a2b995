"""Legs of more than six joints, which turn between their ends: such a turn hardly bends a knee."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import hqp
from hqp.robots.soles import feet
from hqp.walking import Gait, Walker
from hqp.walking.plan import advance
from tests.scenes.bipeds import biped

Make = Callable[[Path, np.random.Generator], Walker]


def cbi(folder: Path, rng: np.random.Generator) -> Walker:
    """The only robot of the catalogue with such legs."""
    return Walker(hqp.robots.load("cbi", rotors=True), dt=0.004, deadline=math.inf)


def drawn(folder: Path, rng: np.random.Generator) -> Walker:
    """A biped of a drawn size whose ankles turn, too."""
    size, lower = rng.uniform([0.5, 0.03], [1.3, 0.08]).tolist()
    path = biped(folder, size=size, ankles=("yaw", "pitch", "roll"))
    robot, soles = feet(hqp.robots.load(path, floating=True, rotors=True))
    return Walker(robot, Gait(lower=lower), soles=soles, dt=0.004, deadline=math.inf)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("made", [cbi, drawn])
def test_a_knee_at_its_limit_leaves_legs_calm(made: Make, seed: int, tmp_path: Path) -> None:
    """A walk by the model: while both feet stand, joints of legs accelerate as the body does."""
    rng = np.random.default_rng(seed)
    walker = made(tmp_path, rng)
    robot, q, v, most = walker.robot, walker.start.copy(), np.zeros(walker.robot.nv), 0.0
    legs = robot.joints([name for foot in walker.feet for name in foot.leg])
    assert len(legs) > 12
    walker.go(float(rng.uniform(0.17, 0.3)) * math.sqrt(walker.height))
    for _ in range(800):
        q, v, tick = advance(walker, q, v)
        if walker.phase == "shift":
            most = max(most, float(np.max(np.abs(walker.session.program.acceleration(tick.x)[legs]))))
    assert most < 60.0
