"""Progress of long work, with an estimate of the time left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")

PATIENCE = 2.0
"""Work that ends within it shows nothing [s]."""
PERIOD = 0.2
"""Time from one line to the next [s]."""


def tracked(items: Iterable[Item], title: str, size: Callable[[Item], float] = lambda item: 1.0) -> Iterator[Item]:
    """Yield the items; after two seconds write on a terminal's standard error the share done and the time left.

    size: share of the work that an item takes, in any unit; the time left is estimated from it.
    """
    listed = list(items)
    whole, done = sum(map(size, listed)), 0.0
    began = time.monotonic()
    due = began + PATIENCE if sys.stderr.isatty() else float("inf")
    written = 0
    try:
        for item in listed:
            yield item
            done += size(item)
            now = time.monotonic()
            if now >= due and done < whole:
                due = now + PERIOD
                left = _duration((now - began) * (whole / done - 1.0))
                text = f"{title}: {100.0 * done / whole:.0f} %, about {left} left"
                print("\r" + text.ljust(written), end="", file=sys.stderr, flush=True)
                written = len(text)
    finally:
        if written:
            print("\r" + " " * written + "\r", end="", file=sys.stderr, flush=True)


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
