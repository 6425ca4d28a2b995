"""Unmet targets of a motion, with time and cause."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec
from hqp.explanation.account import TickAccount

from .contacts import runs
from .tracker import LEAN, OFF, Tracker

NOTED = 5e-3
"""Error of a hand or a foot beyond which each frame records the cause [m]."""

PARTS = ("left_toe", "right_toe", "left_hand", "right_hand")

LIMITS = {**dict.fromkeys(PARTS, OFF), **dict.fromkeys(("torso", "left_sole", "right_sole"), LEAN)}
"""Errors beyond which a part is behind [m; rad for trunk and soles]."""

GAP = 0.1
"""Gap below which two shortfalls are one [s]."""


OTHER_END, ON_ITS_WAY = "it stands on its other end", "on its way"

Names = NDArray[np.str_]


@dataclass(frozen=True)
class Shortfall:
    """A part that was behind from frame ``first`` up to but not ``last``, most in frame ``worst`` by ``error`` [m; rad
    for trunk and soles].

    reason: the cause there.
    """

    part: str
    first: int
    last: int
    worst: int
    error: float
    reason: str

    def thinned(self, each: int) -> Shortfall:
        """Causes of every ``each``-th frame."""
        first = self.first // each
        last = max(first + 1, math.ceil(self.last / each))
        return replace(self, first=first, last=last, worst=self.worst // each)

    def __str__(self) -> str:
        return f"{self.part}, frames {self.first} to {self.last - 1}: {self.by} off, {self.reason}"

    @property
    def by(self) -> str:
        """The error with its unit."""
        return f"{1e3 * self.error:.0f} mm" if self.part in PARTS else f"{math.degrees(self.error):.0f} degrees"


def shortfalls(tracker: Tracker, q: Mat, v: Mat, errors: dict[str, Vec]) -> tuple[Shortfall, ...]:
    """For toes, hands, trunk and soles; errors: by part and frame [m, rad]."""
    found = []
    gap = max(1, round(GAP / tracker.dt))
    for part, limit in LIMITS.items():
        behind = errors[part] > limit
        for first, last in runs(~behind):
            if last - first < gap and first > 0 and last < len(behind):
                behind[first:last] = True
        for first, last in runs(behind):
            worst = first + int(np.argmax(errors[part][first:last]))
            reason = _reason(tracker, q, v, part, min(max(worst, 1), len(q) - 1))
            found.append(Shortfall(part, first, last, worst, float(errors[part][worst]), reason))
    return tuple(sorted(found, key=lambda each: (each.first, each.part)))


def gave_way(tracker: Tracker, q: Mat, v: Mat, errors: dict[str, Vec], frames: Sequence[int]) -> Names:
    """Causes of ``PARTS`` in some frames ``(n, 4)``: an element or a cause, "" where on target."""
    texts = [[""] * len(PARTS) for _ in frames]
    for row, frame in zip(texts, frames, strict=True):
        late = [k for k, part in enumerate(PARTS) if errors[part][frame] > NOTED]
        if late:
            account = tracker.account(q, v, max(frame, 1))
            for k in late:
                row[k] = _to_whom(account, PARTS[k])
    return np.array(texts, dtype=np.str_)


def _reason(tracker: Tracker, q: Mat, v: Mat, part: str, frame: int) -> str:
    """Constraints on a part in the tick that led to a frame, in words."""
    account = tracker.account(q, v, frame)
    if part not in account.elements or account.met(part):
        return _to_whom(account, part)
    line = next(line for line in str(account).splitlines() if line.split()[0] == part)
    return line.split("  ")[-1].strip()


def _to_whom(account: TickAccount, part: str) -> str:
    """Main constraint on a part, in a word."""
    if part not in account.elements:
        return OTHER_END
    losses = account.losses(part)
    return ON_ITS_WAY if account.met(part) else losses[0].element if losses else account.cause(part)
