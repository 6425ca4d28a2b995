"""Slipping feet: detected, reported, and excluded from the estimate."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp.robots
from hqp.estimation import FeetEstimator
from hqp.walking.walker import TOUCH

from .test_walker import Walked

DT = 0.002
SLIDES = (0.4, 0.6)
"""Interval in which the right foot slides, by 40 mm [s]."""


def slid(noise: float, seed: int = 0) -> tuple[float, Any]:
    """Base at rest, both feet loaded, the right one sliding: largest error [m] and slip reports ``(500, 2)``."""
    robot, rng = hqp.robots.load("g1"), np.random.default_rng(seed)
    estimator = FeetEstimator(robot, robot.landmarks["soles"], DT, robot.home)
    (hip,) = robot.joints(["right_hip_pitch_joint"])
    q, up, load = robot.home.copy(), np.array([0.0, 0.0, 9.81]), np.array([160.0, 160.0])
    off, told = 0.0, []
    for k in range(500):
        v = np.zeros(robot.nv)
        v[hip] = 0.3 * (SLIDES[0] <= k * DT < SLIDES[1])
        q = robot.integrate(q, v, DT)
        v[6:] += noise * rng.normal(size=robot.nv - 6)
        found, _ = estimator.update(q, v, up, load)
        off = max(off, float(np.linalg.norm(found[:3] - robot.home[:3])))
        told.append(estimator.slipping)
    return off, np.array(told)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_foot_that_slips_is_told_and_not_believed(noise: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both bear equal loads; the resting foot keeps the base in place.  Noise of encoders in [rad/s]."""
    off, told = slid(noise)
    assert off < 2e-3
    assert not told[:, 0].any()
    first, last = np.flatnonzero(told[:, 1])[[0, -1]] * DT
    assert SLIDES[0] < first < SLIDES[0] + 0.02
    assert SLIDES[1] < last < SLIDES[1] + 0.06
    monkeypatch.setattr(FeetEstimator, "SLIPS", math.inf)
    assert slid(noise)[0] > 15e-3


@pytest.mark.slow
def test_legs_feel_the_ground_without_force_sensors() -> None:
    """Momentum observers alone detect landings and loads: each within 10 ms, and none early."""
    course = Walked.of("g1", feels=False)
    walker, plant = course.walker, course.plant
    least, late, since = TOUCH * 9.81 * walker.robot.mass, [], math.nan
    course.run(1.0)
    walker.go(forward=0.2)
    while plant.time < 4.5:
        course.run(DT)
        if walker.phase == "swing":
            side = 1 - walker.stance
            if walker._state.t > 0.3 and math.isnan(since) and plant.contacts().load[side] > least:
                since = plant.time
        elif walker.event == "shift":
            late.append(plant.time - since)
            since = math.nan
    assert plant.com()[0] > 0.35
    assert len(late) >= 4
    assert np.nanmin(late[1:]) >= 0.0
    assert np.max(late[1:]) <= 0.0101
