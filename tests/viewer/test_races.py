"""Drawing goes on after viser's thread changed the waiters of an event that a drawing set."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from hqp.viewer.server import Server


class Racing:
    """A panel whose every second assignment raises as viser's does."""

    def __init__(self, message: str) -> None:
        self._message, self.count = message, 0

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "content":
            self.count += 1
            if self.count % 2 == 1:
                raise RuntimeError(self._message)
        object.__setattr__(self, name, value)


def served(panel: Racing, most: int) -> Any:
    """A server whose drawing assigns to the panel only, alive for so many turns."""
    server: Any = object.__new__(Server)
    server._channel = type("Channel", (), {"closed": property(lambda _: panel.count >= most)})()
    server._history = type("History", (), {"latest": 0, "part": lambda *_: 0.0})()
    server._server = type("Viser", (), {"stop": lambda _: None})()
    server._read = lambda: None
    server._draw = lambda now: setattr(panel, "content", now)
    return server


def test_a_race_leaves_the_rest_to_the_next_drawing() -> None:
    panel, alive = Racing("deque mutated during iteration"), threading.Event()
    alive.set()
    served(panel, 4).run(alive)
    assert panel.count == 4


def test_other_errors_end_the_process() -> None:
    alive = threading.Event()
    alive.set()
    with pytest.raises(RuntimeError, match="another"):
        served(Racing("another"), 4).run(alive)
