"""A foot that slips while a robot walks."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hqp.robots
from benchmarks.walking.course import DT, Course
from benchmarks.walking.estimators import slippery


def slid(name: str, seed: int) -> tuple[float, float, float, float]:
    """Seven seconds of a walk, or until half a second before it falls, on a floor that is slippery under the last foot.

    Time of slides [s], the share of it that is reported, time of reports of feet at rest [s], error of the base over
    the length of the slides.
    """
    rng = np.random.default_rng(seed)
    robot = hqp.robots.load(name, rotors=True)
    edit = slippery(robot.landmarks["soles"], robot, float(rng.uniform(0.14, 0.2)))
    course = Course(name, seed, edit=edit, robot=robot)
    estimator, feet = course.course.estimator, [foot.frame for foot in course.walker.feet]
    assert estimator is not None
    course.run(1.0)
    course.walker.go(float(rng.uniform(0.2, 0.3)))
    places, loads, told = [], [], []
    while course.plant.time < 8.0 and course.run(DT):
        places.append([course.plant.place(foot)[0][:2] for foot in feet])
        loads.append(course.plant.contacts().load)
        told.append(estimator.slipping)
    count = len(places) if math.isnan(course.fell) else len(places) - round(0.5 / DT)
    steps = np.linalg.norm(np.diff(places[:count], axis=0), axis=2)
    speeds = np.apply_along_axis(np.convolve, 0, steps / DT, np.ones(10) / 10, "same")
    loaded, reports = np.array(loads[1:count]) > 0.2 * course.walker.weight, np.array(told[1:count])
    slides = loaded & (speeds > 0.1)
    error = np.linalg.norm(course.off[round(1.0 / DT) + count - 1][:3]) / np.sum(steps[slides])
    false = DT * np.sum(reports & loaded & (speeds < 0.02))
    return DT * float(np.sum(slides)), float(np.mean(reports[slides])), float(false), float(error)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["g1", "talos"])
def test_slides_of_a_walk_are_reported(name: str, seed: int) -> None:
    lasted, reported, false, error = slid(name, seed)
    assert lasted > 0.1
    assert reported > 0.8
    assert false < 0.1
    assert error < 0.5
