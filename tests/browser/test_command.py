"""`hqp view` as typed, in a real browser: without references every target can be dragged."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.browser.chromium import arrow, drag, shoot, tab_at, wait_for

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.browser


@contextmanager
def command(*arguments: str) -> Iterator[Any]:
    """The page of `hqp view ARGUMENTS`, opened at its printed address."""
    line = [sys.executable, "-m", "hqp", "view", *arguments, "--no-browser"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        try:
            assert process.stdout is not None
            url = next((m[1] for m in map(re.compile(r"open (\S+)").search, process.stdout) if m), None)
            assert url, "the command ended without an address"
            with tab_at(url) as tab:
                yield tab
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def tab() -> Iterator[Any]:
    """The page of README's example."""
    with command("examples/g1.toml", "--robot", "g1") as found:
        yield found


def test_the_example_is_dragged_without_a_reference(tab: Any) -> None:
    wait_for(tab, "every contact and every limit holds")
    assert "gives way" not in tab.inner_text("body")
    x, y = arrow(tab)  # the hand's, the only target that moves along z
    shoot(tab, "command")
    drag(tab, x, y, 0, -60)
    wait_for(tab, "Every target is reached; posture gives way")
    shoot(tab, "command_dragged")
    tab.click("text=Give targets back")
    wait_for(tab, "No one: every level is met")
    assert arrow(tab) == pytest.approx((x, y), abs=3), "the handle is not back where the task is held"


def test_no_note_of_visers_covers_the_headline(tab: Any) -> None:
    headline = tab.locator("text=Every target is reached").first.bounding_box()
    for note in tab.locator(".mantine-Notification-root").all():
        box = note.bounding_box()
        assert box is None or box["y"] > headline["y"] + 300
