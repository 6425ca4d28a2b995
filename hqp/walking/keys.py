"""Keys of a terminal as a joystick."""

from __future__ import annotations

import os
import select
import sys
from typing import Any

HELP = "w faster forward, s back, a and d aside, q and e turn, space stops"

STEP = {
    "w": (0.05, 0.0, 0.0),
    "s": (-0.05, 0.0, 0.0),
    "a": (0.0, 0.02, 0.0),
    "d": (0.0, -0.02, 0.0),
    "q": (0.0, 0.0, 0.05),
    "e": (0.0, 0.0, -0.05),
}
"""Velocity increment of a key press [m/s, m/s, rad/s]."""

MOST = (0.4, 0.1, 0.3)
"""Largest velocity by keys [m/s, m/s, rad/s]."""


class Keys:
    """Keys pressed in the terminal, read without waiting; if standard input is no terminal there are none."""

    def __init__(self) -> None:
        self.velocity = (0.0, 0.0, 0.0)
        self._before: Any = None

    def __enter__(self) -> Keys:
        if sys.stdin.isatty():
            import termios
            import tty

            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, *error: object) -> None:
        if self._before is not None:
            import termios

            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def command(self) -> tuple[float, float, float] | None:
        """The velocity after the keys pressed since the last call, None for none."""
        if self._before is None or not select.select([sys.stdin], [], [], 0.0)[0]:
            return None
        return self.press(os.read(sys.stdin.fileno(), 1024).decode(errors="ignore"))  # a file would keep some to itself

    def press(self, keys: str) -> tuple[float, float, float] | None:
        """The velocity after these keys, None where none of them is one."""
        known = [key for key in keys.lower() if key in STEP or key == " "]
        for key in known:
            added = STEP.get(key)
            if added is None:
                self.velocity = (0.0, 0.0, 0.0)
                continue
            x, y, w = (max(-m, min(m, round(v + a, 6))) for v, a, m in zip(self.velocity, added, MOST, strict=True))
            self.velocity = (x, y, w)
        return self.velocity if known else None
