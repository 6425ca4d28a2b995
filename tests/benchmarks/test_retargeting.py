"""A retargeted clip in physics: a stance of the clip also stands in MuJoCo, a motion with displaced feet falls."""

from __future__ import annotations

import numpy as np
import pytest

import hqp
from benchmarks.retargeting.physics import ASTRAY, fate, plates
from hqp.motion import retarget, retargeting
from hqp.motion.tracker import Pass, Tracker
from tests.motion.people import stand


@pytest.fixture(scope="module")
def stood() -> tuple[Tracker, Pass]:
    kept: list[tuple[Tracker, Pass]] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(retargeting, "smoothed", lambda tracker, found: kept.append((tracker, found)) or found)
        retarget(stand(1.0), "g1")
    return kept[0]


@pytest.mark.slow
def test_who_stands_does_not_fall(stood: tuple[Tracker, Pass]) -> None:
    tracker, found = stood
    told = fate(hqp.robots.load("g1", rotors=True), tracker.targets, found.q)
    assert told.seconds == pytest.approx(told.of, abs=0.01)
    assert told.usable == 1.0
    assert not plates(tracker.targets)


@pytest.mark.slow
def test_who_is_carried_away_from_his_feet_falls(stood: tuple[Tracker, Pass]) -> None:
    tracker, found = stood
    away = found.q.copy()
    away[:, 0] += np.linspace(0.0, 6.0 * ASTRAY, len(away))
    told = fate(hqp.robots.load("g1", rotors=True), tracker.targets, away)
    assert told.seconds < 0.9 * told.of
