"""A course between a walker and its plant: the source of its feet's loads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import hqp
from hqp.walking import Walker
from hqp.walking.course import Course

DT = 0.002


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
