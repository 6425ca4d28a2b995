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


@dataclass(frozen=True, slots=True)
class Packet:
    """A target as it was received.

    value: checked, None where it is of no use, for the reason ``fault``.  sent [s]: on the sender's clock, or on the
    loop's if the sender gives no time (``timed`` False).  received [s]: on the clock of the loop.  engaged: true while
    the operator holds the clutch.
    """

    value: Any
    sent: float
    received: float
    timed: bool
    engaged: bool
    fault: str = ""


def packet(element: Task, value: Any, sent: float | None, age: float | None, received: float, engaged: bool) -> Packet:
    """Make a packet of arbitrary input from the network."""
    timed, fault = sent is not None, ""
    time = float(sent) if sent is not None else received - (0.0 if age is None else float(age))
    checked: Any = None
    try:
        checked = element.at(value).value
        if checked is None or not np.isfinite(checked).all():
            checked, fault = None, "it is not finite"
    except DeclarationError as error:
        fault = str(error)
    if not math.isfinite(time):
        checked, fault = None, "its time is not finite"
    return Packet(checked, time, received, timed, bool(engaged), fault)


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
    """Packets between the thread that receives and the loop: each packet comes out once, in order."""

    def __init__(self) -> None:
        self._waiting: deque[Packet] = deque(maxlen=MOST)

    def put(self, one: Packet) -> None:
        """From any thread."""
        self._waiting.append(one)

    def take(self, now: float) -> list[Packet]:
        """Packets received by ``now`` [s]."""
        found, waiting = [], self._waiting
        while waiting and waiting[0].received <= now:
            found.append(waiting.popleft())
        return found
