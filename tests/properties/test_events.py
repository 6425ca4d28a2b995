"""Closed loops with every disturbance: no forbidden result occurs."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from tests.scenes.soak import LEVELS, RATES, ROBOTS, Record, load, soak


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ROBOTS)
def test_no_event_breaks_a_loop(name: str, level: str) -> None:
    ticks = 25 if level == "torque" else 75
    record = Record()
    sent = soak(load(name), level, ticks, np.random.default_rng(7), record)
    assert record.ticks == ticks
    assert sum(record.events.values()) > 0
    again = soak(load(name), level, ticks, np.random.default_rng(7), Record())
    assert sent == again  # equal bits twice


@pytest.mark.slow
def test_ten_thousand_hostile_ticks() -> None:
    """A part of ``make soak``: ten robots at three levels, with rates and without."""
    rng, record = np.random.default_rng(11), Record()
    for turn, (name, level) in enumerate(product(ROBOTS, LEVELS)):
        soak(load(name), level, 340, rng, record, RATES if turn % 2 else None)
    assert record.ticks >= 10_000
    assert record.looks > 100
