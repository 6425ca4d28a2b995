"""What of a motion was not met, when, and what it gave way to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqp.arrays import Mat, Vec

from .contacts import runs
from .tracker import Tracker

OFF = 0.05
"""A hand or a foot further off than this is behind [m]."""

GAP = 0.1
"""Stretches behind that are nearer than this are one [s]."""


@dataclass(frozen=True)
class Shortfall:
    """A part that was behind from frame ``first`` up to but not ``last``, most in frame ``worst`` by ``error`` [m].

    reason: what it gave way to there.
    """

    part: str
    first: int
    last: int
    worst: int
    error: float
    reason: str

    def __str__(self) -> str:
        return f"{self.part}, frames {self.first} to {self.last - 1}: {1e3 * self.error:.0f} mm off, {self.reason}"


def shortfalls(tracker: Tracker, q: Mat, v: Mat, errors: dict[str, Vec]) -> tuple[Shortfall, ...]:
    """Of the toes and hands; errors: by part and frame [m]."""
    found = []
    gap = max(1, round(GAP / tracker.dt))
    for part in ("left_toe", "right_toe", "left_hand", "right_hand"):
        behind = errors[part] > OFF
        for first, last in runs(~behind):
            if last - first < gap and first > 0 and last < len(behind):
                behind[first:last] = True
        for first, last in runs(behind):
            worst = first + int(np.argmax(errors[part][first:last]))
            reason = _reason(tracker, q, v, part, min(max(worst, 1), len(q) - 1))
            found.append(Shortfall(part, first, last, worst, float(errors[part][worst]), reason))
    return tuple(sorted(found, key=lambda each: (each.first, each.part)))


def _reason(tracker: Tracker, q: Mat, v: Mat, part: str, frame: int) -> str:
    """What held a part back in the tick that led to a frame."""
    standing = tracker.standing(frame - 1)
    session = tracker.sessions.of(standing)
    if part not in session:
        return "it stands on its other end"
    state = tracker.robot.state(q[frame - 1], v[frame - 1])
    state.commanded = v[frame - 1]
    tick = session.step(state, *tracker.references(frame - 1, frame, standing, {}))
    account = tick.account()
    if account.met(part):
        return "on its way"
    line = next(line for line in str(account).splitlines() if line.split()[0] == part)
    return line.split("  ")[-1].strip()
