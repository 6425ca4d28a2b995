"""The frame from which a motion is solved, both ways: a corner that traps the forward pass may not trap the backward
one."""

from __future__ import annotations

import numpy as np

from hqp.arrays import Mat

from .branches import start
from .contacts import runs
from .smoothing import Course
from .tracker import Pass, Tracker

SHORT = 0.1
"""Duration of a lag above which the motion needs another anchor [s]."""

MOST = 5
"""Maximum number of anchors."""


def solved(tracker: Tracker) -> Pass:
    """The whole motion, from the anchor that leaves hands, feet, trunk and soles least behind.

    The first frame is the first anchor.  If one of them lags for a while, the motion without self-collision leads the
    next pass; then the last frame is the anchor, then the worst frame of the best pass so far, as long as that reduces
    the lag.
    """
    last = len(tracker.targets) - 1
    best, errors = _from(tracker, 0, None)
    if tracker.stacks.collision and _behind(tracker, errors):
        other, found = _led(tracker, solved(tracker.without_collision()))
        if _cost(found) < _cost(errors):
            best, errors = other, found
    tried, anchor = {0}, last
    while len(tried) < MOST and anchor not in tried and _behind(tracker, errors):
        tried.add(anchor)
        other, found = _from(tracker, anchor, best)
        if _cost(found) < _cost(errors):
            best, errors = other, found
        elif anchor != last:
            break
        anchor = int(errors.max(axis=1).argmax())
    return best


def _from(tracker: Tracker, anchor: int, hint: Pass | None) -> tuple[Pass, Mat]:
    """The pass from an anchor both ways, and its errors ``(T, 7)``."""
    q = start(tracker, anchor, *([] if hint is None else [hint.q[anchor]]))
    rest, last = np.zeros(tracker.robot.nv), len(tracker.targets) - 1
    found = tracker.run(q, rest, anchor, last)
    if anchor:
        found = tracker.run(q, rest, anchor, 0).reversed().then(found)
    return found, tracker.errors(found.q)


def _led(tracker: Tracker, by: Pass) -> tuple[Pass, Mat]:
    """The pass whose pelvis and joints stay near those of another below hands and feet, and its errors ``(T, 7)``.

    Trunk and limbs that follow the person may bar each other's way: most of a motion without self-collision is free.
    """
    course = Course(tracker, by.q)
    q = tracker.settle(by.q[0], 0, course)
    found = tracker.run(q, np.zeros(tracker.robot.nv), 0, len(by.q) - 1, course)
    return found, tracker.errors(found.q)


def _behind(tracker: Tracker, errors: Mat) -> bool:
    """Return true if a part lags for longer than ``SHORT``."""
    frames = max(1, round(SHORT / tracker.dt))
    return any(last - first >= frames for column in errors.T for first, last in runs(column > 1.0))


def _cost(errors: Mat) -> float:
    """Sum of the errors beyond 1, over all frames."""
    return float(np.maximum(errors - 1.0, 0.0).sum())
