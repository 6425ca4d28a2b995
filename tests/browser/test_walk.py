"""`hqp walk --view` in a real browser: keys in the terminal steer the robot, and a space stops it."""

from __future__ import annotations

import os
import pty
import re
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tests.browser.chromium import SCENE, picture, shoot, tab_at

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.browser


class Terminal:
    """A command in its own terminal."""

    def __init__(self, *line: str) -> None:
        self._own, theirs = pty.openpty()
        environment = {**os.environ, "BROWSER": "true"}  # a program that opens nothing
        self.process = subprocess.Popen(
            line, stdin=theirs, stdout=theirs, stderr=theirs, cwd=ROOT, env=environment, close_fds=True
        )
        os.close(theirs)
        self.text = ""

    def press(self, keys: str) -> None:
        os.write(self._own, keys.encode())

    def until(self, pattern: str, seconds: float = 120.0, start: int = 0) -> re.Match[str]:
        """Return the match of a pattern in the output after ``start``, once there is one."""
        end = time.monotonic() + seconds
        while not (found := re.compile(pattern).search(self.text, start)):
            assert time.monotonic() < end, f"no {pattern!r} in {self.text[start:]!r}"
            if select.select([self._own], [], [], 0.5)[0]:
                self.text += os.read(self._own, 4096).decode()  # raises OSError after the command has ended
        return found


@contextmanager
def terminal(*line: str) -> Iterator[Terminal]:
    made = Terminal(*line)
    try:
        yield made
    finally:
        made.process.terminate()
        made.process.wait(30.0)


def test_keys_steer_the_robot_and_a_space_stops_it() -> None:
    with terminal(sys.executable, "-m", "hqp", "walk", "--robot", "g1", "--view") as walk:
        url = walk.until(r"(http\S+)\s")[1]
        with tab_at(url, "g1 walks", still=False) as tab:
            before = picture(tab)[SCENE]
            walk.press("www")  # at once, as from a fast hand
            walk.until(r"swing .*CoM +0\.[1-9]")
            moved = picture(tab)[SCENE]
            shoot(tab, "walk")
            assert np.mean(abs(moved - before).sum(axis=2) > 60) > 1e-2, "the page shows it where it was"
            since = len(walk.text)
            walk.press(" ")
            walk.until(r"stand ", start=since)
