"""Page of a retargeted motion in a real browser: a person next to the robot, and a slider over the frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hqp.motion import retarget
from hqp.motion.scrubber import PERSON, Scrubber
from tests.motion.people import walk

from .chromium import picture, settle, shoot, tab_at, wait_for

pytestmark = pytest.mark.browser


def persons(tab: Any) -> Any:
    """Rows and columns of the pixels that have the person's colour ``(n, 2)``."""
    return np.argwhere(abs(picture(tab) - np.array(PERSON)).sum(axis=2) < 40)


def test_the_slider_shows_another_frame() -> None:
    motion = retarget(walk(), "g1")
    page = Scrubber(motion, speed=0.0)  # stands still at first
    try:
        with tab_at(page.url, "in contact") as tab:
            tab.get_by_label("Play").first.click()
            places = []
            for frame in (0, len(motion) - 1):
                number = tab.locator(
                    "input[inputmode=decimal], input[type=number], input.mantine-NumberInput-input"
                ).first
                number.fill(str(frame))
                number.press("Enter")
                wait_for(tab, f"{frame / motion.fps:.2f} s, in contact")
                settle(tab)
                places.append(persons(tab))
            shoot(tab, "scrubber")
        assert min(map(len, places)) > 100, "no person to be seen"
        assert np.abs(np.mean(places[0], axis=0) - np.mean(places[1], axis=0)).max() > 20.0
    finally:
        page.close()
