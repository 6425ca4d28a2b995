"""Packets as they come in: their checks, and their send times on the clock of the loop."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqp.declare.element import Task
from hqp.errors import DeclarationError

MOST = 1000
"""Packets that wait for the loop at most; older ones are forgotten."""

MEMORY = 2.5
"""The fastest packet of this period, and of the one before, determines the clock offset [s]."""


LARGEST = 1e6
"""Numbers of a value are at most this: from here on a double no longer resolves a motion of nanometres [m, rad]."""

COARSEST = 1e-3
"""Coarsest resolution of a time stamp as a double [s]; nanoseconds since 1970, given as seconds, exceed it."""


@dataclass(frozen=True, slots=True)
class Packet:
    """A target as it was received.

    value: checked, None where it is of no use, for the reason ``fault``.  sent [s]: on the sender's clock, or on the
    loop's if the sender gives no time (``timed`` False).  received [s]: on the clock of the loop.  engaged: true
    while the operator holds the clutch.  releases: no target, but the clutch opens, for the reason ``fault``.
    """

    value: Any
    sent: float
    received: float
    timed: bool
    engaged: bool
    fault: str = ""
    releases: bool = False


def packet(element: Task, value: Any, sent: Any, age: Any, received: Any, engaged: Any) -> Packet:
    """Make a packet of arbitrary input from the network; no content raises an exception.

    A packet whose times are not usable has no value.  It is engaged only if ``engaged`` is true, not a text or number.
    """
    arrived, old = as_float(received), 0.0 if age is None else as_float(age)
    time = as_float(sent) if sent is not None else arrived - old
    fault = ""
    if not math.isfinite(arrived):
        fault, arrived = f"received={received!r:.40} is not a finite time [s]", -math.inf
    elif not old >= 0.0:
        fault = f"age={age!r:.40} is not a time of at least 0 s"
    elif not math.isfinite(time) or math.ulp(time) > COARSEST:
        fault = f"sent={sent!r:.40} is not a finite time [s] with a resolution of 1 ms"
    checked, wrong = _checked(element, value)
    held = isinstance(engaged, (bool, np.bool_)) and bool(engaged)
    fault = wrong or fault
    return Packet(None if fault else checked, time, arrived, sent is not None, held, fault)


def as_float(value: Any) -> float:
    """The value as a float, NaN if it is not one."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _checked(element: Task, value: Any) -> tuple[Any, str]:
    """The value of a reference, and the reason if it is not usable."""
    try:
        found = element.at(value).value
    except (DeclarationError, TypeError, ValueError, OverflowError, RecursionError) as error:
        return None, str(error)
    if found is None or not np.isfinite(found).all():
        return None, "it is not finite"
    return (None, f"it exceeds {LARGEST:.0e} m or rad") if np.abs(found).max(initial=0.0) > LARGEST else (found, "")


class Clock:
    """Offset of the sender's clock, from the packets with the least transmission time.

    Packets come late by different amounts, never early: received - sent is least for the fastest.  Two clocks that
    drift apart are followed, as only the last 2.5 to 5 s count.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Another clock."""
        self._least, self._before, self._since = math.inf, math.inf, -math.inf

    def take(self, one: Packet) -> None:
        """Learn from a packet."""
        if one.received - self._since > MEMORY:
            self._before, self._least, self._since = self._least, math.inf, one.received
        self._least = min(self._least, one.received - one.sent if one.timed else 0.0)

    @property
    def behind(self) -> float:
        """The time of the loop less that of the sender [s]."""
        least = min(self._least, self._before)
        return least if math.isfinite(least) else 0.0


class Inbox:
    """Packets between the thread that receives and the loop: each packet comes out once, in order.

    A packet received later than the tick waits, and holds up no other.
    """

    def __init__(self) -> None:
        self._waiting: deque[Packet] = deque(maxlen=MOST)
        self._later: list[Packet] = []

    def put(self, one: Packet) -> None:
        """From any thread."""
        self._waiting.append(one)

    def take(self, now: float) -> list[Packet]:
        """Packets received by ``now`` [s]."""
        waiting, every = self._waiting, self._later
        for _ in range(len(waiting)):
            every.append(waiting.popleft())
        self._later = [one for one in every if one.received > now][-MOST:]
        return [one for one in every if one.received <= now]
