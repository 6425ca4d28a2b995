"""A foot that slips while a robot walks."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp.robots
from benchmarks.walking.course import DT, Course
from benchmarks.walking.estimators import slippery
from hqp.estimation import FeetEstimator


@pytest.mark.slow
@pytest.mark.xfail(
    reason="issue 51: short slips are not reported since feet land later; the base is off by 0.2 m", strict=True
)
def test_a_walk_on_a_floor_that_is_slippery_under_one_foot() -> None:
    """mu is 0.2 under G1's right foot, at 0.3 m/s: its slip is reported soon, and no other foot's.

    In its third stance it still slides; the error of the base is 12 mm, and 20 mm if the estimate includes the slipping
    foot.
    """
    robot = hqp.robots.load("g1", rotors=True)
    course = Course("g1", 0, edit=slippery(robot.landmarks["soles"], robot), robot=robot)
    estimator, right = course.course.estimator, course.walker.feet[1].frame
    assert estimator is not None
    course.run(1.0)
    course.walker.go(0.3)
    began = told = math.nan
    before = course.plant.place(right)[0][:2]
    while math.isnan(told):
        assert course.run(DT)
        assert course.plant.time < 3.5
        place, loaded = course.plant.place(right)[0][:2], course.plant.contacts().load[1] > 60.0
        slides = loaded and np.linalg.norm(place - before) > FeetEstimator.SLIPS * DT
        began, before = (course.plant.time if math.isnan(began) else began) if slides else math.nan, place
        assert not estimator.slipping[0]
        if estimator.slipping[1]:
            told = course.plant.time
    assert told - began < 0.04
    course.run(0.07)
    assert course.figures()["off_mm"] < 15.0
