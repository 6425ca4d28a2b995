"""A course between a walker and its plant: the source of its feet's loads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp
from hqp.walking import Walker
from hqp.walking.course import NOISY, Course

DT = 0.002


@pytest.mark.long
@pytest.mark.parametrize("feels", [True, False])
def test_loads_without_force_sensors_are_those_that_feet_bear(feels: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = hqp.robots.load("talos")
    course = Course(Walker(robot, dt=DT, deadline=np.inf), sensors=None, delay=0.0, feels=feels)
    given: list[Any] = []
    step = course.walker.step

    def told_to(state: Any, loads: Any, **now: Any) -> Any:
        given.append(np.array(loads))
        return step(state, loads, **now)

    monkeypatch.setattr(course.walker, "step", told_to)
    assert len(course.observers) == (0 if feels else 2)
    borne = []
    for _ in range(100):  # 0.2 s of standing, ten time constants of an observer
        course.step()
        borne.append(course.plant.measure().contacts.load)
    told, true = np.mean(given[-20:], axis=0), np.mean(borne[-20:], axis=0)
    weight = course.walker.weight
    assert true.sum() == pytest.approx(weight, rel=0.1)
    assert told == pytest.approx(true, abs=0.05 * weight)
    if not feels:
        assert not np.array_equal(given[-1], borne[-2])


@pytest.mark.long
def test_a_walker_with_sensors_gets_an_estimate_without_them_the_truth() -> None:
    walker = Walker(hqp.robots.load("talos"), dt=DT, deadline=np.inf)  # it stands on both
    for sensors in (None, NOISY):
        course = Course(walker, sensors=sensors, delay=0.0, height=0.03)
        assert (course.estimator is None) == (sensors is None)
        ground = np.mean([course.plant.place(foot.frame)[0][2] + foot.depth for foot in course.walker.feet])
        assert ground == pytest.approx(0.03, abs=2e-3)
        off, rates = [], []
        for _ in range(30):
            q, v = course.plant.state()
            course.step()
            off.append(np.abs(course.state.q - q)[3:].max())
            rates.append((course.state.v - v)[6:].std())
        if sensors is None:
            assert max(off) < 1e-12
            assert max(rates) < 1e-12
        else:
            assert 0.0 < np.mean(off) < 0.01
            assert np.mean(rates) == pytest.approx(NOISY.rate.std, rel=0.2)
