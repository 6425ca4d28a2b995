"""Closed loops in which everything goes wrong: what must never happen does not."""

from __future__ import annotations

import numpy as np
import pytest

from tests.scenes.soak import LEVELS, ROBOTS, Record, load, soak


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ROBOTS)
def test_no_event_breaks_a_loop(name: str, level: str) -> None:
    ticks = 40 if level == "torque" else 150
    record = Record()
    sent = soak(load(name), level, ticks, np.random.default_rng(7), record)
    assert record.ticks == ticks
    assert sum(record.events.values()) > 0
    again = soak(load(name), level, ticks, np.random.default_rng(7), Record())
    assert sent == again  # the same bits twice
